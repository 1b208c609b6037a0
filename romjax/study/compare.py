"""How far an approximate motion is from the true one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..arrays import concrete
from ..integrate.trajectory import Trajectory


class Comparison(eqx.Module):
    """The errors of one motion against another.

    - `error`: ‖M₀^½ (q̃ − q)‖ / ‖M₀^½ (q − q₀)‖ over all output times, M₀ the mass matrix at the
      start: one number without units. Of a motion that rests, the absolute ‖M₀^½ (q̃ − q)‖.
    - `history` (k, n): the chapter's equation 39.17, Δq_i(t) / max |q_i − q_i(0)|.
    - `per_coordinate` (n,): its largest magnitude in time.
    - `moving` (n,): which coordinates move at all; where one rests, the two above hold the
      absolute error, since a relative one has no meaning.
    - `drift`: largest |C| of the approximate motion.
    - `steps`: steps of the true and of the approximate run.
    """

    error: Float[Array, ""]
    history: Float[Array, "k n"]
    per_coordinate: Float[Array, " n"]
    moving: Bool[Array, " n"]
    drift: Float[Array, ""]
    steps: tuple[Int[Array, ""], Int[Array, ""]]


def compare(truth: Trajectory, approx: Trajectory) -> Comparison:
    """The errors of `approx` against `truth`, at the same times and in the same coordinates.

    Raises ValueError if times or coordinates do not fit.
    """
    if truth.q.shape != approx.q.shape:
        raise ValueError(
            f"compare: the motions have shapes {truth.q.shape} and {approx.q.shape} (times, "
            "coordinates); simulate both at the same times."
        )
    t, other = concrete(truth.t), concrete(approx.t)
    if t is not None and other is not None and not np.allclose(t, other, rtol=1e-6):
        raise ValueError("compare: the motions have different times; simulate both at the same.")
    comparison: Comparison = _compare(truth, approx)
    return comparison


@jax.jit
def _compare(truth: Trajectory, approx: Trajectory) -> Comparison:
    difference = truth.q - approx.q
    motion = truth.q - truth.q[:1]
    root = jnp.linalg.cholesky(truth.metric)
    # Rest, up to rounding: a coordinate of order one cannot move by less than this.
    scale = jnp.maximum(1.0, jnp.max(jnp.abs(truth.q), axis=0))
    reach = jnp.max(jnp.abs(motion), axis=0)
    moving = reach > 100 * jnp.finfo(motion.dtype).eps * scale
    size = _norm(motion @ root)
    history = difference / jnp.where(moving, reach, 1)[None]
    return Comparison(
        error=_norm(difference @ root) / jnp.where(size > 0, size, 1),
        history=history,
        per_coordinate=jnp.max(jnp.abs(history), axis=0),
        moving=moving,
        drift=jnp.max(approx.violation),
        steps=(truth.stats.num_steps, approx.stats.num_steps),
    )


def _norm(x: Float[Array, "k n"]) -> Float[Array, ""]:
    """Euclidean norm whose gradient is zero, not NaN, where x vanishes."""
    squared = jnp.sum(x**2)
    some = squared > 0
    return jnp.where(some, jnp.sqrt(jnp.where(some, squared, 1)), 0)
