"""The joints that a tree leaves out, by the twists of the bodies that they hold."""

import functools
import operator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly import planar, spatial
from ...assembly.assembled import AssembledSystem
from ...assembly.groups import JointGroup
from ...assembly.kinematics import Markers
from ...common.arrays import Time
from ...linalg import quaternions
from ...linalg.dense import multiply
from ...linalg.indexing import take
from ...scene.marker import Pose
from ...system.constraints import ConstraintState, differentiate
from . import twists
from .closing import SomeJoints, some_joints
from .screws import Screws, screws_of
from .tree import Tree

# Twists are sums, whose rounding is so many units of the precision of numbers.
_ROUNDING = 1e3


class MarkerMotion(NamedTuple):
    """The motion of markers, by the inertial axes and about the points of their bodies.

    - `poses`: theirs; `arms`: where they are from the points.
    - `columns` (count, modes, twist): their twists for unit rates of the amplitudes of their
      bodies; `twists`, `bias`: theirs, and the derivative where no rate changes.
    """

    poses: Pose
    arms: Float[Array, "count d"]
    columns: Float[Array, "count modes twist"]
    twists: Float[Array, "count twist"]
    bias: Float[Array, "count twist"]


class Cut(eqx.Module):
    """The joints that a tree leaves out, and the places in it of the bodies of their markers; the
    number of bodies stands for the ground, one more for angles that count turns.

    - `rank`: how many of the rows are independent where the joints hold; None for all.
    """

    joints: SomeJoints
    owners: tuple[int, ...] = eqx.field(static=True)
    rank: int | None = eqx.field(static=True, default=None)

    @classmethod
    def of(cls, system: AssembledSystem, tree: Tree, chosen: tuple[tuple[int, int], ...]) -> "Cut":
        """Return the cut at the joints of a system that are `chosen` by group and row."""
        joints = some_joints(system, chosen)
        if joints.markers is None:
            return cls(joints, ())
        places = {row[0]: i for i, row in enumerate(tree.columns.rows)}
        firsts = joints.markers.frames.array[:, 0].tolist()
        ground = tree.count
        owners = [places.get(i, ground if i >= system.n else ground + 1) for i in firsts]
        return cls(joints, tuple(owners))

    def constraints(self, t: Time, tree: Tree, state: Any) -> ConstraintState:
        """C, Ċ, and C̈ where z̈ is zero, of a `state` of joint coordinates."""
        markers = self._markers
        moving = marker_motion(tree, markers, self.owners, state)
        d = markers.points.shape[1]

        def residual(t: Time, x: Float[Array, "count numbers"]) -> Float[Array, " m"]:
            return self.joints.of_poses(t, Pose(x[:, :d], x[:, d] if d == 2 else x[:, d:]))

        turns = moving.poses.turn
        (omega, velocity), (change, rate) = (twists.split(x) for x in moving[3:])
        # From the points of the bodies to the markers: v + ω × a, and
        # v̇ + ω̇ × a + ω × (v + ω × a), as arms turn with their bodies.
        velocity = velocity + twists.about(omega, moving.arms)
        rate = rate + twists.about(change, moving.arms) + twists.about(omega, velocity)
        if d == 3:
            spun = quaternions.derivative(turns, omega)
            change = quaternions.derivative(turns, change) + quaternions.derivative(spun, omega)
            omega = spun
        turns = turns[:, None] if d == 2 else turns
        each = ((moving.poses.position, turns), (velocity, omega), (rate, change))
        return differentiate(residual, t, *[jnp.concatenate(x, axis=1) for x in each])

    def jacobian(self, t: Time, tree: Tree, state: Any) -> Float[Array, "m r"]:
        """C_z, from the motion of the bodies for unit rates of z, which the state has."""
        moving = marker_motion(tree, self._markers, self.owners, state)
        size = moving.twists.shape[1]
        pushed = jnp.moveaxis(state.pushed, 0, 2)  # (bodies, size, r)
        pushed = take(pushed, np.minimum(self.owners, tree.count).astype(np.uint32))
        each = pushed[:, :size]
        if moving.columns.shape[1]:
            bending = pushed[:, size : size + moving.columns.shape[1]]
            each = each + multiply(jnp.swapaxes(moving.columns, 1, 2), bending)
        rows = []
        for group in self.joints.groups:
            sides = group.bodies_of(group.markers.take(each))
            wrenches = _wrenches(group, t, moving)
            own = [multiply(x, y) for x, y in zip(wrenches, sides, strict=True)]
            largest = [_bound(x, y) for x, y in zip(wrenches, sides, strict=True)]
            total = functools.reduce(operator.add, own)
            rows.append(_without_rounding(total, functools.reduce(operator.add, largest)))
        return jnp.concatenate([x.reshape(-1, x.shape[2]) for x in rows])

    @property
    def _markers(self) -> Markers:
        assert self.joints.markers is not None
        return self.joints.markers


def _without_rounding(
    rows: Float[Array, "count rows r"], largest: Float[Array, "count rows r"]
) -> Float[Array, "count rows r"]:
    """Rows without those that are nothing but rounding, of terms that may be as large as `largest`.

    A hinge that closes a loop of parallel hinges asks nothing of most of its rows. Scaled to unit
    length, rounding would be a constraint.
    """
    least = _ROUNDING * jnp.finfo(rows.dtype).eps * jnp.max(largest, axis=2, keepdims=True)
    return jnp.where(jnp.max(jnp.abs(rows), axis=2, keepdims=True) > least, rows, 0)


def _bound(
    wrenches: Float[Array, "count rows twist"], motions: Float[Array, "count twist r"]
) -> Float[Array, "count rows r"]:
    """How large the products of wrenches and twists can be for any directions."""
    each = zip(twists.split(wrenches), twists.split(jnp.swapaxes(motions, 1, 2)), strict=True)
    terms = [_lengths(x)[:, :, None] * _lengths(y)[:, None] for x, y in each]
    return functools.reduce(operator.add, terms)


def _lengths(x: Float[Array, "count k d"]) -> Float[Array, "count k"]:
    # Lengths are only compared, and not differentiated: no derivative meets the root of zero.
    return jnp.sqrt(jnp.sum(jax.lax.stop_gradient(x) ** 2, axis=2))


def _wrenches(
    group: JointGroup, t: Time, moving: MarkerMotion
) -> list[Float[Array, "count rows twist"]]:
    """The derivatives of the residuals by the twists of the markers of each side."""
    t = group.time(t)

    def slopes(joint: Any, poses: tuple[Pose, ...]) -> tuple[Array, ...]:
        own, counters = group.bodies_of(poses), poses[len(group.bodies_of(poses)) :]
        sides = jax.jacrev(lambda own: joint.residual(t, *own, *counters))(own)
        return tuple(map(_by_twist, own, sides))

    sides = jax.vmap(slopes)(group.joints, group.markers.take(moving.poses))
    arms = group.bodies_of(group.markers.take(moving.arms))
    return [
        twists.wrench_from_origin(side, arm[:, None]) for side, arm in zip(sides, arms, strict=True)
    ]


def _by_twist(pose: Pose, slope: Pose) -> Float[Array, "rows twist"]:
    """Rows by the twist of a pose, about its position, from those by the pose."""

    def row(slope: Pose) -> Array:
        force, torque = pose.wrench(slope)
        return jnp.append(torque, force)

    each: Array = jax.vmap(row)(slope)
    return each


def marker_motion(
    tree: Tree, markers: Markers, owners: tuple[int, ...], state: Any
) -> MarkerMotion:
    """The motion of `markers` on bodies of the tree, by their places."""
    motion, dtype = state.motion, state.z.dtype
    d, own = markers.points.shape[1], np.minimum(owners, tree.count).astype(np.uint32)
    # The ground is one more row, a frame that stands still.
    upright = np.zeros((), dtype) if d == 2 else np.array([1, 0, 0, 0], dtype)

    def of_bodies(x: Array, ground: np.ndarray) -> Array:
        return take(jnp.concatenate([x, ground[None]]), own)

    none = np.zeros(d, dtype)
    frame = Pose(of_bodies(motion.frames.position, none), of_bodies(motion.frames.turn, upright))
    k = markers.amplitudes.width
    bent = take(tree.amplitudes.take(state.z), own)[:, :k]
    poses: Pose = (planar if d == 2 else spatial).compose(frame, markers.local(bent))
    counting = np.array(owners) > tree.count
    if counting.any():
        given = markers.poses(state.q)
        position = jnp.where(counting[:, None], given.position, poses.position)
        poses = Pose(position, poses.turn)
    points = take(motion.points, own)
    moved, change = take(motion.twists, own), take(state.still, own)
    columns = jnp.zeros((len(owners), 0, moved.shape[1]), dtype)
    if k:
        rates = take(state.bending, own)[:, :k]
        axes = of_bodies(motion.frames.axes, np.eye(d, dtype=dtype))
        each: Screws = screws_of(markers.local, bent, rates, lambda _, u: u)
        each = each.placed(axes, frame.position - points)
        # The bending of the body carries its marker against the frame, and the frame carries both.
        leaving = each.velocity(rates)
        change = change + each.with_drift(twists.cross(moved, leaving))
        moved, columns = moved + leaving, each.columns
    return MarkerMotion(poses, poses.position - points, columns, moved, change)
