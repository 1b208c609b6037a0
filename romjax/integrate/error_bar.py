"""How wrong a run is, as far as another one tells."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..system.flags import Flag

# Beyond it an estimate says no more than that a run is wrong.
_USABLE = 0.05
# A group of coordinates that errs by more is named, where the norm does not say so itself.
MUCH = 0.1
# From here on percents are hard to read.
_TIMES = 2.0


class ErrorBar(eqx.Module):
    """The estimated error of a reduced run, which the run that it belongs to has corrected.

    - `error`: of the reduced run, as `Comparison.error`. `by`: what estimates it, in words.
    - `per_group` (g,), `groups`: the errors of each body's position, angle and deflection, as
      `Comparison.per_group`; none where nobody has asked for them.
    - `blind`: the answers that it is known not to hold for, in words; "" where there are none.
    """

    error: Float[Array, ""]
    by: str = eqx.field(static=True)
    per_group: Float[Array, " g"] | tuple[()] = ()
    groups: tuple[str, ...] = eqx.field(static=True, default=())
    blind: str = eqx.field(static=True, default="")

    @property
    def flags(self) -> Array:
        """`Flag.ESTIMATE` beyond the errors up to which a run is of use."""
        return jnp.where(self.error <= _USABLE, 0, int(Flag.ESTIMATE))

    def describe(self) -> str:
        """The estimate in words, such as "5.2e-3 estimated (local, 8 modes)"; what it hides, and
        what it does not tell. Of several runs, those of each lane.
        """
        if np.ndim(self.error):
            return lane_by_lane(ErrorBar.describe, self)
        if not np.all(np.asarray(self.error) <= _USABLE):
            return f"more than {_USABLE:.0%}: not to be used ({self.by})".replace("%", " %")
        digits, power = f"{float(self.error):.1e}".split("e")
        words = f"{digits}e{int(power)} estimated ({self.by})"
        hidden = self.hidden()
        words += f", but {hidden}" if hidden else ""
        return f"{words}; not of {self.blind}" if self.blind else words

    def hidden(self) -> str:
        """What the norm hides, in words; "" where it hides nothing, or the run is of no use. Of
        several runs, that of each lane that hides any.
        """
        return hidden(self.error, self.per_group, self.groups)


def hidden(error: Any, per_group: Any, groups: Sequence[str]) -> str:
    """The group of coordinates that errs most, such as "deflection of rod is wrong by 84 %", if by
    more than a tenth of its own motion, while the `error` of the whole is below; else "". Of
    several runs, those of each lane that has any.
    """
    errors = np.asarray(per_group)
    if np.ndim(error) and errors.size:
        return lane_by_lane(
            lambda lane: hidden(lane[0], lane[1], groups), (np.asarray(error), errors)
        )
    if not errors.size or not np.max(errors) > MUCH or not float(error) <= MUCH:
        return ""
    largest = float(np.max(errors))
    share = f"{100 * largest:.0f} %" if largest < _TIMES else f"{largest:.0f} times its motion"
    return f"{groups[int(np.argmax(errors))]} is wrong by {share}"


def lane_by_lane(describe: Callable[[Any], str], batch: Any) -> str:
    """What is said of each lane of a batch, but for those of which nothing is."""
    return "; ".join(of_lanes(lambda lane: [describe(lane)], batch))


def of_lanes(describe: Callable[[Any], Iterable[str]], batch: Any) -> tuple[str, ...]:
    """All that is said of the lanes of a batch, each with the number of its lane before it."""
    count = len(jax.tree.leaves(batch)[0])
    lanes = (jax.tree.map(lambda x, i=i: x[i], batch) for i in range(count))
    said = ((i, words) for i, lane in enumerate(lanes) for words in describe(lane))
    return tuple(f"lane {i}: {words}" for i, words in said if words)
