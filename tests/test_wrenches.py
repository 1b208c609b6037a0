"""What the forces of all joints and effects have in common: balance, power, derivatives."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from mechanics import mixed_scene
from mechanisms import bar, ends
from motions import through
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax.assembly.locate import locate
from romjax.assembly.wrenches import joint_wrenches


@pytest.fixture(scope="module")
def moving():
    """A mechanism with joints and effects of all kinds, at random states that fit its joints."""
    system = rj.assemble(mixed_scene())
    chance = np.random.default_rng(7)
    at, speeds = np.asarray(system.q0), chance.normal(size=(5, system.n))
    near = at + 0.1 * chance.normal(size=(5, system.n))
    states = [rj.consistent(system, *state) for state in zip(near, speeds, strict=True)]
    run = through(system, np.linspace(0.0, 0.1, 5), *map(np.stack, zip(*states, strict=True)))
    # The forces of joints are in balance for any multipliers.
    multipliers = jnp.asarray(chance.normal(size=(5, system.m)))
    return system, eqx.tree_at(lambda run: run.derived.multipliers, run, multipliers)


def test_action_and_reaction(moving):
    """Both sides of a joint are in equilibrium, and those of a spring."""
    system, run = moving
    spring = rj.effect_forces(system, run)["Spring(tip, ground)"]
    for part in [*(part for _, part in rj.joint_forces(system, run).items()), spring]:
        part = jax.tree.map(np.asarray, part)
        a, b = part.on("a"), part.on("b")
        scale = 1 + np.max(np.abs(a.force))
        assert_close(a.force, -b.force, IDENTITY, scale)
        arm = part.poses[0].position - part.poses[1].position
        about = a.torque + b.torque + arm[:, 0] * a.force[:, 1] - arm[:, 1] * a.force[:, 0]
        assert_close(about, 0, SOLVED, scale)  # as far as the joints hold


def test_wrenches_are_the_constraint_forces(moving):
    """Their generalized force is −C_qᵀ λ, for any λ."""
    system, run = moving
    multipliers = np.cos(np.arange(1.0, system.m + 1))

    @jax.jit
    def both(t, q, v):
        wrenches = joint_wrenches(system.joints, system.joint_markers, t, q, multipliers)
        pulled = system.joint_markers.pull_back(q, wrenches)
        return pulled, system.state(t, q, v).jacobian().T @ multipliers

    found, wanted = both(*(np.asarray(x)[2] for x in (run.t, run.q, run.v)))
    assert_close(found, -wanted, IDENTITY)


def test_the_force_of_a_marker(moving):
    """A force and a torque on two points of a system that is assembled, against those of effects
    that the scene has.
    """
    system, run = moving
    scene = mixed_scene()
    a, b = scene.bodies[2].at((0.0, -0.1)), scene.bodies[0].at((0.3, 0.2))
    loads = rj.Force(a, (3.0, 4.0), rj.Constant(5.0)), rj.Torque(b, rj.Constant(2.0))
    loaded = rj.assemble(eqx.tree_at(lambda s: s.effects, scene, (*scene.effects, *loads)))
    markers = locate("test", system, [a, b])

    @jax.jit
    def forces(t, q, v):
        wrenches = rj.Wrench(jnp.array([[3.0, 4.0], [0.0, 0.0]]), jnp.array([0.0, 2.0]))
        found = markers.pull_back(q, wrenches), markers.poses(q).position[0]
        return *found, system.force(t, q, v), loaded.force(t, q, v)

    state = (np.asarray(x)[2] for x in (run.t, run.q, run.v))
    found, place, own, both = map(np.asarray, forces(*state))
    assert_close(found, both - own, IDENTITY, np.max(np.abs(own)))
    assert_close(place, np.asarray(rj.measure(system, run, a).position)[2], IDENTITY)


def test_frames(moving):
    """A rail acts across its line: along y of its own marker, and not along x."""
    system, run = moving
    rail = rj.joint_forces(system, run)["PointOnLine(slider, ground)"]
    local = rail.on("a", frame="b")
    size = np.hypot(*np.asarray(rail.force).T)
    assert_close(local.force[:, 0], 0, IDENTITY, np.max(size))
    assert_close(np.abs(local.force[:, 1]), size, IDENTITY, np.max(size))
    assert_close(rail.on("b", frame="b").force, -local.force, IDENTITY, np.max(size))
    for wrong in ({"side": "c"}, {"frame": "slider"}):
        with pytest.raises(rj.InputError, match=r"Forces\.on: there is no (side|frame)"):
            rail.on(**wrong)


def test_a_spring_and_a_damper():
    """Forces k (s − s₀) and d ṡ along the line, on both ends; power by the rate of the length."""
    a, b = (rj.RigidBody(n, 1.0, 1.0, velocity=v) for n, v in (("a", (0.3, -0.2)), ("b", (0, 1))))
    b = eqx.tree_at(lambda body: body.position, b, jnp.array([1.0, 0.5]))
    left, right = a.at((0.1, 0.0)), b.at((0.0, -0.2))
    spring = rj.Spring(left, right, stiffness=30.0, rest_length=0.7)
    soft = rj.Spring(left, right, stiffness=3.0)
    scene = rj.Scene([a, b], [], [spring, soft, rj.Damper(left, right, damping=2.0)])
    system = rj.assemble(scene)
    chance = np.random.default_rng(9).normal(size=(2, 7, system.n))
    q = np.asarray(system.q0) + 0.2 * chance[0]
    run = through(system, np.linspace(0.0, 0.3, 7), q, chance[1])
    found, apart = rj.effect_forces(system, run), rj.measure(system, run, left, right)
    assert set(found) == {"Spring(a, b) 1", "Spring(a, b) 2", "Damper(a, b)"}
    ends = [rj.measure(system, run, marker) for marker in (left, right)]
    line, speed = (
        np.asarray(getattr(ends[1], x)) - np.asarray(getattr(ends[0], x))
        for x in ("position", "velocity")
    )
    distance = np.asarray(apart.distance)
    pull = 30.0 * (distance - 0.7)
    wanted = (pull / distance)[:, None] * line
    assert_close(found["Spring(a, b) 1"].force, wanted, IDENTITY, 10)
    assert_close(found["Spring(a, b) 1"].on("b").force, -wanted, IDENTITY, 10)
    assert_close(
        found["Spring(a, b) 1"].power, -pull * np.asarray(apart.distance_rate), IDENTITY, 10
    )
    assert_close(found["Spring(a, b) 2"].force, 3.0 * line, IDENTITY, 10)
    damper = found["Damper(a, b)"]
    assert_close(damper.power, -2.0 * np.sum(speed**2, axis=1), IDENTITY, 10)


def hinged(mass):
    """A bar of a given mass on a hinge, and on a spring at its other end."""
    pendulum = bar("bar", (0, 0), (1, 0.2), mass=1.0)
    pendulum = eqx.tree_at(lambda body: body.mass, pendulum, jnp.asarray(mass, float))
    low, far = ends(pendulum)
    joints = [rj.Revolute(low, rj.ground.at(), name="hinge")]
    return rj.Scene([pendulum], joints, [rj.Gravity(), rj.Spring(far, rj.ground.at((1, 1)), 20.0)])


def hanging() -> rj.Trajectory:
    """Three states that fit the hinge, and any multipliers."""
    system = rj.assemble(hinged(1.0))
    speed = np.linspace(0.0, 2.0, 3)[:, None]
    at = np.asarray(system.q0)
    v = speed * np.array([-at[1], at[0], 1.0])
    run = through(system, np.linspace(0.0, 0.1, 3), np.tile(at, (3, 1)), v)
    multipliers = jnp.asarray(np.random.default_rng(8).normal(size=(3, system.m)))
    return eqx.tree_at(lambda run: run.derived.multipliers, run, multipliers)


def last_force(mass, run=None):
    """The hinge's vertical force, at the end of a run, its own unless given."""
    system = rj.assemble(hinged(mass))
    if run is None:
        run = zoo.run(system, np.linspace(0.0, 0.1, 3), dt=5e-3, solver=diffrax.Tsit5())
    return rj.joint_forces(system, run)["hinge"].force[-1, 1]


def assert_derivative(function, at):
    function, h = jax.jit(function), 1e-4
    wanted = (function(at + h) - function(at - h)) / (2 * h)
    assert_close(jax.grad(function)(at), wanted, DIFFERENCED, abs(wanted))


def test_derivative_by_a_mass():
    """At given states."""
    run = hanging()
    assert_derivative(lambda mass: last_force(mass, run), 1.3)


@pytest.mark.slow
def test_derivative_through_the_motion():
    """Of the mass that also changes the motion; and in a batch."""
    h = 1e-4
    batch = np.asarray(jax.jit(jax.vmap(last_force))(np.array([1.3 - h, 1.3, 1.3 + h])))
    value, slope = jax.jit(jax.value_and_grad(last_force))(1.3)
    wanted = (batch[2] - batch[0]) / (2 * h)
    assert_close(slope, wanted, DIFFERENCED, abs(wanted))
    assert_close(batch[1], value, IDENTITY, 100)


def test_tables_pass_through_transformations():
    """The table itself is a result of `jit` and `vmap`."""
    run = hanging()
    masses = jnp.array([1.0, 2.0])
    tables = jax.jit(jax.vmap(lambda m: rj.joint_forces(rj.assemble(hinged(m)), run)))(masses)
    one = rj.joint_forces(rj.assemble(hinged(2.0)), run)["hinge"]
    assert_close(tables["hinge"].force[1], one.force, IDENTITY, 100)
    local = tables["hinge"].on("a", frame="a").force[1]
    assert_close(local, one.on("a", frame="a").force, IDENTITY, 100)
