"""A run at the ends of its steps."""

from typing import NamedTuple

from jaxtyping import Array, Float

from ..common.described import Described


class StepStates(NamedTuple):
    """States at the ends of steps: `t` (s,) [s]; `q`, `v` (s, n)."""

    t: Float[Array, " s"]
    q: Float[Array, "s n"]
    v: Float[Array, "s n"]

    @staticmethod
    def arrays() -> dict[str, Described]:
        """Return the descriptions of its arrays in files, by their names."""
        return {
            "t": Described(("step",), "s", "when steps ended"),
            "q": Described(("step", "coordinate"), "", "generalized coordinates then"),
            "v": Described(("step", "coordinate"), "", "their rates then"),
        }
