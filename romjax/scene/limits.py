"""Numbers that are cut off at limits."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def cut_off(
    x: Float[Array, ""], least: Float[Array, ""] | None, largest: Float[Array, ""] | None
) -> Float[Array, ""]:
    """A number cut off at two values, where they are given."""
    x = x if least is None else jnp.maximum(x, least)
    return x if largest is None else jnp.minimum(x, largest)
