"""Beams in space: modes, sections, rotating blades, shafts that spin, against closed forms."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from spatial_beams import CONVERGED, EI, LENGTH, MASS, POLAR, beam, clamped, marker
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax import spatial
from romjax.scene.body.capped import CappedBody
from romjax.scene.body.free_modes import free_modes
from romjax.scene.body.modes import bending_roots
from romjax.scene.body.reduced import ReducedBody
from romjax.system import dynamics


def test_frequencies_of_a_free_beam():
    """(βL)² √(EI / m L³) of eight or seven modes, kπ √(GJ / I L) and kπ √(EA / m L) of six."""
    body = beam(EI=(EI, 2 * EI), bending=(8, 7), GJ=2.0, torsion=6, EA=1e3, extension=6)
    found = np.split(body.natural_frequencies(), [8, 15, 21])
    roots = bending_roots("free-free", 2) ** 2
    unit = np.sqrt(EI / (MASS * LENGTH**3))
    assert_close(found[0][:2], roots * unit * np.sqrt(2), CONVERGED, roots * unit)
    assert_close(found[1][:2], roots * unit, CONVERGED, roots * unit)
    bar = np.pi * np.arange(1, 3)
    for own, speed in ((found[2], 2.0 / POLAR), (found[3], 1e3 / MASS)):
        wanted = bar * np.sqrt(speed / LENGTH)
        assert_close(own[:2], wanted, CONVERGED, wanted)


@pytest.mark.instant
@pytest.mark.parametrize("order", [1, 2])
def test_modes_are_orthonormal(order):
    nodes, weights = np.polynomial.legendre.leggauss(20)
    values = np.polynomial.legendre.legval(nodes, free_modes(order, 6).series)
    gram = (values * weights / 2) @ values.T
    assert_close(gram, np.eye(6), IDENTITY)
    assert_close((values * weights * nodes ** (order - 1)) @ np.ones(20), np.zeros(6), IDENTITY)


def test_statics_under_loads_at_the_end_are_exact():
    """Tip of a clamped beam of the fewest modes: F L³ / 3EI, M L / EI, T L / GJ, N L / EA."""
    body = beam(EI=(EI, 2 * EI), bending=2, GJ=2.0, torsion=1, EA=1e3, extension=1)

    def tip(bent):
        place, turn = marker(body, clamped(body, bent), (LENGTH / 2, 0.0, 0.0))
        return jnp.concatenate([place - jnp.array([LENGTH, 0, 0]), 2 * turn[1:] / turn[0]])

    slopes, frequencies = jax.jit(lambda x: (jax.jacfwd(tip)(x), body.natural_frequencies()))(
        np.zeros(6)
    )
    compliance = np.asarray(slopes) / np.asarray(frequencies)
    y, z = (LENGTH / (x * EI) * np.array([LENGTH**2 / 3, LENGTH / 2, 1.0]) for x in (2, 1))
    wanted = np.diag([LENGTH / 1e3, y[0], z[0], LENGTH / 2.0, z[2], y[2]])
    wanted[1, 5] = wanted[5, 1] = y[1]
    wanted[2, 4] = wanted[4, 2] = -z[1]
    assert_close(compliance @ compliance.T, wanted, IDENTITY, np.max(wanted))


@pytest.mark.instant
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"EI": None}, "'beam': bending modes need EI"),
        ({"torsion": 1}, "'beam': torsion modes need GJ"),
        ({"bending": (1, -2)}, "no numbers of modes"),
        ({"bending": 0, "stiffening": True}, "stiffening is for beams that bend"),
        ({"inertia": (POLAR, 0.01, 0.01)}, "less than that of a thin bar"),
        ({"inertia": (POLAR, 1.0, 2.0)}, "largest must not exceed"),
        ({"damping": (0.1, 0.2)}, r"damping has shape \(2,\)"),
        ({"EI": -1.0}, "EI is .*must be positive"),
        ({"points": {"end": (0, 0, 0)}}, "a point is named 'end'"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_impossible_beams_are_refused(change, words):
    with pytest.raises(rj.SceneError, match=words):
        beam(**change)


def test_fewer_modes_and_capped_ones():
    """With all modes a local basis changes nothing; a cap adds a constant mass to fast ones."""
    body = beam(bending=2, GJ=1.0, torsion=1, stiffening=True)
    q, v = 0.1 * np.random.default_rng(0).normal(size=(2, body.size))
    q[3] += 1.0
    kept = np.eye(5)[:, [0, 3]]
    expand = np.zeros((9, 12))
    expand[np.arange(9), [*range(7), 7, 10]] = 1.0

    @jax.jit
    def of(q, v):
        frequencies = body.natural_frequencies()
        capped = CappedBody(body, frequencies[1] / (2 * np.pi))
        few, z, w = ReducedBody(body, jnp.asarray(kept)), expand @ q, expand @ v
        return (
            (body.mass_matrix(q), body.quadratic_velocity_force(q, v)),
            (capped.mass_matrix(q), capped.quadratic_velocity_force(q, v)),
            (
                few.mass_matrix(z),
                few.quadratic_velocity_force(z, w),
                few.inverse_mass(z).apply(few.mass_matrix(z)),
            ),
            (
                body.mass_matrix(expand.T @ z),
                body.quadratic_velocity_force(expand.T @ z, expand.T @ w),
            ),
            (frequencies, capped.natural_frequencies()),
        )

    found = jax.tree.map(np.asarray, of(q, v))
    (mass, force), (heavy, same), (small, pulled, one), (wide, whole), (own, low) = found
    ratio = (own / own[1]) ** 2
    added = np.diag(np.concatenate([np.zeros(7), np.maximum(ratio - 1, 0)]))
    assert_close(heavy - mass, added, IDENTITY, np.max(np.abs(heavy)))
    assert_close(same, force, 0.0)
    assert_close(small, expand @ wide @ expand.T, IDENTITY, np.max(np.abs(small)))
    assert_close(pulled, expand @ whole, IDENTITY, np.max(np.abs(whole)))
    assert_close(one, np.eye(9), 100 * IDENTITY)
    assert np.all(low <= own[1] * (1 + IDENTITY))


def arm(effects=()):
    """Two stiffened beams on hinges that are not parallel."""
    size = {"bending": 2, "GJ": 1.0, "torsion": 1, "stiffening": True}
    first, second = (
        dataclasses.replace(beam(**size, position=(x, 0.0, 0.0)), name=name)
        for name, x in (("first", LENGTH / 2), ("second", 1.5 * LENGTH))
    )
    up, aslant = (0.0, 1.0, 0.0), (0.0, 1.0, 1.0)
    joints = [
        spatial.Revolute(first.at("start", axis=up), rj.ground.at((0.0, 0.0, 0.0), axis=up)),
        spatial.Revolute(second.at("start", axis=aslant), first.at("end", axis=aslant)),
    ]
    return rj.assemble(rj.Scene([first, second], joints, effects))


@pytest.mark.slow
def test_an_arm_that_falls_keeps_its_energy():
    system = arm([rj.Gravity((0.0, 0.0, -9.81))])
    run = zoo.run(system, np.linspace(0.0, 0.2, 5), atol=1e-12, audit=True)
    energy = rj.energy(system, run)
    assert_close(energy.balance, np.zeros(5), SOLVED, np.max(energy.kinetic))
    assert np.max(energy.elastic) > 1e-3 * np.max(energy.kinetic)


def test_jacobian_of_stiffened_beams():
    """Joints see bending, turns of sections and foreshortening: C_q is the derivative of C."""
    system = arm()
    q = np.asarray(system.q0) + 0.1 * np.random.default_rng(1).normal(size=system.n)

    @jax.jit
    def both(q):
        slopes = dynamics.jacobian(system, 0.0, q), jax.jacfwd(system.constraint, 1)(0.0, q)
        return *slopes, system.constraint(0.0, q)

    found, wanted, _ = both(q)
    assert np.max(np.abs(both(system.q0)[2])) <= IDENTITY
    assert_close(found, wanted, 10 * IDENTITY, np.max(np.abs(wanted)))


@pytest.mark.parametrize(
    ("section", "turned"),
    [
        (rj.sections.Rectangle(0.02, 0.03), rj.sections.Rectangle(0.03, 0.02)),
        (rj.sections.Box(0.02, 0.03, 0.002), rj.sections.Box(0.03, 0.02, 0.002)),
        (rj.sections.Rod(0.02), rj.sections.Rod(0.02)),
        (rj.sections.Tube(0.02, 0.003), rj.sections.Tube(0.02, 0.003)),
    ],
    ids=lambda value: type(value).__name__,
)
def test_sections_that_are_turned(section, turned):
    """A quarter turn swaps the second moments and leaves torsion as it is."""
    assert_close(section.second_moment_y, turned.second_moment, IDENTITY, turned.second_moment)
    assert_close(
        section.torsion_constant, turned.torsion_constant, IDENTITY, turned.torsion_constant
    )


def test_torsion_constants():
    """Of a square 0.1406 a⁴ (Timoshenko and Goodier, section 109), of a strip b t³ / 3 less
    0.21 t⁴; of a thin ring what Bredt says; of an I two flanges and a web.
    """
    assert_close(rj.sections.Rectangle(1.0, 1.0).torsion_constant, 0.140577, 1e-6)
    strip = rj.sections.Rectangle(20.0, 1.0).torsion_constant
    assert_close(strip, (20 - 0.63025) / 3, 1e-5, strip)
    ring = rj.sections.Tube(1.0, 1e-4).torsion_constant
    assert_close(ring, np.pi * 1e-4 / 4, 1e-3, ring)
    profile = rj.sections.IProfile(0.02, 0.03, flange=0.004, web=0.003)
    assert_close(profile.torsion_constant, (0.04 * 0.004**3 + 0.022 * 0.003**3) / 3, IDENTITY)
    own = (2 * 0.004 * 0.02**3 + 0.022 * 0.003**3) / 12
    assert_close(profile.second_moment_y, own, IDENTITY)


def test_a_section_by_its_numbers():
    section = rj.sections.Section(A=2e-4, I_y=3e-9, I_z=4e-9, J=1e-9)
    material = {"density": 7800.0, "modulus": 2e11}
    body = spatial.Beam.of_section(
        "beam", 0.5, section, **material, shear_modulus=8e10, bending=1, torsion=1, extension=1
    )
    assert_close(body.EI, [600.0, 800.0], IDENTITY, 800.0)
    assert_close(body.GJ, 80.0, IDENTITY, 80.0)
    assert_close(body.EA, 4e7, IDENTITY, 4e7)
    thin = 7800 * 0.5 * (2e-4 * 0.5**2 / 12 + np.array([3e-9, 4e-9]))
    assert_close(body.inertia, [7800 * 0.5 * 7e-9, *thin], IDENTITY, thin[0])
    with pytest.raises(rj.SceneError, match="torsion needs the shear_modulus"):
        spatial.Beam.of_section("beam", 0.5, section, **material, torsion=1)


@pytest.mark.instant
def test_a_section_of_the_plane_is_refused():
    class Own(rj.sections.AbstractSection):
        area = second_moment = 1.0

    with pytest.raises(rj.SceneError, match="'Own' has no second_moment_y; beams in space need it"):
        spatial.Beam.of_section("beam", 0.5, Own(), density=1.0, modulus=1.0)
