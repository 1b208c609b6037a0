"""What is asked of joint coordinates: the answers of the redundant system, or a refusal."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY, SOLVED

import romjax as rj

TS = np.linspace(0.0, 0.4, 21)
# Of velocities and event times, whose errors are those of places over the time of a step.
RATES = 1e-6
MOVING = {"turning": 3.0}


@functools.cache
def pair():
    """A crank, a rod and a slider on a spring in both coordinates; the last hinge is cut."""
    full = zoo.system(zoo.slider_crank, **MOVING)
    return rj.reduce(full, formulation="joint"), full


@functools.cache
def run():
    return zoo.run(pair()[0], TS)


def agree(answer, tol=SOLVED):
    """The answers to one question, of both systems."""
    own, other = (answer(system) for system in pair())
    assert_close(own, other, tol, scale=max(1.0, np.max(np.abs(other))))


@pytest.mark.slow
def test_forces_and_motions_along_a_run():
    """Of the tree's joints and of the cut one, with effects that act on them."""
    scene = zoo.slider_crank(**MOVING)
    for table in (rj.joint_forces, rj.effect_forces):
        agree(lambda system, table=table: [x.force for x in table(system, run()).values()])
    agree(lambda system: rj.joint_forces(system, run())["Prismatic(piston, ground)"].torque)
    agree(lambda system: rj.measure(system, run(), scene.bodies[1].at()).acceleration)
    reactions = rj.reactions(pair()[0], run())
    at_start = jax.jit(pair()[1].acceleration)(0.0, run().q[0], run().v[0])[1]
    assert_close(reactions[0], at_start, SOLVED, scale=np.max(np.abs(at_start)))
    heavier = jax.tree.map(lambda x: 1.1 * x, pair()[1])
    with pytest.raises(rj.InputError, match="reactions: the run is of a system.*other numbers"):
        rj.reactions(pair()[0].with_full(heavier), run())


@pytest.mark.slow
def test_joint_forces_of_a_beam_that_is_clamped_twice():
    """Balance of the frame alone leaves three of the six unknown."""
    beam = rj.Beam("beam", 1.0, 1.0, EI=20.0, modes=4, shapes="free-free")
    ends = [beam.at("start"), beam.at("end")]
    joints = [
        rj.Weld(end, rj.ground.at((x, 0.0))) for end, x in zip(ends, (-0.5, 0.5), strict=True)
    ]
    full = rj.assemble(rj.Scene([beam], joints, [rj.Gravity((2.0, -9.81))]))
    rom = rj.reduce(full, formulation="joint")
    moved = zoo.run(rom, np.linspace(0.0, 0.01, 3))
    given = rj.joint_forces(full, moved)
    for key, own in rj.joint_forces(rom, moved).items():
        assert_close(own.force, given[key].force, SOLVED, scale=10.0)
        assert_close(own.torque, given[key].torque, SOLVED, scale=10.0)


@pytest.mark.slow
def test_events_happen_when_they_do():
    """A passage, and an impact that all joints share, the cut one among them."""
    gap = rj.quantity.Coordinate("piston.x")
    level = float(run()["piston.x"][10])
    events = [rj.Crossing(gap, level + 0.02), rj.Impact(gap, restitution=0.5, level=level)]
    own, other = (zoo.run(system, TS, events=events) for system in pair())
    assert np.sum(np.asarray(other.events.happened)) >= 2
    assert np.array_equal(own.events.happened, other.events.happened)
    happened = np.any(np.asarray(own.events.happened), axis=1)
    for name in ("time", "q", "v_before", "v_after", "impulse"):
        each = [np.asarray(getattr(x.events, name))[happened] for x in (own, other)]
        assert_close(*each, RATES)
    assert_close(own.q, other.q, RATES)


@pytest.mark.slow
def test_small_motions_about_an_equilibrium():
    joint, full = pair()
    # From a place between dead centres, near which there is one equilibrium only.
    begin = np.asarray(run().q[-1])
    z = rj.equilibrium(joint, joint.restrict(begin, 0 * begin)[0])
    q = joint.reconstruct(0.0, z, 0 * z)[0]
    assert_close(jax.jit(full.acceleration)(0.0, q, 0 * q)[0], 0.0, SOLVED, scale=10.0)
    frequencies = [np.asarray(rj.modes(*x).frequencies) for x in ((joint, z), (full, q))]
    assert_close(*frequencies, SOLVED, scale=np.max(frequencies[1]))
    push = rj.Force(zoo.slider_crank().bodies[2].at(), (1.0, 0.0), rj.Constant(1.0))
    models = [
        rj.linearize(system, {"push": push}, ["piston.x", "crank.phi'"], at=at)
        for system, at in ((joint, z), (full, q))
    ]
    gains = [np.asarray(m.C @ jnp.linalg.solve(1j * jnp.eye(len(m.A)) - m.A, m.B)) for m in models]
    assert_close(*gains, SOLVED, scale=np.max(np.abs(gains[1])))


@pytest.mark.slow
def test_batches_and_derivatives():
    """By the speed of the start: forwards, backwards, and of two lanes at once."""
    joint = pair()[0]

    def end(system, share):
        return zoo.run(system, TS[:6], v0=share * system.v0).q[-1]

    shares = jnp.array([1.0, 0.9])
    lanes = [jax.jit(jax.vmap(functools.partial(end, system)))(shares) for system in pair()]
    assert_close(*lanes, RATES)
    back = [jax.grad(lambda s, x=x: jnp.sum(end(x, s) ** 2))(1.0) for x in pair()]
    assert_close(*back, RATES, scale=abs(float(back[1])))
    with rj.forward_mode():
        ahead = jax.jvp(lambda s: jnp.sum(end(joint, s) ** 2), (1.0,), (1.0,))[1]
    assert_close(ahead, back[1], RATES, scale=abs(float(back[1])))


@pytest.mark.slow
def test_a_file_has_the_run(tmp_path):
    run().save(tmp_path / "run.npz")
    again = rj.load(tmp_path / "run.npz")
    assert_close(again.q, run().q, IDENTITY)
    assert again.labels == pair()[1].structure.labels


def test_what_joint_coordinates_do_not_keep_is_refused():
    """Constraints of velocities."""
    scene = zoo.bars()
    skate = rj.KnifeEdge(scene.bodies[1].at(), rj.ground.at())
    system = rj.assemble(rj.Scene(scene.bodies, (*scene.joints, skate), scene.effects))
    with pytest.raises(rj.ReductionError, match="holds velocities"):
        rj.reduce(system, formulation="joint")
