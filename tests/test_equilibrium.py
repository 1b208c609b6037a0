"""Static equilibria against closed forms."""

import jax
import numpy as np
import pytest
import zoo
from at_rest import both_slopes, hung_twice
from comparison import assert_close
from programs import kept
from verification_problems.rest import on_springs
from zoo import GRAVITY

import romjax as rj
from romjax.scene.body.modes import bending_roots, bending_shapes

# Required: of displacements in metres and of slopes.
EXACT = 1e-9
MASS, STIFFNESS = 2.0, 50.0
SPEED = 3.0  # of a drive [rad/s]


def hung(stiffness=STIFFNESS, load=0.0) -> rj.AbstractSystem:
    """A mass below a spring without length, with a force across, beside a spring that is none."""
    springs = [((0.0, 1.0), stiffness, 0.0), ((1.0, 0.5), 0.0, 0.0)]
    return rj.assemble(on_springs(0.0, MASS, springs, (1.0, 0.0), load, GRAVITY))


def test_a_mass_on_a_spring():
    """Its angle is free, and stays as it is."""
    system = hung(load=3.0)
    q = rj.equilibrium(system, [0.0, 0.0, 0.4])
    assert_close(q, [3.0 / STIFFNESS, 1.0 - MASS * GRAVITY / STIFFNESS, 0.4], EXACT)


@kept
@jax.vmap
def height_and_slopes(stiffness):
    return both_slopes(lambda stiffness: rj.equilibrium(hung(stiffness))[1], stiffness)


def test_its_slope():
    """dy/dk = m g / k², forwards and backwards, in a batch."""
    stiffness = np.array([STIFFNESS, 80.0])
    height, forward, backward = height_and_slopes(stiffness)
    assert_close(height, 1 - MASS * GRAVITY / stiffness, EXACT)
    assert_close(forward, MASS * GRAVITY / stiffness**2, EXACT)
    assert_close(backward, MASS * GRAVITY / stiffness**2, EXACT)


@pytest.mark.parametrize(("start", "is_stable"), [(-0.6, True), (0.8, False)])
def test_stable_and_unstable(start, is_stable):
    """The equilibrium above is found from a start near it, and is no stable one; with a hinge that
    is made twice.
    """
    up = np.sign(start)
    system = hung_twice((MASS, 1.0), (up * np.pi / 2 - 0.1, up * np.pi / 2 + 0.15))
    q = rj.equilibrium(system)
    assert_close(q, [0.0, 0.5 * up, up * np.pi / 2, 0.0, 1.5 * up, up * np.pi / 2], EXACT)
    assert bool(rj.modes(system, q).is_stable) == is_stable


def test_a_loaded_beam():
    """In modal coordinates K q = Sᵀ F, of a free beam whose ends are pulled up and whose middle is
    pulled down; its place is neutral, and stays.
    """
    beam = rj.Beam("beam", 1.0, 1.0, EI=40.0, modes=3, shapes="free-free", position=(0.5, 0.2))
    places, pulls = np.array([-0.5, 0.0, 0.5]), np.array([3.0, -6.0, 3.0])
    loads = [
        rj.Force(beam.at((x, 0.0)), (0.0, 1.0), rj.Constant(pull))
        for x, pull in zip(places, pulls, strict=True)
    ]
    q = rj.equilibrium(rj.assemble(rj.Scene([beam], [], loads)))
    shapes = bending_shapes("free-free", 3, places[:, None] + 0.5, np)[0]
    bent = pulls @ shapes / (40.0 * bending_roots("free-free", 3) ** 4)
    assert_close(q, [0.5, 0.2, 0.0, *bent], EXACT)


def car(gap=0.0) -> rj.AbstractSystem:
    """The half of a car whose tyres are contacts on the road, `gap` above where they touch it."""
    up, tyre = np.pi / 2, 2e6
    body = rj.RigidBody("body", 600.0, 800.0, position=(0.0, 1.0 + gap))
    bodies, effects = [body], [rj.Gravity((0.0, -GRAVITY))]
    joints = [rj.PointOnLine(body.at(), rj.ground.at(angle=up))]
    for name, x in (("front", 1.2), ("rear", -1.4)):
        wheel = rj.RigidBody(name, 40.0, 1.0, position=(x, 0.3 + gap))
        bodies.append(wheel)
        joints.append(rj.Prismatic(wheel.at(angle=up), rj.ground.at((x, 0.0), angle=up)))
        leg = rj.Spring(body.at((x, -0.2)), wheel.at(), stiffness=2e4, rest_length=0.65)
        touch = rj.Contact(wheel.at((0.0, -0.3)), rj.ground.at(), rj.Line(), stiffness=tyre)
        effects += [leg, touch]
    return rj.assemble(rj.Scene(bodies, joints, effects))


@pytest.mark.parametrize("gap", [0.0, 0.003, -0.003])
def test_tyres_that_just_touch(gap):
    """Where no contact is stiff yet, an equilibrium near the start is found, not a car on its
    roof.
    """
    system = car(gap)
    q = np.asarray(rj.equilibrium(system))
    assert np.max(np.abs(q - np.asarray(system.q0))) < 0.03
    assert_close(2e6 * np.sum((0.3 - q[[4, 7]]) ** 1.5) / (680.0 * GRAVITY), 1.0, EXACT)


def test_no_equilibrium_is_told():
    springs = [((x, 1.0), 0.0, 0.0) for x in (-1.0, 1.0)]
    falling = on_springs(0.0, 1.0, springs, (1.0, 0.0), 0.0, GRAVITY)
    falling = rj.assemble(falling)
    with pytest.raises(rj.SimulationError, match=r"followed to 0 of the load.*mass\.y.*by 9\.81"):
        rj.equilibrium(falling)


@pytest.mark.slow
def test_single_precision_is_named_where_it_may_be_the_cause():
    with (
        jax.enable_x64(False),
        pytest.raises(rj.SimulationError, match="In single precision.*jax_enable_x64"),
    ):
        rj.equilibrium(rj.assemble(rj.Scene([rj.RigidBody("ball", 1.0, 1.0)], [], [rj.Gravity()])))


def driven_bars() -> rj.AbstractSystem:
    """Two level bars, of which the first is turned from where it is; the weight of the second has
    no stiffness there.
    """
    scene = zoo.bars(spins=(SPEED, SPEED))
    drive = rj.PrescribedAngle(scene.bodies[0].at(), rj.ground.at(), rj.Ramp(SPEED))
    return rj.assemble(rj.Scene(scene.bodies, [*scene.joints, drive], scene.effects))


@pytest.mark.parametrize("t", [0.5, 20.0])
def test_a_drive_that_has_gone_far(t):
    """The second bar hangs or stands at the end of the first, after some turns of that, too."""
    system = driven_bars()
    q = np.asarray(rj.equilibrium(system, t=t))
    assert_close(q[2], SPEED * t, EXACT)
    assert_close(np.abs(q[5]), 0.5 * np.pi, EXACT)
    assert_close(q[3:5], [np.cos(SPEED * t), np.sin(SPEED * t) + 0.5 * np.sign(q[5])], EXACT)
    # A rod of length l swings by √(3 g / 2 l).
    assert_close(rj.modes(system, q, t=t).frequencies, [np.sqrt(1.5 * GRAVITY)], EXACT)


@pytest.mark.parametrize("wrong", ["a", None, [1.0, 2.0], np.nan])
def test_a_time_that_is_none(wrong):
    system = zoo.system(zoo.bars)
    verbs = [
        lambda t: rj.equilibrium(system, t=t),
        lambda t: rj.modes(system, t=t),
        lambda t: rj.linearize(system, {}, [], t=t),
        lambda t: rj.consistent(system, t=t),
    ]
    for verb in verbs:
        with pytest.raises(rj.InputError, match=r": t (is|has)"):
            verb(wrong)
    if wrong is not None:
        with pytest.raises(rj.InputError, match=r"measure: t (is|has)"):
            rj.measure(system, system.q0, rj.ground.at(), t=wrong)
