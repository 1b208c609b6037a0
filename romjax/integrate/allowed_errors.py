"""Errors of a run that its tolerances allow, in the energy norm."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..compiling.program import program


@program
def allowed_errors(
    t: Float[Array, " k"],
    v: Float[Array, "k n"],
    metric: Float[Array, "n n"],
    rtol: Any,
    atol: Any,
    fastest: Any,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Return the allowed errors of positions and of velocities; see `Trajectory.noise`."""
    span, count = t[-1] - t[0], 2 * v.shape[1]
    allowed = atol + rtol * jnp.sqrt(jnp.mean(v**2, axis=0))
    # The control looks at the root mean square over all coordinates and velocities.
    speed = jnp.sqrt(count * jnp.sum(jnp.diagonal(metric) * allowed**2) * span)
    # An error of velocities at the frequency ω is one of positions by 1/ω; no frequency counts as
    # less than a period in the run.
    return speed / jnp.maximum(fastest, 2 * jnp.pi / span), speed
