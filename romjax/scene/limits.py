"""Numbers that are cut off at limits."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import concrete
from ..common.errors import SceneError
from .fields import check_numbers


def cut_off(
    x: Float[Array, ""], least: Float[Array, ""] | None, largest: Float[Array, ""] | None
) -> Float[Array, ""]:
    """A number cut off at two values, where they are given."""
    x = x if least is None else jnp.maximum(x, least)
    return x if largest is None else jnp.minimum(x, largest)


def check_limits(
    owner: str,
    part: Any,
    least: str = "least",
    largest: str = "largest",
    prefix: str = "",
    *,
    apart: bool = False,
) -> None:
    """Check the fields of two limits of `part`, each a finite number or None: the lower one is no
    larger than the other, or smaller if they have to be `apart`. `prefix` goes before their names.

    Raises SceneError with owner, fields, values and remedy.
    """
    check_numbers(owner, part, least, largest, prefix=prefix)
    if getattr(part, least) is None or getattr(part, largest) is None:
        return
    low, high = concrete(getattr(part, least)), concrete(getattr(part, largest))
    if low is None or high is None or np.all(low < high if apart else low <= high):
        return
    raise SceneError(
        f"{owner}: {prefix}{least} is {low:g} and {prefix}{largest} {high:g}; give a lower limit "
        f"{'below' if apart else 'not above'} the upper one.",
        field=least,
    )
