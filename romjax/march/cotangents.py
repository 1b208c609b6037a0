"""Cotangents of what a march gives: those that are missing, and whether any depends on it."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PyTree

from .march import DENSE, EVENTS, OUTPUTS


def uses_later(cotangents: PyTree, number: Int[Array, ""]) -> Array:
    """Whether outputs after the first `number` of them count: where the run did not get there, they
    are no numbers, and neither are their derivatives.
    """

    def counts(x: Array) -> Array:
        late = jnp.arange(len(x)) >= number
        return jnp.any((x != 0) & late.reshape(-1, *[1] * (x.ndim - 1)))

    return jnp.any(jnp.array([counts(x) for x in differentiable(cotangents)], bool))


def is_used(cotangents: PyTree) -> Array:
    """Whether something depends on what has these cotangents."""
    return jnp.any(jnp.array([jnp.any(x != 0) for x in differentiable(cotangents)]))


def differentiable(tree: PyTree) -> list[Array]:
    leaves: list[Array] = jax.tree.leaves(eqx.filter(tree, eqx.is_inexact_array))
    return leaves


def of_followers(cotangents: dict[str, Any], seen: dict[str, PyTree]) -> dict[str, PyTree]:
    """Return the cotangents of what followers have `seen` on which something depends; zeros where
    they are missing.
    """
    moving = {name: eqx.filter(each, eqx.is_inexact_array) for name, each in seen.items()}
    return {
        name: jax.tree.map(_or_zeros, each, cotangents[name])
        for name, each in moving.items()
        if differentiable(cotangents[name])
    }


def of_rows(cotangents: dict[str, Any], seen: dict[str, Any]) -> tuple[PyTree, PyTree, PyTree]:
    """Return the cotangents of outputs, events and dense output, zeros where they are missing."""

    def filled(name: str, part: Callable[[Any], Any] = lambda rows: rows) -> PyTree:
        if name not in seen:
            return None
        return jax.tree.map(_or_zeros, part(seen[name]), part(cotangents[name]))

    return filled(OUTPUTS, lambda saved: saved.rows), filled(EVENTS), filled(DENSE)


def _or_zeros(x: Any, cotangent: Array | None) -> Array:
    return jnp.zeros(x.shape, x.dtype) if cotangent is None else cotangent
