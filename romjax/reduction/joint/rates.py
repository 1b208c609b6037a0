"""The rates u of a tree and the derivatives of its coordinates z, of which quaternions have more.

A quaternion p of any length has the derivative of the angular velocity ω = 2 E ṗ / s, s = pᵀp, and
one of its length, ln |p|, which no force acts on and whose second derivative is zero. With
r = pᵀṗ, p̈ = ½ Eᵀ (ω̇ + 2 r ω / s) + (2 r² / s − ṗᵀṗ) p / s.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...linalg import quaternions
from ...linalg.indexing import spread
from .tree import Tree

Coordinates = Float[Array, " n"]
Rates = Float[Array, " rates"]


def rates_of(tree: Tree, z: Coordinates, w: Coordinates) -> Rates:
    """The rates u of derivatives w of z."""
    if not tree.spun.rows:
        return w
    spins = quaternions.angular_velocity(tree.spun.take(z), tree.spun.take(w))
    tables = [tree.plain_rates.array, tree.spins.array]
    return spread([tree.plain.take(w), spins], tables, (tree.rates,))


def by_rates(tree: Tree, x: Coordinates) -> Rates:
    """Numbers of the coordinates that are no quaternions, in the order of the rates."""
    if not tree.spun.rows:
        return x
    return spread([tree.plain.take(x)], [tree.plain_rates.array], (tree.rates,))


def pull_back(tree: Tree, z: Coordinates, x: Rates) -> Coordinates:
    """The transpose of `rates_of`: forces on z that do the work of forces on the rates."""
    if not tree.spun.rows:
        return x
    # Torques on ω become forces on p, by the transpose of ω = 2 E ṗ / s.
    forces = quaternions.generalized(tree.spun.take(z), tree.spins.take(x))
    return _coordinates(tree, tree.plain_rates.take(x), forces)


def second_derivative(tree: Tree, z: Coordinates, w: Coordinates, change: Rates) -> Coordinates:
    """The second derivative of z for that of the rates."""
    if not tree.spun.rows:
        return change
    p, rate = tree.spun.take(z), tree.spun.take(w)
    r, s = jnp.sum(p * rate, axis=1, keepdims=True), quaternions.squared(p)[:, None]
    omega = quaternions.angular_velocity(p, rate)
    spins = quaternions.derivative(p, tree.spins.take(change) + 2 * r / s * omega)
    spins += (2 * r**2 / s - jnp.sum(rate**2, axis=1, keepdims=True)) / s * p
    return _coordinates(tree, tree.plain_rates.take(change), spins)


def change_of_rates(tree: Tree, z: Coordinates, w: Coordinates, a: Coordinates) -> Rates:
    """The derivative of the rates for the second one of z."""
    if not tree.spun.rows:
        return a
    change: Rates = jax.jvp(lambda z, w: rates_of(tree, z, w), (z, w), (w, a))[1]
    return change


def of_lengths(tree: Tree, z: Coordinates, x: Coordinates) -> Coordinates:
    """The momenta of the lengths of quaternions, p pᵀ x / s², with an inertia of one."""
    p, own = tree.spun.take(z), tree.spun.take(x)
    s = quaternions.squared(p)[:, None]
    momenta = jnp.sum(p * own, axis=1, keepdims=True) / s**2 * p
    return _coordinates(tree, 0 * tree.plain.take(x), momenta)


def flat(tree: Tree, rows: Float[Array, "bodies motions"], states: Array) -> Rates:
    """The rates u of the rates of each body, and of states."""
    table = tree.motions.array.astype(int)
    tables = [np.where(table < tree.rates, table, -1), tree.states.array[2]]
    return spread([rows, states], tables, (tree.rates,))


def _coordinates(tree: Tree, plain: Array, spun: Array) -> Coordinates:
    return spread([plain, spun], [tree.plain.array, tree.spun.array], (tree.n,))
