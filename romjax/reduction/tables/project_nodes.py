"""Nodes of a table, projected onto the constraints of a system with other numbers."""

from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...compiling.program import program_once
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from .frames import Frames
from .grid import Grid

# Most steps of Newton's method, and the violation at which they end, in units in the last place.
_NEWTON, _ROUNDING = 20, 100


@program_once
def project_nodes(
    system: AbstractSystem,
    frames: Frames,
    grid: Grid,
) -> Float[Array, "*P n"]:
    """Project the nodes onto the constraints of a system, across the table's directions."""
    projected: Array = _on_constraints(system, frames, *grid.in_a_row())
    return projected.reshape(grid.nodes.shape)


def _solve(system: AbstractSystem, frames: Frames, nodes: Array, along: Array) -> Array:
    """Return the projected nodes by Newton's method; NaN if it does not converge."""

    def newton(carry: Any) -> Any:
        q, violation, count = carry
        corrections, _ = jax.vmap(frames.slice, (None, 0, 0))(system, q, along)
        q = q - jnp.einsum("pnm,pm->pn", corrections, violation)
        return q, violate(q), count + 1

    def unfinished(carry: Any) -> Array:
        _, violation, count = carry
        more: Array = (jnp.max(jnp.abs(violation)) > limit) & (count < _NEWTON)
        return more

    def violate(q: Array) -> Array:
        return jax.vmap(frames.violation, (None, 0))(system, q)

    limit = _ROUNDING * jnp.finfo(nodes.dtype).eps * (1 + jnp.max(jnp.abs(nodes)))
    q, violation, _ = jax.lax.while_loop(unfinished, newton, (nodes, violate(nodes), 0))
    return jnp.where(jnp.max(jnp.abs(violation)) <= limit, q, jnp.nan)


def _by_numbers(
    primals: tuple[AbstractSystem, Frames, Array, Array], changes: tuple[Any, Any, Any, Any]
) -> tuple[Array, Array]:
    """Differentiate the nodes by the implicit function theorem: dq = −X dC at the same q."""
    system, frames, _, along = primals
    q = _on_constraints(*primals)

    def change(q: Array, along: Array) -> Array:
        def violation(system: AbstractSystem) -> Array:
            return frames.violation(system, q)

        _, violated = eqx.filter_jvp(violation, (system,), changes[:1])
        if violated is None:  # of numbers that no constraint depends on
            return jnp.zeros_like(q)
        correction, _ = frames.slice(system, q, along)
        return -multiply(correction, violated)

    return q, jax.vmap(change)(q, along)


_on_constraints = cast(Any, eqx.filter_custom_jvp)(_solve)
_on_constraints.def_jvp(_by_numbers)
