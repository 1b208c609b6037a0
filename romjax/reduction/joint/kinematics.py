"""The motion of a tree: frames, twists, and what accelerations have without those of the joints."""

import functools
import operator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...linalg import quaternions
from ...linalg.indexing import take
from ...scene.marker import Pose
from . import twists
from .ports import Frames
from .screws import along_joint, in_order, joint_screws, of_parents, port_amplitudes, port_screws
from .spanning import has_own_screws
from .tree import Links, Tree


class Edges(NamedTuple):
    """The relative motion of the frames of each body and of its parent, by the axes of each.

    - `outer`, `inner`: the ports on the parent and on the body. `joint`: the pose of the body's
      port in the parent's. `turn`: that of the body's frame in the parent's.
    """

    outer: Frames
    joint: Pose
    inner: Frames
    turn: Float[Array, "bodies *turn"]


class TreeMotion(NamedTuple):
    """The motion of all bodies, by the inertial axes and about the point of each one's branch.

    - `frames`: of the bodies. `arms`: where they are from `points`, those that vectors are about.
    - `own` (bodies, rates, twist): B of V = P + Bᵀ w, where P is the twist of the parent's port;
      `outer` (bodies, modes, twist): Φ of P = V + Φᵀ η of the parent.
    - `twists`: V. `bias`: the derivative of V − P + Φᵀ η, where no rate changes.
    """

    frames: Frames
    points: Float[Array, "bodies d"]
    own: Float[Array, "bodies rates twist"]
    outer: Float[Array, "bodies modes twist"]
    twists: Float[Array, "bodies twist"]
    bias: Float[Array, "bodies twist"]

    @property
    def arms(self) -> Float[Array, "bodies d"]:
        """The vectors from the points to the frames."""
        return self.frames.position - self.points


def edges(tree: Tree, z: Float[Array, " n"]) -> Edges:
    """The poses of ports and joints at the coordinates z."""
    across = None
    if tree.still is None:
        outer, inner = _halves(Frames.of(tree.ports.local(port_amplitudes(tree, z))))
    else:
        outer, inner, across = tree.still
    joint: Pose = in_order(tree, [_place(link, link.coordinates.take(z)) for link in tree.links])
    if joint.dimension == 2:
        # From the parent to its port, across the joint, and from the port of the body back to it.
        turn = outer.turn + joint.turn - inner.turn
    elif across is not None:
        # Column by column: a sum of products would compute its sines again for each entry.
        columns = (across[:, :, i] * joint.turn[:, i, None] for i in range(4))
        turn = functools.reduce(operator.add, columns)
    else:
        first = quaternions.product(outer.turn, joint.turn)
        turn = quaternions.product(first, quaternions.conjugate(inner.turn))
    return Edges(outer, joint, inner, turn)


def _place(link: Links, z: Float[Array, "count freedoms"]) -> Pose:
    """The ports of bodies in those of their parents, with turns of unit length."""
    poses = along_joint(link, z)
    if link.joints.turns_freely or not has_own_screws(link.joints):
        poses = Pose(poses.position, twists.unit(poses.turn))
    return twists.inverse(poses) if link.reversed else poses


def _of_carriers(
    tree: Tree, of_parents: Float[Array, "bodies *k"], own: Float[Array, "bodies *k"]
) -> Float[Array, "bodies *k"]:
    """The rows of the bodies that carry the axes of each one's joint: the second markers."""
    carried = np.zeros(tree.count, bool)
    for link in tree.links:
        carried[np.array(link.bodies)] = link.reversed
    if carried.any() and not carried.all():
        return jnp.where(carried.reshape(-1, *[1] * (own.ndim - 1)), own, of_parents)
    return own if carried.any() else of_parents


def _halves(ports: Any) -> tuple[Any, Any]:
    count = len(jax.tree.leaves(ports)[0]) // 2
    return jax.tree.map(lambda x: x[:count], ports), jax.tree.map(lambda x: x[count:], ports)


def frames(tree: Tree, between: Edges) -> Frames:
    """The frames of all bodies.

    Only the product of rotations in space is a loop; places are sums along the branches.
    """
    if between.joint.dimension == 2:
        turns = along(tree, between.turn)
    else:
        turns = _rotations(tree, between.turn)
    axes = twists.axes(turns)
    outer, before = between.outer, _parents_axes(tree, axes)
    port = outer.position + twists.rotated(outer.axes, between.joint.position)
    # From the frame of the parent to the port, and from there to that of the body.
    steps = twists.rotated(before, port) - twists.rotated(axes, between.inner.position)
    return Frames(along(tree, steps), turns, axes)


def _rotations(tree: Tree, relative: Float[Array, "bodies 4"]) -> Float[Array, "bodies 4"]:
    unit = jnp.zeros(4, relative.dtype).at[0].set(1)
    if tree.is_chain:

        def turn(before: Array, own: Array) -> tuple[Array, Array]:
            after = quaternions.product(before, own)
            return after, after

        return jax.lax.scan(turn, unit, relative)[1]

    def follow(turns: Array, at: Any) -> tuple[Array, None]:
        i, parent, own = at
        return turns.at[i].set(quaternions.product(turns[parent], own)), None

    numbers = jnp.arange(tree.count), jnp.array(tree.parents)
    start = jnp.broadcast_to(unit, (tree.count + 1, 4))
    return jax.lax.scan(follow, start, (*numbers, relative))[0][:-1]


def along(tree: Tree, x: Float[Array, "bodies *k"]) -> Float[Array, "bodies *k"]:
    """The sums of the rows of each body and of those that hold it."""
    if tree.is_chain:
        return jnp.cumsum(x, axis=0)
    for before in tree.ancestors:
        x = x + take(x, before)
    return x


def tree_motion(tree: Tree, z: Float[Array, " n"], u: Float[Array, " rates"]) -> TreeMotion:
    """The motion of the bodies at the coordinates z and the rates u."""
    between = edges(tree, z)
    place = frames(tree, between)
    # Vectors of a branch are about the place of its first body, on which no result depends: arms
    # are as short as the branch, however far that is from the origin.
    points = twists.stopped(take(place.position, np.array(tree.roots, np.uint32)))
    rates, own_arms = tree.motions.take(u), place.position - points
    before, arms = _parents_axes(tree, place.axes), of_parents(tree, place.position) - points
    local = joint_screws(tree, z, rates).placed(
        _of_carriers(tree, between.outer.axes, between.inner.axes),
        _of_carriers(tree, between.outer.position, between.inner.position),
    )
    carriers = _of_carriers(tree, before, place.axes)
    joint = local.placed(carriers, _of_carriers(tree, arms, own_arms))
    turning = joint.velocity(rates[:, : tree.freedoms])
    if not tree.modes:
        moved = along(tree, turning)
        carrying = _of_carriers(tree, of_parents(tree, moved), moved)
        bias = joint.with_drift(twists.cross(carrying, turning))
        return TreeMotion(place, points, joint.columns, joint.columns[:, :0], moved, bias)
    outer, inner = _halves(port_screws(tree, z, rates))
    outer, inner = outer.placed(before, arms), inner.placed(place.axes, own_arms)
    bending = rates[:, tree.freedoms :]
    # From the parent to its port its own bending counts, then the joint, and the bending of the
    # body backwards.
    leaving, arriving = outer.velocity(of_parents(tree, bending)), inner.velocity(bending)
    moved = along(tree, leaving + turning - arriving)
    # The columns of each step turn with what carries them: derivatives of twists are cross products
    # with the twist of that.
    held = of_parents(tree, moved)
    bias = outer.with_drift(twists.cross(held, leaving))
    carrying = _of_carriers(tree, held + leaving, moved + arriving)
    bias += joint.with_drift(twists.cross(carrying, turning))
    bias -= inner.with_drift(twists.cross(moved, arriving))
    own = jnp.concatenate([joint.columns, -inner.columns], axis=1)
    return TreeMotion(place, points, own, outer.columns, moved, bias)


def _parents_axes(tree: Tree, axes: Float[Array, "bodies d d"]) -> Float[Array, "bodies d d"]:
    """The axes of the parents, and of the ground."""
    ground = np.eye(axes.shape[1], dtype=axes.dtype)[None]
    if tree.is_chain:
        return jnp.concatenate([ground, axes[:-1]])
    carriers: Array = jnp.concatenate([axes, ground])[np.array(tree.parents, np.uint32)]
    return carriers
