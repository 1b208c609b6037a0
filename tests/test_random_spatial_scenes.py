"""Identities on 260 scenes in space by lot: thirteen structures, with twenty sets of numbers."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from groups import in_groups
from programs import kept
from random_spatial_scenes import random_spatial_scene
from tolerances import IDENTITY

import romjax as rj
from romjax.linalg import quaternions
from romjax.system import dynamics

r = rj.spatial
STRUCTURES, SETS = 13, 20
FAST, SLOW = (0,), (8,)
TIME = 0.13  # [s] amid all signals
# Required: relative to the size of the terms, and of accelerations to what forces would do to free
# coordinates.
HELD = 10 * IDENTITY
UNIT = 1.0  # [m/s², rad/s²]
TURN, SHIFT = np.array([0.3, -0.5, 0.7, 0.2]), np.array([0.4, -0.9, 0.3])


pytestmark = pytest.mark.usefixtures("without_optimisation")


def scenes(structure: int) -> list[rj.Scene]:
    first = structure * SETS
    return [random_spatial_scene(seed, structure) for seed in range(first, first + SETS)]


@kept
def terms(scene: rj.Scene, q, v) -> dict[str, jax.Array]:
    """Of a state whose velocities fit the joints nearest to q and v: what the identities need."""
    system = rj.assemble(scene)
    slopes = dynamics.jacobian(system, TIME, q)
    driven = jax.jvp(lambda t: system.constraint(t, q), (TIME,), (1.0,))[1]
    v = v - jnp.linalg.lstsq(slopes, slopes @ v + driven)[0]
    a, multipliers = system.acceleration(TIME, q, v)

    def rate(t, q, v):
        return jax.jvp(system.constraint, (t, q), (jnp.ones_like(t), v))[1]

    now, onward = (jnp.asarray(TIME), q, v), (jnp.asarray(1.0), v, a)
    energy = system.state(*now).energy()
    gained = jax.jvp(lambda *x: system.state(*x).energy().total, now, onward)[1]
    power, reaction = system.power(*now), slopes.T @ multipliers
    mass, force = system.mass(q), system.force(TIME, q, v)
    return {
        "v": v,
        "a": a,
        "kinetic": energy.kinetic,
        "work": 0.5 * v @ mass @ system.structure.without_states(v),
        "missed": jax.jvp(rate, now, onward)[1],
        "slopes": jnp.abs(slopes) @ jnp.abs(a) + jnp.abs(slopes) @ jnp.abs(v) ** 2,
        "balance": gained - (power.total if power is not None else 0.0) - multipliers @ driven,
        "powers": jnp.abs(v) @ (jnp.abs(force) + jnp.abs(reaction) + jnp.abs(mass) @ jnp.abs(a)),
        "accelerations": jnp.max((jnp.abs(force) + jnp.abs(reaction)) / jnp.diag(mass)),
    }


@pytest.fixture(scope="module", params=in_groups(range(STRUCTURES), fast=FAST, slow=SLOW))
def found(request):
    """Each scene with a random state and its terms."""
    made = []
    for seed, scene in enumerate(scenes(request.param)):
        system = rj.assemble(scene)
        chance = np.random.default_rng([4, seed]).normal(size=(2, system.n))
        q, v = system.q0 + 0.1 * chance[0], jnp.asarray(system.v0 + chance[1])
        own = terms(scene, q, v)
        assert all(np.all(np.isfinite(x)) for x in own.values())
        made.append((scene, q, own))
    return made


# What is done to a scene


def changed(scene: rj.Scene, x, line, quaternion, shift=(0.0, 0.0, 0.0)) -> jax.Array:
    """Coordinates or their rates, with the functions `line` of places and `quaternion`."""
    x, at = np.array(x), 0
    for body in scene.bodies:
        x[at : at + 3] = line(x[at : at + 3]) + np.asarray(shift)
        x[at + 3 : at + 7] = quaternion(x[at + 3 : at + 7])
        at += body.size
    return jnp.asarray(x)


def rotated(x) -> np.ndarray:
    return np.asarray(quaternions.rotate(TURN, np.asarray(x)))


def turned(x) -> np.ndarray:
    return np.asarray(quaternions.product(TURN, np.asarray(x)))


def moved_part(part):
    """A joint or an effect: its markers on the ground, and directions that space has. Bodies start
    where they did, but states are given.
    """

    def is_marker(x):
        return isinstance(x, rj.Marker)

    def marker(x):
        if not is_marker(x) or x.body != "ground":
            return x
        return rj.Marker("ground", rotated(x.point) + SHIFT, turned(x.turn))

    part = jax.tree.map(marker, part, is_leaf=is_marker)
    if isinstance(part, rj.Gravity):
        return rj.Gravity(rotated(part.acceleration))
    if isinstance(part, rj.Force | r.Torque) and part.frame == "world":
        return dataclasses.replace(part, direction=rotated(part.direction))
    return part


def moved_scene(scene: rj.Scene) -> rj.Scene:
    parts = [[moved_part(part) for part in parts] for parts in (scene.joints, scene.effects)]
    return rj.Scene(scene.bodies, *parts)


def assert_same_accelerations(found, wanted, size):
    assert np.max(np.abs(found - wanted)) <= HELD * max(UNIT, float(size))


# The identities


def kinetic_energy(scene: rj.Scene, q, v) -> float | None:
    """Of rigid bodies by hand, with the part of the lengths of quaternions; None of others."""
    total, at = 0.0, 0
    for body in scene.bodies:
        if not isinstance(body, r.RigidBody):
            return None
        p, rate = q[at + 3 : at + 7], v[at + 3 : at + 7]
        w, e = p[0], p[1:]
        skew = np.array([[0, -e[2], e[1]], [e[2], 0, -e[0]], [-e[1], e[0], 0]])
        spin = 2 * np.column_stack([-e, w * np.eye(3) - skew]) @ rate / (p @ p)
        inertia = np.asarray(body.inertia)
        inertia = np.diag(inertia) if inertia.ndim == 1 else inertia
        total += 0.5 * float(body.mass) * v[at : at + 3] @ v[at : at + 3]
        total += 0.5 * spin @ inertia @ spin
        total += 0.5 * 4 / 3 * np.trace(inertia) * (p @ rate / (p @ p)) ** 2
        at += body.size
    return total


def test_kinetic_energy(found):
    """T = ½ vᵀ M v, and by hand where all bodies are rigid."""
    for scene, q, own in found:
        kinetic = float(own["kinetic"])
        assert abs(kinetic - own["work"]) <= HELD * kinetic
        by_hand = kinetic_energy(scene, np.asarray(q), np.asarray(own["v"]))
        assert by_hand is None or abs(kinetic - by_hand) <= HELD * kinetic


def test_accelerations_keep_the_joints(found):
    """C_q a = γ: the second rate of all constraints is zero."""
    for _, _, own in found:
        assert np.all(np.abs(own["missed"]) <= HELD * (UNIT + np.max(own["slopes"], initial=0.0)))


def test_power_balance(found):
    """The energy gains what loads, dampers and driven joints give."""
    for _, _, own in found:
        assert abs(own["balance"]) <= HELD * float(own["powers"])


def test_a_rigid_motion_changes_nothing(found):
    for scene, q, own in found:
        moved = changed(scene, q, rotated, turned, SHIFT)
        other = terms(moved_scene(scene), moved, changed(scene, own["v"], rotated, turned))
        wanted = changed(scene, own["a"], rotated, turned)
        assert_same_accelerations(other["a"], wanted, own["accelerations"])


@pytest.mark.parametrize("length", [0.1, 10.0])
def test_the_length_of_quaternions_changes_nothing(found, length):
    for scene, q, own in found:

        def scaled(x, scene=scene):
            return changed(scene, x, lambda y: y, lambda p: length * p)

        other = terms(scene, scaled(q), scaled(own["v"]))
        back = changed(scene, other["a"], lambda y: y, lambda p: p / length)
        assert_same_accelerations(back, own["a"], own["accelerations"])


@pytest.mark.instant
def test_every_kind_is_drawn():
    """All joints and effects that there are in space."""
    drawn = {
        type(part)
        for structure in range(STRUCTURES)
        for scene in [random_spatial_scene(structure * SETS, structure)]
        for part in (*scene.bodies, *scene.joints, *scene.effects)
    }
    families = rj.AbstractJoint, rj.AbstractMarkerEffect
    exported = [*vars(r).values(), *(x for x in vars(rj).values() if 3 in dimensions_of(x))]
    kinds = {x for x in exported if isinstance(x, type) and issubclass(x, families)}
    plain = {kind for kind in kinds if not kind.__name__.startswith("Abstract")}
    assert plain | {r.RigidBody, r.Beam, rj.Gravity} <= drawn


def dimensions_of(x) -> tuple[int, ...]:
    return getattr(x, "dimensions", ()) if isinstance(x, type) else ()
