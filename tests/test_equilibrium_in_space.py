"""Equilibria in space, where no force holds the length of a quaternion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from at_rest import both_slopes
from comparison import assert_close
from spatial_beams import marker
from verification_problems.rest import hinged_bar, pushed_bob
from zoo import GRAVITY

import romjax as rj
from romjax import spatial

# Required: relative to the displacement.
EXACT = 1e-9
ORIGIN, Y = (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
STEEL = 2.1e11  # [Pa]


def bar(*numbers) -> rj.AbstractSystem:
    """A bar on a hinge about y with a torsion spring, pushed down at its end."""
    return rj.assemble(hinged_bar(*numbers))


def angle(q):
    return 2 * jnp.arctan2(q[5], q[3])


@pytest.mark.slow
def test_a_pendulum_that_is_pushed():
    """Tan φ = F / m g, by turning and not by the length of the quaternion."""
    q = np.asarray(rj.equilibrium(rj.assemble(pushed_bob())))
    line = np.array([7.0, 0.0, -2.0 * GRAVITY])
    assert_close(q[:3], line / np.linalg.norm(line), EXACT)
    turn = np.arctan2(7.0, 2.0 * GRAVITY) / 2
    assert_close(q[3:], [np.cos(turn), 0.0, -np.sin(turn), 0.0], EXACT)


@pytest.mark.slow
@pytest.mark.parametrize("push", [1e-3, 4.448, 200.0])
def test_a_bar_on_a_hinge(push):
    """Its spring holds it, k φ = F l cos φ."""
    q = np.asarray(rj.equilibrium(bar(push)))
    turned = float(angle(q))
    assert_close(50.0 * turned, push * np.cos(turned), EXACT, scale=push)
    assert_close(q[3:7] @ q[3:7], 1.0, EXACT)


@pytest.mark.slow
def test_lengths_of_a_start_stay():
    """Of a start with another one, in which all else is the same."""
    system = bar(4.448)
    q = np.asarray(rj.equilibrium(system))
    sizes = np.repeat([1.0, 3.0, 1.0], [3, 4, 1])
    assert_close(rj.equilibrium(system, sizes * np.asarray(system.q0)), sizes * q, EXACT)


@jax.jit
@jax.vmap
def angle_and_slopes(stiffness):
    return both_slopes(lambda stiffness: angle(rj.equilibrium(bar(20.0, stiffness))), stiffness)


@pytest.mark.slow
def test_its_slope():
    """dφ/dk = −φ / (k + F l sin φ), forwards and backwards, in a batch."""
    stiffness = np.array([50.0, 80.0])
    turned, forward, backward = (np.asarray(x) for x in angle_and_slopes(stiffness))
    wanted = -turned / (stiffness + 20.0 * np.sin(turned))
    assert_close(forward, wanted, EXACT)
    assert_close(backward, wanted, EXACT)


def rods(diameter, turning=1.0) -> rj.AbstractSystem:
    """Two steel rods of 0.5 m that are welded to one cantilever and pushed across so that its tip
    moves by 10 mm; their moments of inertia about the axis are `turning` times as large as they
    are.
    """
    section, size = rj.sections.Rod(diameter), 0.5
    EI, mass = STEEL * section.second_moment, 7850.0 * section.area * size
    polar, thin = turning * mass * diameter**2 / 8, mass * size**2 / 12
    inertia = (polar, thin + polar / 2, thin + polar / 2)
    first, second = (
        spatial.Beam(
            f"rod{i}", mass, size, inertia, EI=EI, bending=2, position=((i + 0.5) * size, 0, 0)
        )
        for i in range(2)
    )
    welds = [
        spatial.Weld(first.at("start"), rj.ground.at(ORIGIN)),
        spatial.Weld(second.at("start"), first.at("end")),
    ]
    push = rj.Force(second.at("end"), Y, rj.Constant(0.01 * 3 * EI))
    return rj.assemble(rj.Scene([first, second], welds, [push]))


@pytest.mark.slow
def test_steel_rods():
    """Of any thickness they bend alike, and the tip moves by F L³ / 3 E I but for what two modes
    miss of a force at an end.
    """
    thick, thin = (
        np.asarray(rj.equilibrium(rods(diameter))).reshape(2, 11) for diameter in (0.04, 0.005)
    )
    assert_close(thin[:, :7], thick[:, :7], EXACT)
    last = rods(0.04).bodies[0].bodies
    last = jax.tree.map(lambda x: x[1], last)
    tip, _ = marker(last, thick[1], (0.25, 0.0, 0.0))
    assert_close(tip[1], 0.01, 0.01, scale=0.01)


@pytest.mark.slow
def test_no_inertia_counts():
    """Ten orders of magnitude of moments of inertia, one equilibrium."""
    few, some, many = (
        np.asarray(rj.equilibrium(rods(0.02, turning))) for turning in (1e-5, 1.0, 1e5)
    )
    assert_close(few, some, EXACT, scale=0.01)
    assert_close(many, some, EXACT, scale=0.01)
