"""The twists that unit rates give joints of a tree, and its ports."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common import compat
from ...linalg import quaternions
from ...linalg.indexing import take
from ...scene.marker import Pose
from . import twists
from .spanning import has_own_screws
from .tree import Links, Tree


class Screws(NamedTuple):
    """The twists that rates give some poses, about the origins of what these are relative to.

    - `columns` (count, k, twist): for unit rates; `drift` (count, twist): the derivative of the
      twist for the given rates, where these do not change; None where it is zero.
    """

    columns: Float[Array, "count k twist"]
    drift: Float[Array, "count twist"] | None

    def placed(self, axes: Array, arms: Float[Array, "count d"]) -> "Screws":
        """The twists by the inertial axes, about points from which the origins are at `arms`; the
        drift without that of the `axes`.
        """
        drift = None if self.drift is None else twists.placed(axes, arms, self.drift)
        return Screws(twists.placed(axes[:, None], arms[:, None], self.columns), drift)

    def with_drift(self, x: Float[Array, "count twist"]) -> Float[Array, "count twist"]:
        """`x` and the drift."""
        return x if self.drift is None else x + self.drift

    def velocity(self, u: Float[Array, "count k"]) -> Float[Array, "count twist"]:
        """The twists for rates u."""
        return jnp.sum(self.columns * u[:, :, None], axis=1)


def along_joint(link: Links, z: Float[Array, "count freedoms"]) -> Pose:
    """The first markers in the second ones."""
    # A joint without fields is the same for all.
    axes = 0 if jax.tree.leaves(link.joints) else None
    poses: Pose = jax.vmap(lambda joint, z: joint.place(z), (axes, 0))(link.joints, z)
    return poses


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
    if tree.is_chain:
        return jnp.concatenate([jnp.zeros_like(x[:1]), x[:-1]])
    return take(x, np.array(tree.parents, np.uint32))


def joint_screws(tree: Tree, z: Float[Array, " n"], rates: Float[Array, "bodies rates"]) -> Screws:
    """The screws of the joints in their second markers, as many for each as one has at most."""
    screws = []
    for link in tree.links:
        own, free = link.coordinates.take(z), link.joints.turns_freely
        k = own.shape[1] - free
        u = take(rates, np.array(link.bodies, np.uint32))[:, :k]

        def change(z: Array, u: Array, free: bool = free) -> Array:
            return coordinate_rates(z, u) if free else u

        each = _closed_screws(link, own, u, change)
        if each is None:
            each = screws_of(functools.partial(along_joint, link), own, u, change)
        columns = twists.widened(each.columns, tree.freedoms)
        # Held by its second marker a body moves against the twist that the joint has.
        sign = -1 if link.reversed else 1
        screws.append(Screws(sign * columns, None if each.drift is None else sign * each.drift))
    if any(each.drift is not None for each in screws):
        screws = [Screws(x.columns, x.with_drift(jnp.zeros_like(x.columns[:, 0]))) for x in screws]
    ordered: Screws = in_order(tree, screws)
    return ordered


def _closed_screws(
    link: Links,
    z: Float[Array, "count k"],
    u: Float[Array, "count rates"],
    change: Callable[[Array, Array], Array],
) -> Screws | None:
    """The screws that joints give in closed form; None where they do not."""
    if not has_own_screws(link.joints):
        return None
    axes = 0 if jax.tree.leaves(link.joints) else None

    def columns(z: Array) -> Array:
        each: Array = jax.vmap(lambda joint, z: joint.screws(z), (axes, 0))(link.joints, z)
        return each

    if not compat.depends_on_first(columns, z):
        return Screws(columns(z), None)
    own, slopes = jax.jvp(columns, (z,), (change(z, u),))
    return Screws(own, jnp.sum(slopes * u[:, :, None], axis=1))


def coordinate_rates(
    z: Float[Array, "count k"], u: Float[Array, "count rates"]
) -> Float[Array, "count k"]:
    """The rates of coordinates whose last four are a quaternion."""
    plain, spin = u[:, :-3], u[:, -3:]
    return jnp.concatenate([plain, quaternions.derivative(z[:, -4:], spin)], axis=1)


def port_screws(tree: Tree, z: Float[Array, " n"], rates: Float[Array, "bodies rates"]) -> Screws:
    """The screws of the ports on bodies that deform, one for each amplitude."""
    bending = rates[:, tree.freedoms :]
    both = jnp.concatenate([of_parents(tree, bending), bending])
    amplitudes = port_amplitudes(tree, z)
    return screws_of(tree.ports.local, amplitudes, both, lambda _, u: u)


def screws_of(
    pose: Callable[[Array], Pose],
    z: Float[Array, "count k"],
    u: Float[Array, "count rates"],
    change: Callable[[Array, Array], Array],
) -> Screws:
    """The twists of poses that are functions of z, with rates ż = `change`(z, u)."""
    count, k = u.shape
    if not k:
        none = jnp.zeros((count, 0, 3 if pose(z).dimension == 2 else 6), z.dtype)
        return Screws(none, None)

    def columns(z: Array) -> Array:
        def velocity(unit: Array) -> Array:
            return twists.local_twist(*jax.jvp(pose, (z,), (change(z, unit),)))

        each: Array = jax.vmap(velocity, out_axes=1)(twists.units(count, k, z.dtype))
        return each

    own, slopes = jax.jvp(columns, (z,), (change(z, u),))
    return Screws(own, jnp.sum(slopes * u[:, :, None], axis=1))
