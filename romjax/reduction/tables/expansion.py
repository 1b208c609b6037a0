"""The amplitudes of flexible bodies: what they add to the configurations of a table."""

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...compiling.program import program_once
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from ...system.constraints import differentiate
from .frames import Frames
from .grid import Grid


def _pairs(k: int) -> list[tuple[int, int]]:
    return list(itertools.combinations_with_replacement(range(k), 2))


def monomials(amplitudes: Float[Array, " k"]) -> Float[Array, " c"]:
    """μ: 1, δ_a, and δ_a δ_b for a ≤ b, half of it if a = b."""
    k = amplitudes.size
    products = [amplitudes[a] * amplitudes[b] / (1 + (a == b)) for a, b in _pairs(k)]
    return jnp.concatenate(
        [jnp.ones(1, amplitudes.dtype), amplitudes, *(x[None] for x in products)]
    )


def along_motion(x: Float[Array, " k"], v: Float[Array, " k"]) -> tuple[Array, Array, Array]:
    """μ and its first two derivatives by time where the amplitudes change with v."""

    def rate(x: Array) -> tuple[Array, Array]:
        value, first = jax.jvp(monomials, (x,), (v,))
        return value, first

    (value, first), (_, second) = jax.jvp(rate, (x,), (v,))
    return value, first, second


@program_once
def tabulate(
    system: AbstractSystem,
    frames: Frames,
    grid: Grid,
    modes: Any,
) -> Float[Array, "..."]:
    """Polynomials of T, where the amplitudes have the `modes` (n, k)."""

    def expand(q: Array, along: Array) -> Array:
        k = modes.shape[1]
        if not k:
            return q
        (correction, _), rows = frames.slice(system, q, along), np.array(frames.rows)

        # By implicit differentiation of C(q(δ)) = 0: ∂q/∂δ is the mode, less what it violates of
        # the constraints, by the correction C_q⁻¹ of the frames.
        def first(q: Array, direction: Array) -> Array:
            _, violated = jax.jvp(lambda q: frames.violation(system, q), (q,), (direction,))
            return direction - multiply(correction, violated)

        def second(direction: Array) -> Array:
            # C_q q̈ = −(C_q q̇)_q q̇: the second derivative, with slopes in place of velocities.
            state = differentiate(system.constraint, frames.time, q, direction)
            return -multiply(correction, state.curvature[rows])

        slopes = jax.vmap(first, (None, 0))(q, modes.T)
        own = jax.vmap(second)(slopes)
        pairs = np.array([(a, b) for a, b in _pairs(k) if a < b], int).reshape(-1, 2)
        # Polarization: the mixed derivative of a quadratic form is (f(a + b) − f(a) − f(b)) / 2.
        sums = jax.vmap(second)(slopes[pairs[:, 0]] + slopes[pairs[:, 1]])
        mixed = (sums - own[pairs[:, 0]] - own[pairs[:, 1]]) / 2
        numbers = {tuple(pair): number for number, pair in enumerate(pairs)}
        bends = [own[a] if a == b else mixed[numbers[a, b]] for a, b in _pairs(k)]
        return jnp.concatenate([q, slopes.reshape(-1), *bends])

    return grid.polynomials(jax.vmap(expand)(*grid.in_a_row()))
