"""A run at the ends of its steps."""

from typing import NamedTuple

from jaxtyping import Array, Float


class StepStates(NamedTuple):
    """States at the ends of steps: `t` (s,) [s]; `q`, `v` (s, n)."""

    t: Float[Array, " s"]
    q: Float[Array, "s n"]
    v: Float[Array, "s n"]
