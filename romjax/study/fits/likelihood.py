"""The likelihood of measurements, for Bayesian identification."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ...common.arrays import concrete
from ...common.errors import InputError
from ...integrate.doubt import telling


def log_likelihood(
    predict: Callable[[Any], Any], parameters: Any, measured: ArrayLike, noise: ArrayLike
) -> Float[Array, ""]:
    """The logarithm of the density of measurements with normal, independent noise,
    −½ Σ ((predicted − measured) / noise)² − Σ log(noise √2π).

    Differentiable in both modes, so that samplers that follow gradients (NUTS) can take it, with a
    prior, for the logarithm of the posterior density. A run that fails, or a prediction that is not
    finite, has the likelihood zero: −∞. Runs that fail or are doubtful warn when the program runs,
    but for those in functions that `predict` calls and that are compiled already.

    **Arguments:**

    - `predict`, `measured`: as `fit` takes them: a run, seen by sensors, and what was measured,
      with NaN where nothing was. Simulate with `throw=False` in it; `audit=False` is faster, and
      does not look whether energy balances.
    - `parameters`: where, a pytree.
    - `noise`: standard deviation, of any shape that broadcasts; may be one of the parameters.

    Raises InputError for a noise that is not positive, measurements of which none is finite, or a
    prediction of another shape.
    """
    data = jnp.asarray(measured, float)
    given = concrete(jnp.asarray(noise))
    if given is not None and not np.all(given > 0):
        raise InputError(f"log_likelihood: noise is {given}, but it must be positive.")
    with telling("log_likelihood"):
        predicted = jnp.asarray(predict(parameters))
    if predicted.shape != data.shape:
        raise InputError(
            f"log_likelihood: predict returns the shape {predicted.shape}, but measured has "
            f"{data.shape}."
        )
    spread = jnp.broadcast_to(jnp.asarray(noise, data.dtype), data.shape)
    present = jnp.isfinite(data)
    known = concrete(present)
    if known is not None and not np.any(known):
        raise InputError("log_likelihood: nothing was measured: no entry of measured is finite.")
    finite = jnp.all(jnp.isfinite(predicted) | ~present)
    # What is not finite is left out before it is squared: its derivative would be NaN.
    usable = present & jnp.isfinite(predicted)
    residual = jnp.where(usable, predicted, 0) - jnp.where(usable, data, 0)
    terms = 0.5 * (residual / spread) ** 2 + jnp.log(spread) + 0.5 * jnp.log(2 * jnp.pi)
    return jnp.where(finite, -jnp.sum(jnp.where(usable, terms, 0)), -jnp.inf)
