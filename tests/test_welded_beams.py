"""Cantilevers of beams welded end to end, in the plane and in space, against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from groups import in_groups
from programs import kept
from tolerances import SOLVED
from verification_problems.rest import EI, LENGTH, MASS, cantilever

import romjax as rj
from romjax import spatial
from romjax.scene.body.modes import bending_roots, bending_shapes
from romjax.system import dynamics


def in_the_plane(count, modes, loads, **options):
    """A cantilever of so many beams along x, with a force across its tip and a moment there."""
    return rj.assemble(cantilever(*loads, count=count, modes=modes, **options))


def in_space(count, modes, loads):
    size, mass = LENGTH / count, MASS / count
    inertia = (1e-4, *2 * [mass * size**2 / 12 + 1e-4])
    beams = [
        spatial.Beam(
            f"beam{i}",
            mass,
            size,
            inertia,
            EI=EI,
            bending=modes,
            position=((i + 0.5) * size, 0.0, 0.0),
        )
        for i in range(count)
    ]
    ends = [rj.ground.at((0.0, 0.0, 0.0)), *(beam.at("end") for beam in beams)]
    welds = [spatial.Weld(beam.at("start"), end) for beam, end in zip(beams, ends, strict=False)]
    force, moment = (rj.Constant(load) for load in loads)
    turn = spatial.Torque(ends[-1], (0.0, 0.0, 1.0), moment)
    return rj.assemble(rj.Scene(beams, welds, [rj.Force(ends[-1], (0.0, 1.0, 0.0), force), turn]))


@kept
def terms(make, settings, options):
    """The stiffness of undeformed beams, the rows of the welds, and the forces of unit loads."""

    def force(loads, q):
        return make(*settings, loads, **options).force(0.0, q, jnp.zeros_like(q))

    system, none = make(*settings, jnp.zeros(2), **options), jnp.zeros(2)
    stiffness = -jax.jacfwd(force, 1)(none, system.q0)
    pulls = jax.jacfwd(force)(none, system.q0)
    return stiffness, dynamics.jacobian(system, 0.0, system.q0), pulls


def compliance(make, *settings, **options):
    """Deflection and slope of the tip, by force and moment there, (2, 2), for small loads: by the
    stiffness K of the undeformed beams and the rows C_q of the welds.
    """
    stiffness, rows, pulls = map(np.asarray, terms(make, settings, options))
    (m, n), diagonal = rows.shape, np.diagonal(stiffness)
    # Amplitudes whose stiffness is one: those of short beams are large numbers.
    sizes = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    stiffness, rows, pulls = (
        sizes[:, None] * stiffness * sizes,
        rows * sizes,
        sizes[:, None] * pulls,
    )
    matrix = np.block([[stiffness, rows.T], [rows, np.zeros((m, m))]])
    # Nothing resists a change of the length of a quaternion.
    moved = np.linalg.lstsq(matrix, np.concatenate([pulls, np.zeros((m, 2))]), rcond=None)[0]
    return pulls.T @ moved[:n]


EXACT = np.array([[LENGTH**3 / 3, LENGTH**2 / 2], [LENGTH**2 / 2, LENGTH]]) / EI


@pytest.mark.parametrize("count", in_groups([1, 4], fast=[4]))
def test_statics_of_welded_beams_are_exact(count):
    """F L³ / 3EI, F L² / 2EI, M L² / 2EI and M L / EI by two modes, in the plane and in space."""
    for make in (in_the_plane, in_space):
        assert_close(compliance(make, count, 2), EXACT, SOLVED, EXACT)


@pytest.mark.parametrize("count", in_groups([1, 4], fast=[4]))
def test_natural_modes_leave_the_same_share_out_for_any_number_of_beams(count):
    """Of M L / EI, Σ (φ'(1) − φ'(0))² / b⁴ remains."""
    found = compliance(in_the_plane, count, 2, shapes="free-free")[1, 1]
    start, end = (bending_shapes("free-free", 2, x, np)[1] for x in (0.0, 1.0))
    share = np.sum((end - start) ** 2 / bending_roots("free-free", 2) ** 4)
    assert_close(found / EXACT[1, 1], share, SOLVED)
    assert share < 0.7
