"""Static equilibria."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..arrays import Time, Vector, as_array, concrete
from ..checks import check_finite, check_shape
from ..errors import SimulationError
from ..linalg.dense import multiply
from ..program import program_once
from ..system.base import AbstractSystem, check_system

# Newton steps for one load, and load steps in all.
_STEPS, _LOADS = 12, 200
# The least step of the load, and what is left of the forces, relative to the largest of them.
_LEAST, _BALANCED = 1e-6, 1e-11
# Singular values of the stiffness below this share of the largest belong to neutral motions.
_NEUTRAL = 1e-12


class _Reached(NamedTuple):
    """How far the load has got."""

    q: Float[Array, " n"]
    multipliers: Float[Array, " m"]
    load: Float[Array, ""]  # the share of it
    step: Float[Array, ""]
    count: Any


def equilibrium(
    system: AbstractSystem, q0: Vector | None = None, *, t: ArrayLike = 0.0
) -> Float[Array, " n"]:
    """A static equilibrium of a mechanism: q (n,) with C_qᵀ λ = Q(t, q, 0) and C(t, q) = 0.

    Newton's method in (q, λ) with continuation: forces that balance the start are taken away step
    by step, so that the solution follows from the start, and steps are shorter where Newton's
    method does not converge. Neutral motions, which no force resists, stay as they are at the
    start; joints may repeat each other. Whether the equilibrium is stable says
    `modes(system, q).is_stable`.

    Differentiable with respect to all numbers of the system, by the implicit function theorem, and
    batchable.

    **Arguments:** the `system`, full or reduced; `q0` (n,), from where, its own start unless given;
    time `t` [s].

    Raises SimulationError if the continuation ends (a snap-through, or no equilibrium at all), with
    the share of the load that was reached and the coordinate that is least balanced.
    """
    check_system("equilibrium", system)
    q = system.q0 if q0 is None else as_array(q0)
    check_shape("equilibrium", "q0", q, (system.n,))
    check_finite("equilibrium", "q0", q)
    time = jnp.asarray(t, q.dtype)
    reached, left = _solve(*jax.lax.stop_gradient((system, time, q)))
    load, residual = concrete(reached.load), concrete(left)
    if load is None or residual is None:
        found = eqx.error_if(
            reached.q, reached.load < 1, "equilibrium: the continuation ended before the full load."
        )
    elif load < 1:
        worst = int(np.argmax(np.abs(residual)))
        raise SimulationError(
            f"equilibrium: from the start the solution was followed to {float(load):.4g} of the "
            f"load, and no further: {system.structure.labels[worst]} is unbalanced by "
            f"{residual[worst]:.3g}. The mechanism snaps through there, or has no equilibrium; "
            "start from another q0."
        )
    else:
        found = reached.q
    position: Float[Array, " n"] = _differentiable(system, time, found, reached.multipliers)
    return position


def _residual(
    system: AbstractSystem, t: Time, q: Float[Array, " n"], multipliers: Float[Array, " m"]
) -> Float[Array, " n_plus_m"]:
    """C_qᵀ λ − Q, and C."""
    force = -system.force(t, q, jnp.zeros_like(q))
    if system.m == 0:
        return force
    reaction = jax.grad(lambda q: multiply(multipliers, system.constraint(t, q)))(q)
    return jnp.concatenate([force + reaction, system.constraint(t, q)])


def _newton_matrix(
    system: AbstractSystem, t: Time, q: Float[Array, " n"], multipliers: Float[Array, " m"]
) -> Float[Array, "n_plus_m n_plus_m"]:
    by_q, by_multipliers = jax.jacfwd(_residual, argnums=(2, 3))(system, t, q, multipliers)
    return jnp.concatenate([by_q, by_multipliers], axis=1)


def _least_squares(matrix: Array, right: Array, scale: Array) -> Array:
    """The shortest solution, with rows and columns scaled alike, which knows no units of q."""
    scaled = scale[:, None] * matrix * scale[None]
    size = jnp.max(jnp.abs(scaled), initial=0.0)
    solution: Array = jnp.linalg.lstsq(
        scaled / jnp.where(size > 0, size, 1), scale * right, rcond=_NEUTRAL
    )[0]
    return scale * solution / jnp.where(size > 0, size, 1)


def _scale(system: AbstractSystem, q: Float[Array, " n"]) -> Float[Array, " n_plus_m"]:
    """Displacements by the roots of their masses; multipliers so that C_q has rows of order one."""
    roots = 1 / jnp.sqrt(jnp.diagonal(system.mass(q)))
    return jnp.concatenate([roots, jnp.full(system.m, 1 / jnp.max(roots))])


@program_once
def _solve(
    system: AbstractSystem, t: Float[Array, ""], q0: Float[Array, " n"]
) -> tuple[_Reached, Float[Array, " n"]]:
    n, none = system.n, jnp.zeros(system.m, q0.dtype)
    multipliers = system.state(t, q0, jnp.zeros_like(q0)).solve(none).multipliers
    start = _residual(system, t, q0, multipliers)
    forces = jnp.concatenate([start[:n], none])  # that the start needs to be in balance
    size = jnp.max(jnp.abs(system.force(t, q0, jnp.zeros_like(q0))), initial=0.0)
    size = jnp.maximum(size, jnp.max(jnp.abs(forces), initial=0.0))
    scale = _scale(system, q0)

    def newton(q: Array, multipliers: Array, load: Array) -> tuple[Array, Array, Array]:
        def step(x: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
            q, multipliers = x
            right = _residual(system, t, q, multipliers) - (1 - load) * forces
            change = _least_squares(_newton_matrix(system, t, q, multipliers), right, scale)
            return (q - change[:n], multipliers - change[n:]), None

        (q, multipliers), _ = jax.lax.scan(step, (q, multipliers), None, length=_STEPS)
        right = _residual(system, t, q, multipliers) - (1 - load) * forces
        return q, multipliers, jnp.max(jnp.abs(right), initial=0.0)

    def advance(now: _Reached) -> _Reached:
        load = jnp.minimum(now.load + now.step, 1.0)
        q, multipliers, left = newton(now.q, now.multipliers, load)
        good = left <= _BALANCED * jnp.maximum(size, 1e-300) + 1e-13
        return _Reached(
            jnp.where(good, q, now.q),
            jnp.where(good, multipliers, now.multipliers),
            jnp.where(good, load, now.load),
            jnp.where(good, 2 * now.step, 0.25 * now.step),
            now.count + 1,
        )

    def unfinished(now: _Reached) -> Array:
        going: Array = (now.load < 1) & (now.step > _LEAST) & (now.count < _LOADS)
        return going

    zero, one = jnp.zeros_like(t), jnp.ones_like(t)
    # A start off its constraints is put on them by the first steps.
    begin = _Reached(q0, multipliers, zero, one, jnp.zeros((), int))
    end = jax.lax.while_loop(unfinished, advance, begin)
    left = _residual(system, t, end.q, end.multipliers)[:n]
    return end, left


@program_once
def _differentiable(
    system: AbstractSystem,
    t: Float[Array | np.ndarray, ""],
    q: Float[Array | np.ndarray, " n"],
    multipliers: Float[Array | np.ndarray, " m"],
) -> Float[Array, " n"]:
    """The same q, with the derivative −J⁺ ∂F of the residual F and Newton's matrix J."""
    position, held = (jnp.asarray(jax.lax.stop_gradient(x)) for x in (q, multipliers))
    fixed: Any = jax.lax.stop_gradient(system)
    matrix = _newton_matrix(fixed, jax.lax.stop_gradient(t), position, held)
    right = _residual(system, t, position, held)
    right = right - jax.lax.stop_gradient(right)
    change = _least_squares(matrix, right, jax.lax.stop_gradient(_scale(fixed, position)))
    corrected: Float[Array, " n"] = position - change[: system.n]
    return corrected
