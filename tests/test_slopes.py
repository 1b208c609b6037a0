"""Derivatives by parts, against those of the whole residual, and stages of implicit steps by them.

At random states, for the identities hold at any; with constraints that repeat each other at states
that fit these, since only there they do.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from programs import kept
from random_scenes import random_scene
from random_spatial_scenes import random_spatial_scene
from tolerances import DIFFERENCED, IDENTITY

import romjax as rj
from romjax.assembly.slopes import slopes
from romjax.integrate.term import MotionTerm
from romjax.system import dynamics

pytestmark = pytest.mark.usefixtures("without_optimisation")

TIME, STEP = 0.13, 0.01  # [s] amid all signals
# Required where rows repeat others: a derivative that asks for something along a null direction
# raises multipliers by the inverse of the proximal term, 1e10, and their rounding stays: by parts,
# and as a whole, where it passes through one inverse more.
REPEATED = 1e-9, 1e-7
RANK = 1e-9  # share of the largest singular value below which rows repeat others
STABILIZATION = rj.Baumgarte(3.0, 2.0)


def rods() -> rj.Scene:
    """Two rods that bend far, hinged one to the other."""
    first = rj.Rod("first", 1.0, 1.0, 1.0, 2)
    second = rj.Rod("second", 0.5, 1.0, 2.0, 3).placed("start", first.pose("end"))
    hinges = [
        rj.Revolute(first.at("start"), rj.ground.at()),
        rj.Revolute(second.at("start"), first.at("end")),
    ]
    damper = rj.TorsionDamper(first.at("end"), second.at("start"), 0.1)
    return rj.Scene([first, second], hinges, [rj.Gravity(), damper])


REPEATING = "loop of repeated rows"
# What a scene is made by, and how far from its start it is [m, rad, m/s, rad/s].
SCENES = {
    "beams": (zoo.falling_beams, 0.1),
    "rods": (rods, 0.1),
    "chapter": (zoo.cart_pendulum, 0.1),
    "hinge made twice": (functools.partial(zoo.four_bar, doubled=True), 0.0),
    "loop with a beam": (zoo.bending_four_bar, 0.1),
    "loop in space": (zoo.driven_loop_in_space, 0.1),
    REPEATING: (rj.gallery.bricard, 0.0),
    "robot arm": (rj.gallery.robot_arm, 0.1),
    "blade": (rj.gallery.rotating_blade, 0.1),
    "squeezer": (rj.gallery.squeezer, 0.1),
    "vehicle axle": (rj.gallery.vehicle_axle, 0.1),
    "contact": (rj.gallery.bouncing_ball, 0.1),
}
SCENES |= {
    f"plane {k}": (functools.partial(random_scene, 12 * k, structure=k), 0.1)
    for k in (*range(9), 12)
}
SCENES |= {
    f"space {k}": (functools.partial(random_spatial_scene, 20 * k, k), 0.1) for k in range(10)
}
FAST = ("beams",)
SLOW = ("rods", REPEATING, "plane 4", "space 3")


@kept
def by_both(system, q, v, given):
    """Derivatives of the residual and a stage, by parts and as a whole, and M and C_q."""
    t, step = jnp.asarray(TIME), jnp.asarray(STEP)
    stabilization = STABILIZATION if system.m else None
    a, multipliers, kkt = dynamics.solve(system, t, q, v, stabilization)
    residual = dynamics._residual(system, a, multipliers, stabilization)
    wanted = jax.jacfwd(lambda q, v: residual(t, q, v), argnums=(0, 1))(q, v)
    parts = slopes(system, t, q, v, a, multipliers, stabilization)
    found = [
        dense(system, columns, parts.pairs) for columns in (parts.by_position, parts.by_velocity)
    ]
    own = dynamics.LinearizationByParts(a, a, kkt, parts, system.structure.loops)
    whole = dynamics.linearize(system, t, q, v, stabilization)
    stages = [one.stages(step)(*given) for one in (own, whole)]
    return found, wanted, stages, system.mass(q), dynamics.jacobian(system, t, q)


def dense(system, columns, pairs):
    """The columns as matrices (n, n) and (m, n)."""
    pattern, n = system.pattern, system.n
    places = pattern.coordinates.array.astype(int)
    full = jnp.zeros((n + 1, n + 1))
    full = full.at[places[:, :, None], places[:, None]].add(columns.own)
    if pairs:
        first, second = np.array(pairs).T
        full = full.at[places[first][:, :, None], places[second][:, None]].add(columns.coupled)
    return full[:n, :n], pattern.dense_jacobian(columns.sides)


def stage_by_hand(mass, rows, slopes, given):
    """The stage from derivatives of the residual: accelerations, and their derivatives, follow the
    best approximation of rows of unit length where these repeat each other.
    """
    half = np.linalg.inv(np.linalg.cholesky(mass)).T
    scale = 1 / np.linalg.norm(rows @ half, axis=1)[:, None]
    left, values, _ = np.linalg.svd(scale * rows @ half)
    rank = int(np.sum(values > RANK * values[0])) if len(values) else 0
    rows, *bent = (left[:, :rank].T @ (scale * x) for x in (rows, *(x[1] for x in slopes)))
    extended = np.block([[mass, rows.T], [rows, np.zeros((rank, rank))]])
    by_q, by_v = (
        -np.linalg.solve(extended, np.concatenate([upper, lower]))[: len(mass)]
        for upper, lower in ((slopes[0][0], bent[0]), (slopes[1][0], bent[1]))
    )
    b, c = given
    matrix = np.eye(len(mass)) / STEP - by_v - STEP * by_q
    return np.linalg.solve(matrix, b + STEP * by_q @ c)


@pytest.mark.parametrize("name", in_groups(SCENES, fast=FAST, slow=SLOW))
def test_derivatives_by_parts_are_those_of_the_whole(name):
    make, far = SCENES[name]
    system = rj.assemble(make())
    lot = np.random.default_rng(len(name)).normal(size=(4, system.n))
    q, v = system.q0 + far * lot[0], system.v0 + 10 * far * lot[1]
    found, wanted, stages, mass, rows = jax.tree.map(np.asarray, by_both(system, q, v, lot[2:]))
    for block in range(2):
        size = max(np.max(np.abs(wanted[block][by]), initial=1.0) for by in range(2))
        for by in range(2):
            assert_close(found[by][block], wanted[block][by], IDENTITY, scale=size)
    slopes = [(wanted[0][by], wanted[1][by]) for by in range(2)]
    by_hand = stage_by_hand(mass, rows, slopes, lot[2:])
    size = np.max(np.abs(by_hand))
    allowed = REPEATED if name == REPEATING else (10 * IDENTITY, 10 * IDENTITY)
    for stage, tol in zip(stages, allowed, strict=True):
        assert_close(stage, by_hand, tol, scale=size)


@pytest.mark.parametrize(("count", "by_parts"), [(7, False), (8, True)])
def test_small_systems_are_taken_as_a_whole(count, by_parts):
    system = rj.assemble(rj.gallery.chain(count))
    slopes = system.state(0.0, system.q0, system.v0).slopes
    found = jax.eval_shape(slopes, system.q0, jnp.zeros(system.m), STABILIZATION)
    assert (found is not None) == system.structure.by_parts == by_parts


class Whole(MotionTerm):
    """A motion whose derivatives are those of the whole residual."""

    def linearize(self, t, y):
        return dynamics.linearize(self.system, jnp.asarray(t), *y, self.stabilization)


@kept
def steps(system, state, tangent):
    """A step each way; its derivatives in both modes, and the step of two lanes."""
    found = []
    for kind in (MotionTerm, Whole):

        def step(y, kind=kind):
            term = kind(system, STABILIZATION)
            return rj.Rodas5P().step(term, TIME, TIME + STEP, y, None, None, False)[0]

        y, along = jax.jvp(step, (state,), (tangent,))
        back = jax.vjp(step, state)[1](tangent)[0]
        lanes = jax.vmap(step)(jax.tree.map(lambda x, d: jnp.stack([x, x + d]), state, tangent))
        found.append((y, along, back, lanes))
    return found


def pinned_twice() -> rj.Scene:
    """A bar whose hinge is made twice."""
    scene = zoo.bar(angle=0.3, spin=2.0)
    return rj.Scene(scene.bodies, 2 * scene.joints, scene.effects)


@pytest.mark.parametrize("make", in_groups([zoo.falling_beams, pinned_twice], slow=[pinned_twice]))
def test_steps_by_parts_are_those_of_the_whole(make):
    """And their derivatives, and lanes of a batch: of a tree, and with rows that repeat others."""
    system = rj.assemble(make())
    by_parts = dataclasses.replace(system.structure, by_parts=True)
    system = dataclasses.replace(system, structure=by_parts)
    lot = np.random.default_rng(0).normal(size=(2, system.n))
    state = system.q0, system.v0
    parts, whole = jax.tree.map(np.asarray, steps(system, state, (lot[0], lot[1])))
    for found, wanted in zip(jax.tree.leaves(parts), jax.tree.leaves(whole), strict=True):
        assert_close(found, wanted, DIFFERENCED, scale=np.max(np.abs(wanted)))
