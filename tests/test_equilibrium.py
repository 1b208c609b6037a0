"""Static equilibria against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from mechanisms import bar, ends
from zoo import GRAVITY

import romjax as rj

# Required: of displacements in metres and of slopes.
EXACT = 1e-9
MASS, STIFFNESS = 2.0, 50.0


def hung(stiffness=STIFFNESS, load=0.0) -> rj.AbstractSystem:
    """A mass on two springs, one above it and one beside it, with a force across."""
    mass = rj.RigidBody("mass", MASS, 0.1)
    scene = rj.Scene(
        [mass],
        [],
        [
            rj.Gravity(),
            rj.Spring(mass.at(), rj.ground.at((0.0, 1.0)), stiffness),
            rj.Force(mass.at(), (1.0, 0.0), rj.Constant(load)),
        ],
    )
    return rj.assemble(scene)


def test_a_mass_on_a_spring():
    """Its angle is free, and stays as it is."""
    system = hung(load=3.0)
    q = rj.equilibrium(system, system.q0.at[2].set(0.4))
    assert_close(q, [3.0 / STIFFNESS, 1.0 - MASS * GRAVITY / STIFFNESS, 0.4], EXACT)


def test_its_slope():
    """dy/dk = m g / k², forwards and backwards, and a batch."""

    def height(stiffness):
        return rj.equilibrium(hung(stiffness))[1]

    assert_close(jax.jit(jax.grad(height))(STIFFNESS), MASS * GRAVITY / STIFFNESS**2, EXACT)
    assert_close(jax.jit(jax.jacfwd(height))(STIFFNESS), MASS * GRAVITY / STIFFNESS**2, EXACT)
    found = jax.jit(jax.vmap(height))(jnp.array([50.0, 80.0]))
    assert_close(found, 1 - MASS * GRAVITY / np.array([50.0, 80.0]), EXACT)


def pendulum(twice=False) -> rj.AbstractSystem:
    body = rj.RigidBody("bar", MASS, 0.1, position=(0.5, 0.0))
    hinge = rj.Revolute(body.at((-0.5, 0.0)), rj.ground.at())
    return rj.assemble(rj.Scene([body], [hinge] * (1 + twice), [rj.Gravity()]))


@pytest.mark.parametrize("twice", [False, True], ids=["once", "twice"])
@pytest.mark.parametrize(("start", "is_stable"), [(-0.6, True), (0.8, False)])
def test_stable_and_unstable(twice, start, is_stable):
    """The equilibrium above is found from a start near it, and is no stable one."""
    system = pendulum(twice)
    angle = np.sign(start) * (np.pi / 2 - 0.1)
    q0 = np.array([0.5 * np.cos(angle), 0.5 * np.sin(angle), angle])
    q = rj.equilibrium(system, q0)
    assert_close(q, [0.0, 0.5 * np.sign(start), np.sign(start) * np.pi / 2], EXACT)
    assert bool(rj.modes(system, q).is_stable) == is_stable


def test_a_chain_between_two_points():
    """Bars of equal weight hang so that the horizontal force is the same in all of them, and the
    vertical one grows by a weight from bar to bar.
    """
    points = np.array([[0.0, 0.0], [0.6, -0.8], [1.6, -0.8], [2.2, 0.0]])
    names = ["first", "second", "third"]
    bars = [bar(n, points[i], points[i + 1], MASS) for i, n in enumerate(names)]
    markers = [ends(body) for body in bars]
    joints = [
        rj.Revolute(markers[0][0], rj.ground.at(points[0])),
        rj.Revolute(markers[1][0], markers[0][1]),
        rj.Revolute(markers[2][0], markers[1][1]),
        rj.Revolute(markers[2][1], rj.ground.at((2.4, 0.1))),
    ]
    system = rj.assemble(rj.Scene(bars, joints, [rj.Gravity()]))
    q0, _ = rj.consistent(system)
    angle = np.asarray(rj.equilibrium(system, q0)).reshape(3, 3)[:, 2]
    # Moments about the lower end of each bar: tan φ = (V + m g / 2) / H, with V from bar to bar.
    slopes = np.tan(angle)
    assert_close(np.diff(slopes, 2), 0.0, EXACT)
    assert_close(np.sum(np.cos(angle)), 2.4, EXACT)
    assert_close(np.sum(np.sin(angle)), 0.1, EXACT)


def test_a_loaded_cantilever():
    """In modal coordinates K q = Sᵀ F."""
    beam = rj.Beam("beam", 1.0, 1.0, EI=40.0, modes=3, shapes="clamped-free", position=(0.5, 0))
    load = rj.Force(beam.at((0.5, 0.0)), (0.0, -1.0), rj.Constant(3.0))
    weld = rj.Weld(beam.at((-0.5, 0.0)), rj.ground.at())
    q = rj.equilibrium(rj.assemble(rj.Scene([beam], [weld], [load])))
    shapes = np.asarray(beam.mode_shapes(jnp.array([0.5, 0.0])))[1]
    assert_close(q[3:], -3.0 * shapes / np.asarray(beam.natural_frequencies()) ** 2, EXACT)


def truss(load) -> rj.AbstractSystem:
    """Two springs to a mass above them, which snaps through under a load."""
    mass = rj.RigidBody("mass", 1.0, 0.1, position=(0.0, 0.4))
    length = float(np.hypot(1.0, 0.4))
    springs = [
        rj.Spring(mass.at(), rj.ground.at((x, 0.0)), 1000.0, rest_length=length) for x in (-1, 1)
    ]
    down = rj.Force(mass.at(), (0.0, -1.0), rj.Constant(load))
    return rj.assemble(rj.Scene([mass], [], [*springs, down]))


def test_below_the_load_of_snapping():
    q = np.asarray(rj.equilibrium(truss(15.0)))
    stretched = np.hypot(1.0, q[1])
    pull = 2 * 1000.0 * (np.hypot(1.0, 0.4) - stretched) * q[1] / stretched
    assert_close(pull, 15.0, EXACT, scale=15.0)
    assert q[1] > 0.2


def test_beyond_the_load_of_snapping():
    """The springs pull up where the mass is below both ends."""
    q = np.asarray(rj.equilibrium(truss(40.0)))
    stretched = np.hypot(1.0, q[1])
    pull = 2 * 1000.0 * (np.hypot(1.0, 0.4) - stretched) * q[1] / stretched
    assert_close(pull, 40.0, EXACT, scale=40.0)
    assert q[1] < -0.4


def test_no_equilibrium_is_told():
    falling = rj.assemble(rj.Scene([rj.RigidBody("mass", 1.0, 0.1)], [], [rj.Gravity()]))
    with pytest.raises(rj.SimulationError, match=r"followed to 0 of the load.*mass\.y.*by 9\.81"):
        rj.equilibrium(falling)
