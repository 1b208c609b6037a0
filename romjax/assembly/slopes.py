"""The derivatives of the residuals of a scene's equations of motion, part by part.

A body's share of M a − Q depends on its own q and v alone. Joints and effects see poses p of their
markers, three numbers in the plane and seven in space, whatever the number of modes: with their
forces f(p, ṗ) on these, and J = ∂p/∂q of a marker by the coordinates of its own body, their share
of the generalized force is Jᵀ f, so that

    ∂(Jᵀ f)/∂q = Jᵀ (f_p J + f_ṗ J̇) + (∂J/∂q)ᵀ f,  ∂(Jᵀ f)/∂v = Jᵀ f_ṗ J.

Those of the constraints follow from C_q alone, since derivatives by coordinates and along a motion,
that with the acceleration a, commute: ∂C̈/∂q is the second derivative of C_q along it, ∂C̈/∂v twice
the first, ∂Ċ/∂q the first, and ∂Ċ/∂v = C_q.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..linalg.dense import multiply, multiply_transposed
from ..linalg.implicit import Columns, Slopes
from ..linalg.indexing import consecutive, sum_onto, take
from ..linalg.pattern import Pattern
from ..scene.marker import Pose, Poses
from ..system.constraints import differentiate
from ..system.stabilization import Baumgarte
from .groups import EffectGroup, JointGroup
from .kinematics import Markers

Blocks = Float[Array, "_ _ _"]


class _Blocks(NamedTuple):
    """Blocks of K and of D, of bodies by coordinates of bodies; −1 stands for the ground."""

    rows: np.ndarray
    columns: np.ndarray
    stiffness: Blocks | None
    damping: Blocks | None


class _Action(NamedTuple):
    """The action of equal parts on the poses on their sides, as forces in the equation of motion's
    M a side, and the derivatives by poses and by rates of poses.
    """

    force: Float[Array, "count sides numbers"]
    by_pose: Float[Array, "count sides numbers sides numbers"]
    by_rate: Float[Array, "count sides numbers sides numbers"] | None


def slopes(
    system: Any,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    a: Float[Array, " n"],
    multipliers: Float[Array, " m"],
    stabilization: Baumgarte | None,
) -> Slopes:
    """The derivatives of M a + C_qᵀ λ − Q and of C_q a − γ of an `AssembledSystem`."""
    pattern = system.pattern
    count, size = len(pattern.coordinates.rows), pattern.coordinates.width
    parts = [_of_bodies(system, q, v, a)]
    if system.joint_markers is not None:
        poses = system.joint_markers.poses(q)
        actions = [_reactions(group, t, poses, multipliers) for group in system.joints]
        parts += _of_parts(pattern, system.joint_markers, system.joints, actions, q, v)
    if system.effect_markers is not None:
        poses, rates = jax.jvp(system.effect_markers.poses, (q,), (v,))
        actions = [_loads(group, t, poses, rates) for group in system.effects]
        parts += _of_parts(pattern, system.effect_markers, system.effects, actions, q, v)
    rows, columns = (np.concatenate([part[side] for part in parts]) for side in (0, 1))
    # The ground has no coordinates, so that blocks with it are left out.
    apart = (rows != columns) & (np.minimum(rows, columns) >= 0)
    pairs = sorted({(int(i), int(j)) for i, j in zip(rows[apart], columns[apart], strict=True)})
    number = {pair: count + k for k, pair in enumerate(pairs)} | {(i, i): i for i in range(count)}

    def summed(blocks: Sequence[Blocks | None]) -> Blocks:
        kept = [(p, b) for p, b in zip(parts, blocks, strict=True) if b is not None]
        if not kept:
            return jnp.zeros((count + len(pairs), size, size), q.dtype)
        onto = [
            number.get(ends, -1) for p, _ in kept for ends in zip(p.rows, p.columns, strict=True)
        ]
        return sum_onto(jnp.concatenate([b for _, b in kept]), np.array(onto), count + len(pairs))

    stiffness = summed([part.stiffness for part in parts])
    damping = summed([part.damping for part in parts])
    curvature, rates = _of_constraints(system, t, q, v, a, stabilization)
    return Slopes(
        Columns(stiffness[:count], stiffness[count:], curvature),
        Columns(damping[:count], damping[count:], rates),
        tuple(pairs),
    )


def _of_bodies(
    system: Any, q: Float[Array, " n"], v: Float[Array, " n"], a: Float[Array, " n"]
) -> _Blocks:
    """Return the action of bodies on themselves: inertia, elasticity, damping and fields."""
    size, each = system.pattern.coordinates.width, []
    for group in system.bodies:
        shape = (len(group.coordinates.rows), size, size)
        own = [
            jnp.zeros(shape, q.dtype) if block is None else _padded(block, size)
            for block in group.slopes(system.fields, q, v, a)
        ]
        each.append(own)
    stiffness, damping = (jnp.concatenate(blocks) for blocks in zip(*each, strict=True))
    bodies = np.arange(len(stiffness))
    return _Blocks(bodies, bodies, stiffness, damping)


def _reactions(group: JointGroup, t: Time, poses: Pose, multipliers: Float[Array, " m"]) -> _Action:
    """C_pᵀ λ of joints."""
    t = group.time(t)

    def react(joint: Any, own: Array, sides: Poses) -> tuple[Array, Array]:
        counters = sides[len(joint.markers) :]

        def force(numbers: Array) -> tuple[Array, Array]:
            def work(numbers: Array) -> Array:
                return multiply(own, joint.residual(t, *_poses(numbers, sides[0]), *counters))

            slope = jax.grad(work)(numbers)
            return slope, slope

        by_pose, value = jax.jacfwd(force, has_aux=True)(_numbers(sides[: len(joint.markers)]))
        return value, by_pose

    sides = group.markers.take(poses)
    return _Action(*jax.vmap(react)(group.joints, group.rows.take(multipliers), sides), None)


def _loads(group: EffectGroup, t: Time, poses: Pose, rates: Pose) -> _Action:
    """−f of effects."""
    moving = group.effects.needs_twists

    def act(effect: Any, sides: Poses, rates: Poses) -> tuple[Array, ...]:
        count = len(effect.markers) + len(effect.states)

        def force(numbers: Array, *speeds: Array) -> tuple[Array, Array]:
            at = (*_poses(numbers, sides[0]), *sides[count:])
            of = [(*_poses(x, sides[0]), *rates[count:]) for x in speeds]
            twists = tuple(p.twist(rate) for x in of for p, rate in zip(at, x, strict=True))
            wrenches = effect.wrenches(t, at, twists)
            total = -_numbers([p.force(w) for p, w in zip(at[:count], wrenches, strict=False)])
            return total, total

        own = [_numbers(x[:count]) for x in ((sides, rates) if moving else (sides,))]
        slopes, value = jax.jacfwd(force, argnums=tuple(range(len(own))), has_aux=True)(*own)
        return value, *slopes

    value, by_pose, *by_rate = jax.vmap(act)(
        group.effects, group.markers.take(poses), group.markers.take(rates)
    )
    return _Action(value, by_pose, by_rate[0] if moving else None)


def _of_parts(
    pattern: Pattern,
    markers: Markers,
    groups: Sequence[JointGroup | EffectGroup],
    actions: Sequence[_Action],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
) -> list[_Blocks]:
    """Return the action of joints or effects on bodies, from that on the poses of their markers."""
    table, size = markers.coordinates(), pattern.coordinates.width
    bodies, exists = pattern.bodies_at(table[:, 0]), (table < pattern.n).astype(q.dtype)

    def motion(q: Array) -> Array:
        return markers.jacobian(q).matrix() * exists[:, None]

    moving = any(action.by_rate is not None for action in actions)
    along, turning = jax.jvp(motion, (q,), (v,)) if moving else (motion(q), None)
    bends = markers.curvature(q, _stacked(groups, actions))
    blocks = list[_Blocks]()
    for group, action in zip(groups, actions, strict=True):
        # All pairs of sides at once, (sides, sides, count, ...): code for each is slow to compile.
        sides = action.force.shape[1]
        own, about = (_by_sides(group, x, sides) for x in (along, bends))
        first, second = own[:, None], own[None]
        by_pose = multiply(_paired(action.by_pose), second)
        damping = None
        if action.by_rate is not None and turning is not None:
            by_rate = _paired(action.by_rate)
            by_pose += multiply(by_rate, _by_sides(group, turning, sides)[None])
            damping = multiply_transposed(first, multiply(by_rate, second))
            damping = _padded(damping.reshape(-1, *damping.shape[3:]), size)
        diagonal = np.eye(sides, dtype=q.dtype)[:, :, None, None, None]
        stiffness = multiply_transposed(first, by_pose) + diagonal * about[:, None]
        ends = np.stack(group.markers.take(bodies)[:sides])
        shape = (sides, *ends.shape)
        rows, columns = (np.broadcast_to(x, shape).ravel() for x in (ends[:, None], ends[None]))
        stiffness = _padded(stiffness.reshape(-1, *stiffness.shape[3:]), size)
        blocks.append(_Blocks(rows, columns, stiffness, damping))
    return blocks


def _by_sides(
    group: JointGroup | EffectGroup, x: Float[Array, "markers *k"], sides: int
) -> Float[Array, "sides count *k"]:
    """The rows of the first sides of equal parts."""
    start, count = group.markers.start, group.markers.count
    rows: Array = consecutive(x, start, sides * count)
    return rows.reshape(sides, count, *x.shape[1:])


def _paired(
    x: Float[Array, "count sides numbers sides numbers"],
) -> Float[Array, "sides sides count numbers numbers"]:
    return jnp.transpose(x, (1, 3, 0, 2, 4))


def _of_constraints(
    system: Any,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    a: Float[Array, " n"],
    stabilization: Baumgarte | None,
) -> tuple[Blocks, Blocks]:
    """∂/∂q and ∂/∂v of C_q a − γ, as blocks of C_q."""
    along = differentiate(system.jacobian_blocks, t, q, v, a)
    by_position, by_velocity = along.curvature, 2 * along.rate
    if stabilization is not None:
        ones, none = jnp.ones(system.m, q.dtype), jnp.zeros(system.m, q.dtype)
        beta, alpha = (
            take(system.pattern.split_rows(term), system.pattern.nodes)[:, :, None]
            for term in (stabilization.term(ones, none), stabilization.term(none, ones))
        )
        by_position += alpha * along.rate + beta * along.violation
        by_velocity += alpha * along.violation
    return by_position, by_velocity


def _stacked(
    groups: Sequence[JointGroup | EffectGroup], actions: Sequence[_Action]
) -> Float[Array, "markers numbers"]:
    """The forces on all markers, none on counters that only tell how often something has turned."""
    rows = list[Array]()
    for group, action in zip(groups, actions, strict=True):
        count, sides, numbers = action.force.shape
        rows.append(jnp.swapaxes(action.force, 0, 1).reshape(-1, numbers))
        rows.append(jnp.zeros(((group.markers.sides - sides) * count, numbers), rows[0].dtype))
    return jnp.concatenate(rows)


def _numbers(poses: Sequence[Pose]) -> Float[Array, "sides numbers"]:
    """Positions and turns of poses as arrays."""
    rows = [jnp.concatenate([pose.position, jnp.atleast_1d(pose.turn)]) for pose in poses]
    return jnp.stack(rows)


def _poses(numbers: Float[Array, "sides numbers"], like: Pose) -> list[Pose]:
    d = like.dimension
    return [Pose(row[:d], row[d:].reshape(like.turn.shape)) for row in numbers]


def _padded(blocks: Float[Array, "count k l"], size: int) -> Float[Array, "count size size"]:
    """Blocks filled up with zeros."""
    return jnp.pad(blocks, [(0, 0), *((0, size - x) for x in blocks.shape[1:])])
