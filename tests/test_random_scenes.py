"""Properties of 120 scenes by lot: power, rigid motions of the whole, and no silent NaN.

Compiling a structure takes seconds, so there are ten of them, with twelve sets of numbers.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from groups import in_groups
from mechanics import material_points
from random_scenes import random_scene
from rigid_motion import moved_coordinates, moved_scene, turned

import romjax as rj
from romjax.scene.joint.prescribed import AbstractPrescribed
from romjax.system import dynamics

# Structures that draw every kind of part; joints of number 9 do not fit each other.
STRUCTURES, SETS = (*range(8), 9, 11, 12), 12
FAST, SLOW = (11,), (4,)

# Required: relative to the size of the terms.
BALANCE = 1e-10
# Required: relative to what the forces would do to free coordinates, or to one where none acts.
MOVED = 1e-10
UNIT = 1.0  # [m/s², rad/s²]
# [m, rad] of a stabilised run at rtol = 1e-6, whose start holds to 1e-10.
VIOLATION = 1e-4
# The least share of scenes that run: else the properties would say little.
RUNNING = 0.7

TIME = 0.13  # [s] of the states, amid all signals
OUTPUTS = np.linspace(0.0, 0.2, 5)  # [s]
MOST_STEPS = 4000

ACROSS = np.array([[0.0, -1.0], [1.0, 0.0]])


pytestmark = pytest.mark.usefixtures("without_optimisation")


@pytest.fixture(scope="module", params=in_groups(STRUCTURES, fast=FAST, slow=SLOW))
def structure(request) -> int:
    """The number of a structure."""
    return request.param


def seeds(structure: int) -> range:
    return range(structure * SETS, (structure + 1) * SETS)


def scene_of(seed: int) -> rj.Scene:
    return random_scene(seed, structure=seed // SETS)


class Forces(NamedTuple):
    """What acts at a state, and what it does."""

    acceleration: jax.Array
    multipliers: jax.Array
    sizes: jax.Array  # of the terms of each coordinate, |Q| + |C_qᵀ λ|
    mass: jax.Array  # diagonal of M
    rate: jax.Array  # Ċ


@jax.jit
def forces(scene: rj.Scene, q, v) -> Forces:
    system = rj.assemble(scene)
    a, multipliers = system.acceleration(TIME, q, v)
    reaction = dynamics.jacobian(system, TIME, q).T @ multipliers
    sizes = jnp.abs(system.force(TIME, q, v)) + jnp.abs(reaction)
    rate = dynamics.constraint_state(system, TIME, q, v).rate
    return Forces(a, multipliers, sizes, jnp.diag(system.mass(q)), rate)


class State(NamedTuple):
    """A state that fits the joints."""

    q: np.ndarray
    v: np.ndarray
    forces: Forces


@functools.cache
def state_of(seed: int) -> State | None:
    """A random state of a scene, or None if joints or their rates find none that fits them."""
    try:
        system = rj.assemble(scene_of(seed))
        chance = np.random.default_rng(seed).normal(size=(2, system.n))
        q, v = rj.consistent(system, system.q0 + 0.1 * chance[0], chance[1], TIME)
    except rj.InputError:
        return None
    found = jax.tree.map(np.asarray, forces(scene_of(seed), q, v))
    fits = np.max(np.abs(found.rate), initial=0.0) <= BALANCE
    return State(np.asarray(q), np.asarray(v), found) if fits else None


def states(structure: int) -> list[tuple[rj.Scene, State]]:
    """The scenes that have one, with it."""
    found = [(scene_of(seed), state_of(seed)) for seed in seeds(structure)]
    return [(scene, state) for scene, state in found if state is not None]


# Mechanics by hand


@eqx.filter_jit
def shapes_at(body: rj.AbstractBody, points):
    return jax.vmap(body.mode_shapes)(points)


@eqx.filter_jit
def natural_frequencies(body: rj.Beam):
    return body.natural_frequencies()


@eqx.filter_jit
def acting(effect: rj.AbstractMarkerEffect, states, poses, twists):
    if isinstance(effect, rj.AbstractStateEffect):
        return effect.driven(TIME, states, poses, twists)
    return effect.wrenches(TIME, poses, twists)


@eqx.filter_jit
def speed_of(signal: rj.AbstractSignal):
    return jax.grad(signal)(TIME)


def points_motion(body: rj.AbstractBody, points, q, v, a):
    """Places, velocities and accelerations of material points, r = R + A(φ) (X + S q_f)."""
    shapes = np.asarray(shapes_at(body, np.asarray(points)))[:, :2]
    c, s = np.cos(q[2]), np.sin(q[2])
    frame = np.array([[c, s], [-s, c]])  # of row vectors
    arm, bend, bent = points + shapes @ q[3:], shapes @ v[3:], shapes @ a[3:]
    across, coriolis = arm @ ACROSS.T, bend @ ACROSS.T
    velocity = v[:2] + (v[2] * across + bend) @ frame
    pull = a[2] * across - v[2] ** 2 * arm + 2 * v[2] * coriolis + bent
    return q[:2] + arm @ frame, velocity, a[:2] + pull @ frame


def own_coordinates(scene: rj.Scene, q) -> dict[str, np.ndarray]:
    """The coordinates of each body, by name."""
    ends = np.cumsum([body.size for body in scene.bodies])
    return dict(zip((body.name for body in scene.bodies), np.split(q, ends), strict=False))


def marker_motion(scene: rj.Scene, marker: rj.Marker, q, v) -> tuple[rj.Pose, rj.Twist]:
    """Pose and twist of a marker."""
    place, angle = np.asarray(marker.point), np.asarray(marker.angle)
    velocity, spin = np.zeros(2), np.zeros(())
    for body in scene.bodies:
        if body.name == marker.body:
            own, rate = (own_coordinates(scene, x)[body.name] for x in (q, v))
            slope = np.asarray(shapes_at(body, place[None]))[0, 2]
            found = points_motion(body, place[None], own, rate, 0 * own)
            place, velocity = found[0][0], found[1][0]
            angle, spin = angle + own[2] + slope @ own[3:], rate[2] + slope @ rate[3:]
    place, angle, velocity, spin = map(jnp.asarray, (place, angle, velocity, spin))
    return rj.Pose(place, angle), rj.Twist(velocity, spin)


def body_powers(scene: rj.Scene, q, v, a):
    """Rate of the kinetic energy, Σ m ṙ·r̈, and the powers of gravity and bending."""
    rate, powers = 0.0, []
    for body in scene.bodies:
        own = [own_coordinates(scene, x)[body.name] for x in (q, v, a)]
        points, masses, rest = material_points(body)
        _, velocity, acceleration = points_motion(body, points, *own)
        rate += masses @ np.sum(velocity * acceleration, axis=1) + rest * own[1][2] * own[2][2]
        for effect in scene.effects:
            if isinstance(effect, rj.Gravity):
                powers.append(masses @ velocity @ np.asarray(effect.acceleration))
        if isinstance(body, rj.Beam):
            frequencies, rates = np.asarray(natural_frequencies(body)), own[1][3:]
            powers.append(-np.sum(frequencies**2 * own[0][3:] * rates))
            if body.damping is not None:
                powers.append(-2 * np.sum(np.asarray(body.damping) * frequencies * rates**2))
    return rate, powers


def effect_powers(scene: rj.Scene, q, v) -> list[float]:
    """Of all wrenches on their moving markers."""
    # States of effects come after the coordinates of bodies.
    powers, states = [], list(v[sum(body.size for body in scene.bodies) :])
    for effect in scene.effects:
        if isinstance(effect, rj.AbstractMarkerEffect):
            own = np.array([states.pop(0) for _ in effect.states])
            poses, twists = zip(
                *(marker_motion(scene, marker, q, v) for marker in effect.markers), strict=True
            )
            wrenches = acting(effect, own, poses, twists)
            for pair in zip(wrenches, twists, strict=True):
                wrench, twist = jax.tree.map(np.asarray, pair)
                powers.append(wrench.force @ twist.velocity)
                powers.append(wrench.torque * twist.angular_velocity)
    return powers


def driven_powers(scene: rj.Scene, multipliers) -> list[float]:
    """Of the joints that move by themselves.

    From M a + C_qᵀ λ = Q the joints put in −λᵀ C_q v, which is λᵀ C_t as C_q v + C_t = 0; and C_t
    is minus the speed of the signal.
    """
    powers, row = [], 0
    for joint in scene.joints:
        if isinstance(joint, AbstractPrescribed):
            powers.append(-multipliers[row] * np.asarray(speed_of(joint.signal)))
        row += joint.rows
    return powers


# The properties


def test_power_balance(structure):
    """dT/dt along the acceleration = powers of effects, gravity, bending and driven joints."""
    for scene, (q, v, found) in states(structure):
        rate, powers = body_powers(scene, q, v, np.asarray(found.acceleration))
        powers += [*effect_powers(scene, q, v), *driven_powers(scene, found.multipliers)]
        inertia = found.mass * np.abs(found.acceleration)
        size = np.sum(np.abs(powers)) + np.abs(v) @ (found.sizes + inertia)
        assert abs(rate - sum(powers)) <= BALANCE * size


def test_a_rigid_motion_changes_the_frame_alone(structure):
    """Accelerations turn with the scene, and those of the modes are the same."""
    for scene, (q, v, found) in states(structure):
        moved = forces(moved_scene(scene), moved_coordinates(scene, q), turned(scene, v))
        error = np.abs(np.asarray(moved.acceleration) - turned(scene, found.acceleration))
        assert np.max(error) <= MOVED * max(UNIT, np.max(found.sizes / found.mass))


@functools.cache
def outcome(seed: int) -> str:
    """How a run ends, in words; what is said to have succeeded has to look like it."""
    try:
        system = rj.assemble(scene_of(seed))
        q0, v0 = rj.consistent(system)
    except rj.InputError as refusal:
        return str(refusal)
    run = zoo.run(
        system,
        OUTPUTS,
        q0=q0,
        v0=v0,
        rtol=1e-6,
        throw=False,
        max_steps=MOST_STEPS,
    )
    if run.success:
        assert all(np.all(np.isfinite(x)) for x in (run.q, run.v, run.multipliers))
        assert np.max(run.violation) <= VIOLATION
    return run.summary()


def test_runs_or_is_refused_with_a_reason(structure):
    for seed in seeds(structure):
        words = outcome(seed)
        statuses = [status.name for status in rj.Status]
        refused = "leave no motion" in words or "is still violated" in words
        assert words.startswith("success") or refused or words.split(":")[0] in statuses


@pytest.mark.exhaustive
def test_most_scenes_run():
    """And some are refused."""
    ran = [
        outcome(seed).startswith("success") for structure in STRUCTURES for seed in seeds(structure)
    ]
    assert RUNNING <= np.mean(ran) < 1


@pytest.mark.slow
def test_every_kind_is_drawn():
    """All joints, effects, curves and signals of romjax, and both bodies that are written here."""

    def parts(x) -> set[type]:
        below = jax.tree.leaves(x, is_leaf=lambda y: y is not x)
        return {type(x)}.union(*(parts(y) for y in below if isinstance(y, eqx.Module | tuple)))

    drawn = parts(tuple(scene_of(seeds(structure)[0]) for structure in STRUCTURES))
    families = rj.AbstractJoint, rj.AbstractMarkerEffect, rj.AbstractCurve, rj.AbstractSignal
    kinds = {x for x in vars(rj).values() if isinstance(x, type) and issubclass(x, families)}
    plain = {kind for kind in kinds if not kind.__name__.startswith("Abstract")}
    # What couples two joints is drawn in space, where it is held to the same identities, and held
    # signals have controllers, whose forces are no functions of the state of bodies. A wheel on a
    # curve has motions of its own in `test_rolling.py`.
    assert (
        plain - {rj.Coupling, rj.Held, rj.RollingWheel}
        | {rj.RigidBody, rj.Beam, rj.Gravity, rj.Friction}
        <= drawn
    )


@pytest.mark.parametrize(
    "stabilization",
    [pytest.param(rj.Projection(), marks=pytest.mark.exhaustive), rj.Baumgarte(12.0, 36.0)],
    ids=["Projection", "Baumgarte"],
)
def test_joints_that_part_on_the_way_are_no_success(stabilization):
    """An angle that is held, and turned from 0.05 s on."""
    wheel = rj.RigidBody("wheel", mass=1.0, inertia=0.1)
    ends = wheel.at(), rj.ground.at()
    joints = [rj.FixedAngle(*ends), rj.PrescribedAngle(*ends, rj.Step(0.5, 0.05, 0.1))]
    system = rj.assemble(rj.Scene([wheel], joints))
    settings = {"rtol": 1e-6, "stabilization": stabilization, "throw": False}
    assert zoo.run(system, OUTPUTS, **settings).status == rj.Status.CONSTRAINTS_VIOLATED


def test_velocities_that_no_joint_allows_are_refused():
    """An angle that is held, and turned from the start on."""
    wheel = rj.RigidBody("wheel", mass=1.0, inertia=0.1)
    ends = wheel.at(), rj.ground.at()
    joints = [rj.FixedAngle(*ends), rj.PrescribedAngle(*ends, rj.Sine(0.5, 2.0))]
    with pytest.raises(rj.InputError, match=r"Angle.*by a rate of -?3\.14 /s.*contradict"):
        rj.consistent(rj.assemble(rj.Scene([wheel], joints)))
