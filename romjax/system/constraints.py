"""Constraints along a motion, by autodiff from the residual C(t, q) alone."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.arrays import Time
from .stabilization import Baumgarte

Constraint = Callable[..., Float[Array, " m"]]


class ConstraintState(NamedTuple):
    """The constraints and their rates along a motion."""

    violation: Float[Array, " m"]  # C
    rate: Float[Array, " m"]  # Ċ = C_q v + C_t
    curvature: Float[Array, " m"]  # C̈ = C_q a + (C_q v)_q v + 2 C_qt v + C_tt


def differentiate(
    constraint: Constraint,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    a: Float[Array, " n"] | None = None,
) -> ConstraintState:
    """C, Ċ and C̈ (without an acceleration `a`, C̈ without its part C_q a).

    By two nested derivatives along the motion, time included. A constraint that ignores t leaves no
    trace of it: its tangent is symbolically zero.
    """
    t = jnp.asarray(t, q.dtype)
    one = jnp.ones_like(t)

    def rate(t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        value, derivative = jax.jvp(constraint, (t, q), (one, v))
        return value, derivative

    if a is None:
        outer = jax.jvp(lambda t, q: rate(t, q, v), (t, q), (one, v))
    else:
        outer = jax.jvp(rate, (t, q, v), (one, v, a))
    (violation, first), (_, curvature) = outer
    return ConstraintState(violation, first, curvature)


def right_hand_side(
    constraint: Constraint,
    m: int,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None,
    known: ConstraintState | None = None,
) -> Float[Array, " m"]:
    """γ = −(C_q v)_q v − 2 C_qt v − C_tt − α Ċ − β C of C_q v̇ = γ (chapter equation 39.3).

    Nothing is traced where there are no constraints, or where they are `known`, but for C_q a.
    """
    if m == 0:
        return jnp.zeros(0, q.dtype)
    state = differentiate(constraint, t, q, v) if known is None else known
    if stabilization is None:
        return -state.curvature
    return -state.curvature - stabilization.term(state.violation, state.rate)
