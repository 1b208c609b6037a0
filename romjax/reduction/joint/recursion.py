"""Accelerations of a tree by articulated bodies, from the tips to the ground and back."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...linalg.dense import invert, multiply
from .kinematics import TreeMotion
from .tree import Tree

Carry = tuple[Array, Array]


def accelerations(
    tree: Tree,
    motion: TreeMotion,
    inertia: Float[Array, "bodies size size"],
    bias: Float[Array, "bodies size"],
    lumped: Float[Array, " rates"] | None,
    pushed: Float[Array, " rates"] | None,
) -> tuple[Float[Array, "bodies rates"], Float[Array, "bodies twist"]]:
    """The derivatives of the rates w, and of the twists V, of all bodies.

    The equations of a body by y = (V, η) are M ẏ + b = what its joints do to it. With the parent's
    port at the acceleration P, V̇ = P + Bᵀ ẇ + c and N = (B, E), the virtual work of ẇ gives

        N M Nᵀ ẇ = −N (b + M c) − N M P,

    so that the body and all that it holds act on the port as K P + k would, K = M_VV − M_VN
    (N M Nᵀ)⁻¹ M_NV: an articulated body, which is added to the parent (Featherstone, "Rigid Body
    Dynamics Algorithms", 2008, chapter 7). O(N), in two loops whose programs are the same for any
    number of bodies.

    **Arguments:** the `tree` and its `motion`; `inertia` and `bias` are M and b of each body;
    `lumped`, `pushed`: what N M Nᵀ has more on its diagonal, and the forces on the rates beside
    those on bodies, by the rates of the tree.
    """
    d, dtype = motion.twists.shape[1], inertia.dtype
    added = _added(tree, lumped, dtype)
    forces = None if pushed is None else tree.motions.take(pushed)
    columns = (motion.own, motion.outer, motion.bias)
    unit = np.eye(motion.own.shape[1], dtype=dtype)

    def fold(descendants: Carry, at: Any) -> tuple[Carry, Any]:
        """Join a body, with all that it holds, to its parent."""
        (own, outer, drift), inertia, bias, pad, force = at
        inertia, bias = inertia + descendants[0], bias + descendants[1]
        # b + M c: what the body asks for while no rate changes and its port does not accelerate.
        bias = bias + multiply(inertia[:, :d], drift)
        moved = multiply(own, inertia[:d])
        forced = multiply(own, bias[:d])
        if force is not None:
            forced = forced - force
        inner = own
        if tree.modes:
            k = tree.freedoms
            moved = jnp.concatenate([moved[:k], moved[k:] + inertia[d:]])
            forced = jnp.concatenate([forced[:k], forced[k:] + bias[d:]])
            inner = jnp.concatenate([own, _modal_rows(k, tree.modes, dtype)], axis=1)
        square = multiply(moved, inner.T)
        if pad is not None:
            square += pad[:, None] * unit
        inverse = 1 / square if len(square) == 1 else invert(square)
        follow, freely = multiply(inverse, moved[:, :d]), -multiply(inverse, forced)
        # K and k: the Schur complement of the rates.
        stiff = inertia[:d, :d] - multiply(moved[:, :d].T, follow)
        offset = bias[:d] + multiply(moved[:, :d].T, freely)
        if tree.modes:
            across = jnp.concatenate([jnp.eye(d, dtype=dtype), outer])
            stiff, offset = multiply(multiply(across, stiff), across.T), multiply(across, offset)
        return (stiff, offset), (follow, freely)

    size = inertia.shape[1]
    none = (jnp.zeros((size, size), dtype), jnp.zeros(size, dtype))
    articulated = _to_ground(tree, fold, none, (columns, inertia, bias, added, forces))

    def follow(port: Carry, at: Any) -> tuple[Carry, Any]:
        """Give a body its acceleration, from the twist and the amplitudes of its parent."""
        (own, outer, drift), (follow, freely) = at
        before, bending = port
        if tree.modes:
            before = before + multiply(bending, outer)
        rates = freely - multiply(follow, before)
        after = before + multiply(rates, own) + drift
        return (after, rates[tree.freedoms :]), rates

    start = (jnp.zeros(d, dtype), jnp.zeros(tree.modes, dtype))
    rates, twists = _from_ground(tree, follow, start, (columns, articulated))
    return rates, twists


def _modal_rows(freedoms: int, modes: int, dtype: np.dtype) -> np.ndarray:
    """Mark the rates w that are those of amplitudes."""
    return np.eye(freedoms + modes, modes, -freedoms, dtype=dtype)


def _added(
    tree: Tree, lumped: Float[Array, " rates"] | None, dtype: np.dtype
) -> Float[Array, "bodies rates"] | None:
    """The `lumped` inertias of rates, and ones for those that bodies with fewer freedoms or modes
    than others have not; None where there are neither.
    """
    # Joints have rows for the most freedoms of any; ones on the diagonal keep the matrices of
    # others regular.
    unused = tree.motions.array == tree.rates
    ones = jnp.asarray(unused, dtype) if unused.any() else None
    if lumped is None:
        return ones
    own = tree.motions.take(lumped)
    return own if ones is None else own + ones


def _to_ground(tree: Tree, fold: Any, none: Carry, rows: Any) -> Any:
    """Run from the tips to the ground: what each body gives is carried to its parent."""
    if tree.is_chain:
        return jax.lax.scan(fold, none, rows, reverse=True)[1]

    # In a tree with branches the parent is not the body before, and is looked up in a table. The
    # ground has the last row.
    def step(articulated: Carry, at: Any) -> tuple[Carry, Any]:
        i, parent, own = at
        given, result = fold(jax.tree.map(lambda x: x[i], articulated), own)
        return jax.tree.map(lambda x, more: x.at[parent].add(more), articulated, given), result

    empty = jax.tree.map(lambda x: jnp.zeros((tree.count + 1, *x.shape), x.dtype), none)
    return jax.lax.scan(step, empty, (*_numbers(tree), rows), reverse=True)[1]


def _from_ground(tree: Tree, follow: Any, start: Carry, rows: Any) -> Any:
    """Run from the ground to the tips: the rates of all bodies, and their twists' derivatives."""

    def both(before: Carry, own: Any) -> tuple[Carry, Any]:
        after, rates = follow(before, own)
        return after, (rates, after[0])

    if tree.is_chain:
        return jax.lax.scan(both, start, rows)[1]

    def step(held: Carry, at: Any) -> tuple[Carry, Any]:
        i, parent, own = at
        after, result = both(jax.tree.map(lambda x: x[parent], held), own)
        return jax.tree.map(lambda x, new: x.at[i].set(new), held, after), result

    empty = jax.tree.map(lambda x: jnp.zeros((tree.count + 1, *x.shape), x.dtype), start)
    return jax.lax.scan(step, empty, (*_numbers(tree), rows))[1]


def _numbers(tree: Tree) -> tuple[Array, Array]:
    return jnp.arange(tree.count), jnp.array(tree.parents)
