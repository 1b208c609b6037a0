"""Reduced models of mechanisms with prescribed motions: what a drive does is no violation."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from mechanisms import Moving, ends
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax.assembly.outlines import outlines
from romjax.reduction.charts import choose

# Required: of the full basis, which is the full model; of the rank for a tolerance, on the training
# run and at a drive that is a tenth faster.
FULL, TOL, FASTER = 1e-7, 1e-4, 3e-4
# Steps of the slider crank for one of its reduced model.
FEWER = 15
# Of models without freedom: steps, and errors of what depends on speeds and accelerations.
AT_ONCE, WITH_RATES = 10, 10 * SOLVED
GALLERY = rj.gallery
# By name, how each is made at times the speed of its drive, and the end of its run [s].
DRIVEN = {
    "four-bar": (lambda k: GALLERY.four_bar(duration=3.0 / k), 2.7),
    "bending four-bar": (lambda k: zoo.bending_four_bar(speed=10.0 * k), 1.0),
    "slider crank": (lambda k: GALLERY.slider_crank(speed=150.0 * k), 0.1),
    "vehicle axle": (lambda k: GALLERY.vehicle_axle(duration=0.12 / k), 2.0),
    "spatial slider crank": (lambda k: zoo.driven_loop_in_space(speed=6.0 * k), 0.5),
}


@functools.cache
def case(name, faster=1.0):
    """The system, and its run at times the speed of its drive."""
    make, end = DRIVEN[name]
    system = rj.assemble(make(faster))
    return system, zoo.run(system, np.linspace(0.0, end, 201))


def error(rom, name, faster=1.0):
    """Of a model against the full one with the same drive."""
    system, truth = case(name, faster)
    other = rom.with_full(system).starting_at(truth.q[0], truth.v[0])
    return rj.compare(truth, zoo.run(other, truth.t)).error


@pytest.mark.parametrize("decompose", [rj.pod, rj.sod])
def test_all_directions_of_a_driven_four_bar(decompose):
    """A mechanism without freedom, and the same with a faster drive."""
    system, truth = case("four-bar")
    rom = rj.reduce(system, decompose(truth))
    assert rom.n == rom.m
    assert error(rom, "four-bar") <= FULL
    assert error(rom, "four-bar", 1.1) <= FULL


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["minimal", "table"])
def test_without_freedom_a_model_is_kinematics(formulation):
    """Positions, speeds and the torque of the drive, of another drive too, in hardly a step."""
    system, truth = case("four-bar")
    rom = rj.reduce(system, rj.pod(truth), formulation)
    other, moved = case("four-bar", 1.1)
    for full, wanted in ((system, truth), (other, moved)):
        model = rom.with_full(full).starting_at(wanted.q[0], wanted.v[0])
        found = zoo.run(model, wanted.t)
        assert found.q.shape == wanted.q.shape
        assert found.stats.num_accepted_steps <= AT_ONCE
        assert_close(found.q, wanted.q, SOLVED, scale=np.ptp(wanted.q))
        assert_close(found.v, wanted.v, WITH_RATES, scale=np.ptp(wanted.v))
        torque, right = (
            rj.joint_forces(one, run)["drive"].torque
            for one, run in ((model, found), (full, wanted))
        )
        assert_close(torque, right, WITH_RATES, scale=np.ptp(right))


@pytest.mark.slow
def test_a_refusal_names_no_model_without_coordinates():
    """The mechanism has no freedom, so that `Minimal` would make one of none."""
    system, truth = case("four-bar")
    words = "frees the mechanism.*take more modes.*No other formulation makes a model of it"
    with pytest.raises(rj.ReductionError, match=words):
        rj.reduce(system, rj.pod(truth, rank=2))


@pytest.mark.slow
def test_without_freedom_beyond_its_snapshots():
    """Twice as long as the training: right, or told of."""
    system, truth = case("four-bar")
    rom = rj.reduce(system, rj.pod(truth), "minimal")
    run = zoo.run(rom, np.linspace(0.0, 2 * DRIVEN["four-bar"][1], 201), throw=False)
    assert not run.is_valid


# A drive that ends, one in a force, and one in space.
SLOW = ("vehicle axle", "spatial slider crank")


@pytest.mark.parametrize(
    "name", in_groups([name for name in DRIVEN if name != "four-bar"], slow=SLOW[:1])
)
def test_all_directions(name):
    system, truth = case(name)
    for decompose in (rj.pod, rj.sod):
        assert error(rj.reduce(system, decompose(truth)), name) <= FULL


@pytest.mark.parametrize("name", in_groups(DRIVEN, slow=("slider crank", *SLOW)))
def test_the_rank_for_a_tolerance_holds_at_another_speed(name):
    system, truth = case(name)
    rom = rj.reduce_to(system, truth, TOL)
    assert error(rom, name) <= TOL
    assert error(rom, name, 1.1) <= FASTER
    if name == "slider crank":
        # Of the methods that are taken by themselves. At 1e-6 it is 6 times.
        full, few = (rj.simulate(model, truth.t, rtol=1e-8, audit=False) for model in (system, rom))
        assert full.stats.num_accepted_steps >= FEWER * few.stats.num_accepted_steps


SWING, LENGTH = 0.8, 1.0  # of the arm that is swung, and of both bars


@functools.cache
def swung():
    """The scene of a bar that hangs on one which a drive swings, its system, and its model."""
    scene = zoo.bars(angles=(0.0, -1.2), spins=(SWING * np.pi, 0.0))
    drive = rj.PrescribedAngle(scene.bodies[0].at(), rj.ground.at(), rj.Sine(SWING, 0.5))
    system = rj.assemble(rj.Scene(scene.bodies, [*scene.joints, drive], scene.effects))
    truth = zoo.run(system, np.linspace(0.0, 1.0, 51))
    basis = rj.Minimal().basis(system, truth, rj.POD(1))
    return scene, system, rj.reduce(system, basis, "minimal")


@pytest.mark.slow
def test_at_rest_a_drive_stands():
    """Statics and small motions about rest know neither its speed nor its acceleration, in minimal
    coordinates, which follow it by themselves, as little as in those of the bodies.
    """
    late = 0.7
    scene, system, rom = swung()
    angle = SWING * np.sin(np.pi * late)
    hanging = LENGTH * np.array([np.cos(angle), np.sin(angle) - 1.0])
    for model in (system, rom):
        q = rj.equilibrium(model, t=late)
        tip = rj.measure(model, q, ends(scene.bodies[1])[1], t=late)
        assert_close(tip.position, hanging, SOLVED)
        assert_close(tip.velocity, np.zeros(2), IDENTITY)
        found = rj.modes(model, q, t=late)
        assert_close(found.frequencies, [np.sqrt(1.5 * zoo.GRAVITY / LENGTH)], SOLVED)
        # They are drawn where the drive stands then, which the mode does not move.
        turned = np.array([0.5 * np.cos(angle), 0.5 * np.sin(angle), angle, *np.zeros(3)])
        (there,) = (o for o in outlines(scene, 0.0, turned[None]) if o.part == "bar1")
        for arm in (o for o in rj.animate(model, found).models[0].actual if o.part == "bar1"):
            assert_close(arm.points, np.tile(there.points, (len(arm.points), 1, 1)), SOLVED)
        linear = rj.linearize(model, {}, [], at=q, t=late)
        assert_close(np.linalg.eigvals(linear.A).imag.max(), found.frequencies[0], SOLVED)

    def height(t):
        return rj.measure(
            system, rj.equilibrium(system, t=t), ends(scene.bodies[1])[1], t=t
        ).position[1]

    rate = SWING * np.pi * np.cos(np.pi * late)
    assert_close(jax.jit(jax.grad(height))(late), LENGTH * np.cos(angle) * rate, SOLVED)


@pytest.mark.slow
def test_at_rest_what_moves_by_its_own_law_stands():
    """A joint without a signal and constraints of one's own, which drag something by a damper."""
    late = 0.5
    bar = rj.RigidBody("bar", 1.0, 0.1, position=(0.0, -0.5), velocity=(0.4, 0.0))
    hinge = Moving(bar.at((0.0, 0.5)), rj.ground.at(), 0.4)
    drag = rj.Damper(bar.at((0.0, -0.5)), rj.ground.at(), 3.0)
    hanging = rj.assemble(rj.Scene([bar], [hinge], [rj.Gravity(), drag]))
    followed = rj.CustomSystem(
        lambda q: jnp.eye(2),
        lambda t, q, v: (q[0] - q[1] + 3.0 * (v[0] - v[1])) * jnp.array([-1.0, 1.0]),
        lambda t, q: jnp.sin(t)[None] - q[:1],
        q0=[0.0, 0.0],
        v0=[1.0, 0.0],
    )
    for system, rest in ((hanging, [0.4 * late, -0.5, 0.0]), (followed, [np.sin(late)] * 2)):
        truth = rj.simulate(system, np.linspace(0.0, 1.0, 51), audit=False)
        rom = rj.reduce(system, rj.Minimal().basis(system, truth, rj.POD(1)), "minimal")
        for model in (system, rom):
            q = rj.equilibrium(model, t=late)
            still = model.state(late, q, jnp.zeros_like(q))
            assert_close(still.q, rest, SOLVED)
            assert_close(rj.modes(model, q, t=late).at, q, IDENTITY)


@pytest.mark.slow
def test_modes_of_ones_own_do_not_hide_a_drive():
    """They show no motion of it: the constraints hold all the same, wherever it is."""
    _, system, _ = swung()
    turn = np.zeros((6, 1))
    turn[3:, 0] = 0.5 * LENGTH * np.sin(1.2), 0.5 * LENGTH * np.cos(1.2), 1.0
    rom = rj.reduce(system, rj.Basis.from_modes(turn, system.q0), "minimal")
    run = zoo.run(rom, np.linspace(0.0, 1.0, 11))
    assert run.violation.max() <= SOLVED
    assert rj.compare(zoo.run(system, run.t), run).error <= SOLVED


class Late(rj.AbstractSignal):
    """A turn that begins after a while, of a kind that does not say when."""

    start: jax.Array

    def __call__(self, t):
        return 0.5 * jnp.clip(t - self.start, 0.0, 1.0) ** 3


@pytest.mark.parametrize("signal", [rj.Step(SWING, 1e3, 1.0), Late(jnp.array(1e3))])
def test_a_drive_may_begin_after_any_while(signal):
    """Modes of one's own show no motion of it: what it moves is not held for that."""
    scene = zoo.bars(angles=(0.0, -1.2))
    drive = rj.PrescribedAngle(scene.bodies[0].at(), rj.ground.at(), signal)
    system = rj.assemble(rj.Scene(scene.bodies, [*scene.joints, drive], scene.effects))
    turn = np.zeros((6, 1))
    turn[3:, 0] = 0.5 * LENGTH * np.sin(1.2), 0.5 * LENGTH * np.cos(1.2), 1.0
    rom = rj.reduce(system, rj.Basis.from_modes(turn, system.q0), "minimal")
    q, violation = configuration(rom, 1e3 + 0.7)
    assert q[2] > 0.1
    assert_close(violation, np.zeros(system.m), IDENTITY)


class Growing(rj.AbstractSignal):
    """A turn that overflows after some days."""

    rate: jax.Array

    def __call__(self, t):
        return 0.1 * jnp.expm1(self.rate * t)


def test_a_drive_that_overflows_moves_no_more_than_its_own_bodies():
    def driven(signal):
        scene = zoo.bars(angles=(0.0, -1.2))
        drive = rj.PrescribedAngle(scene.bodies[0].at(), rj.ground.at(), signal)
        held = rj.RigidBody("held", 1.0, 0.1)
        weld = rj.Weld(held.at(), rj.ground.at())
        scene = rj.Scene([*scene.bodies, held], [*scene.joints, drive, weld], scene.effects)
        system = rj.assemble(scene)
        return choose._driven(system, jnp.zeros(1), system.q0[None])

    moved = driven(Growing(jnp.array(0.01)))
    np.testing.assert_array_equal(moved, driven(rj.Step(SWING, 1e3, 1.0)))
    assert not np.any(moved[-3:])


@eqx.filter_jit
def configuration(rom, t):
    """The physical coordinates of the start's reduced ones at a time, and the constraints there."""
    q, _ = rom.reconstruct(t, rom.q0, rom.v0)
    return q, rom.full.constraint(t, q)


@pytest.mark.slow
def test_a_run_that_begins_later_is_judged_from_its_own_start():
    """The drive has left the place where the full system starts."""
    _, _, rom = swung()
    run = zoo.run(rom, np.linspace(0.3, 0.8, 26))
    richer = rj.corrected(rom, run)
    assert richer.success
    assert rj.compare(richer, run).error <= SOLVED


@pytest.mark.slow
def test_an_impact_against_what_a_drive_moves():
    """The energy that the drive gives in it is in the balance, in minimal coordinates too."""
    scene, system, rom = swung()
    end = ends(scene.bodies[1])[1]
    wall = rj.Impact(rj.quantity.Travel(end, rj.ground.at((0.8, 0.0))), restitution=0.7)
    truth, run = (
        rj.simulate(model, np.linspace(0.0, 1.0, 51), rtol=zoo.TIGHT, events=[wall])
        for model in (system, rom)
    )
    assert len(truth.events.times(0)) == 1
    assert not run.warnings()
    assert rj.compare(truth, run).error <= SOLVED
