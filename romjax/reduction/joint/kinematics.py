"""The motion of a tree: frames, twists, and what accelerations have without those of the joints."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly import planar, spatial
from ...linalg import quaternions
from ...linalg.indexing import take
from ...scene.marker import Pose
from . import twists
from .tree import Links, Tree


class Edges(NamedTuple):
    """What is between the frames of each body and of its parent, by the axes of each.

    - `outer`, `inner`: the poses of the ports on the parent and on the body. `joint`: the pose of
      the body's port in the parent's.
    """

    outer: Pose
    joint: Pose
    inner: Pose

    def relative(self, dimension: int) -> Pose:
        """The frames of the bodies in those of their parents."""
        compose = (planar if dimension == 2 else spatial).compose
        joined: Pose = compose(compose(self.outer, self.joint), twists.inverse(self.inner))
        return joined


class Screws(NamedTuple):
    """The twists that rates give some poses, about the origins of what these are relative to.

    - `columns` (count, k, twist): for unit rates; `drift` (count, twist): the derivative of the
      twist for the given rates, where these do not change.
    """

    columns: Float[Array, "count k twist"]
    drift: Float[Array, "count twist"]

    def placed(self, axes: Array, arms: Float[Array, "count d"]) -> "Screws":
        """The twists by the inertial axes, about points from which the origins are at `arms`; the
        drift without that of the `axes`.
        """
        return Screws(
            twists.placed(axes[:, None], arms[:, None], self.columns),
            twists.placed(axes, arms, self.drift),
        )

    def velocity(self, u: Float[Array, "count k"]) -> Float[Array, "count twist"]:
        """The twists for rates u."""
        return jnp.sum(self.columns * u[:, :, None], axis=1)


class TreeMotion(NamedTuple):
    """The motion of all bodies, by the inertial axes and about the point of each one's branch.

    - `frames`: of the bodies. `arms`: where they are from `points`, those that vectors are about.
    - `own` (bodies, rates, twist): B of V = P + Bᵀ w, where P is the twist of the parent's port;
      `outer` (bodies, modes, twist): Φ of P = V + Φᵀ η of the parent.
    - `twists`: V. `bias`: the derivative of V − P + Φᵀ η, where no rate changes.
    """

    frames: Pose
    points: Float[Array, "bodies d"]
    own: Float[Array, "bodies rates twist"]
    outer: Float[Array, "bodies modes twist"]
    twists: Float[Array, "bodies twist"]
    bias: Float[Array, "bodies twist"]

    @property
    def arms(self) -> Float[Array, "bodies d"]:
        """Where the frames are from the points."""
        return self.frames.position - self.points


def edges(tree: Tree, z: Float[Array, " n"]) -> Edges:
    """The poses of ports and joints at the coordinates z."""
    outer, inner = _halves(tree.ports.local(port_amplitudes(tree, z)))
    poses = [_place(link, link.coordinates.take(z)) for link in tree.links]
    return Edges(outer, in_order(tree, poses), inner)


def _place(link: Links, z: Float[Array, "count freedoms"]) -> Pose:
    """The ports of bodies in those of their parents."""
    # A joint without fields is the same for all.
    axes = 0 if jax.tree.leaves(link.joints) else None
    poses: Pose = jax.vmap(lambda joint, z: joint.place(z), (axes, 0))(link.joints, z)
    return twists.inverse(poses) if link.reversed else poses


def in_order(tree: Tree, parts: list[Any]) -> Any:
    """Rows of all links, in the order of the tree."""
    order = np.argsort(np.concatenate([link.bodies for link in tree.links]), kind="stable")
    return jax.tree.map(lambda *x: take(jnp.concatenate(x), order), *parts)


def port_amplitudes(tree: Tree, z: Float[Array, " n"]) -> Float[Array, "ports modes"]:
    """The amplitudes of the body of each port."""
    own = tree.amplitudes.take(z)
    return jnp.concatenate([of_parents(tree, own), own])


def of_parents(tree: Tree, x: Float[Array, "bodies *k"]) -> Float[Array, "bodies *k"]:
    """The rows of the parents; zeros for the ground."""
    return take(x, np.array(tree.parents, np.uint32))


def _halves(ports: Any) -> tuple[Any, Any]:
    count = len(jax.tree.leaves(ports)[0]) // 2
    return jax.tree.map(lambda x: x[:count], ports), jax.tree.map(lambda x: x[count:], ports)


def frames(tree: Tree, between: Edges) -> Pose:
    """The frames of all bodies.

    Only the product of rotations in space is a loop; places are sums along the branches.
    """
    d = between.outer.dimension
    relative = between.relative(d)
    if d == 2:
        turns = along(tree, relative.turn)
    else:
        turns = _rotations(tree, relative.turn)
        turns /= jnp.sqrt(quaternions.squared(turns))[:, None]
    before = _parents_axes(tree, twists.axes(turns))
    return Pose(along(tree, twists.rotated(before, relative.position)), turns)


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
    between = twists.kept(edges(tree, z))
    place = twists.kept(frames(tree, between))
    points = twists.stopped(take(place.position, np.array(tree.roots, np.uint32)))
    rates = tree.motions.take(u)
    axes = twists.axes(place.turn)
    before = twists.kept(_parents_axes(tree, axes))
    arms = of_parents(tree, place.position) - points
    reach = arms + twists.rotated(before, between.outer.position)
    ports = twists.kept(twists.composed(before, twists.axes(between.outer.turn)))
    joint = twists.kept(_joint_screws(tree, z, rates).placed(ports, reach))
    turning = joint.velocity(rates[:, : tree.freedoms])
    if not tree.modes:
        moved = twists.kept(along(tree, turning))
        bias = twists.cross(of_parents(tree, moved), turning) + joint.drift
        return TreeMotion(place, points, joint.columns, joint.columns[:, :0], moved, bias)
    outer, inner = _halves(_port_screws(tree, z, rates))
    outer, inner = outer.placed(before, arms), inner.placed(axes, place.position - points)
    bending = rates[:, tree.freedoms :]
    leaving, arriving = outer.velocity(of_parents(tree, bending)), inner.velocity(bending)
    moved = twists.kept(along(tree, leaving + turning - arriving))
    held = of_parents(tree, moved)
    bias = twists.cross(held, leaving) + outer.drift
    bias += twists.cross(held + leaving, turning) + joint.drift
    bias -= twists.cross(moved, arriving) + inner.drift
    own = jnp.concatenate([joint.columns, -inner.columns], axis=1)
    return TreeMotion(place, points, own, outer.columns, moved, bias)


def _parents_axes(tree: Tree, axes: Float[Array, "bodies d d"]) -> Float[Array, "bodies d d"]:
    """The axes of the parents, and of the ground."""
    on_ground = (np.array(tree.parents) == tree.count).astype(axes.dtype)
    unit = np.eye(axes.shape[1], dtype=axes.dtype)
    found: Array = of_parents(tree, axes) + on_ground[:, None, None] * unit[None]
    return found


def _joint_screws(tree: Tree, z: Float[Array, " n"], rates: Float[Array, "bodies rates"]) -> Screws:
    """Those of the joints, padded to the one with most freedoms."""
    found = []
    for link in tree.links:
        own, free = link.coordinates.take(z), link.joints.turns_freely
        k = own.shape[1] - free
        u = take(rates, np.array(link.bodies, np.uint32))[:, :k]

        def change(z: Array, u: Array, free: bool = free) -> Array:
            return _coordinate_rates(z, u) if free else u

        each = _screws(functools.partial(_place, link), own, u, change)
        columns = twists.widened(each.columns, tree.freedoms)
        found.append(each._replace(columns=columns))
    ordered: Screws = in_order(tree, found)
    return ordered


def _coordinate_rates(
    z: Float[Array, "count k"], u: Float[Array, "count rates"]
) -> Float[Array, "count k"]:
    """The rates of coordinates whose last four are a quaternion."""
    plain, spin = u[:, :-3], u[:, -3:]
    return jnp.concatenate([plain, quaternions.derivative(z[:, -4:], spin)], axis=1)


def _port_screws(tree: Tree, z: Float[Array, " n"], rates: Float[Array, "bodies rates"]) -> Screws:
    """Those of the ports on bodies that deform."""
    bending = rates[:, tree.freedoms :]
    both = jnp.concatenate([of_parents(tree, bending), bending])
    return _screws(tree.ports.local, port_amplitudes(tree, z), both, lambda _, u: u)


def _screws(
    pose: Callable[[Array], Pose],
    z: Float[Array, "count k"],
    u: Float[Array, "count rates"],
    change: Callable[[Array, Array], Array],
) -> Screws:
    """The twists of poses that are functions of z, with rates ż = `change`(z, u)."""
    count, k = u.shape
    if not k:
        none = jnp.zeros((count, 3 if pose(z).dimension == 2 else 6), z.dtype)
        return Screws(none[:, None][:, :0], none)

    def columns(z: Array) -> Array:
        def velocity(unit: Array) -> Array:
            return twists.local_twist(*jax.jvp(pose, (z,), (change(z, unit),)))

        each: Array = jax.vmap(velocity, out_axes=1)(twists.units(count, k, z.dtype))
        return each

    own, slopes = jax.jvp(columns, (z,), (change(z, u),))
    return Screws(own, jnp.sum(slopes * u[:, :, None], axis=1))
