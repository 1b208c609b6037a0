"""How small the changes of quantities are that a run tells apart, whatever size its motion has."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .tolerances import Reach, Tolerances

# A quantity counts as at its level if the state, within so many tolerances, may be on either side.
_FLOOR = 10.0
# Rounding errors of values, in units in the last place of the largest coordinate.
_ROUNDING = 100
# Steps of this share of the run turn allowed errors of positions into allowed errors of velocities.
_STEP = 1e-3


class Scales(NamedTuple):
    """The smallest changes of the quantities of events that a run can tell apart so far.

    - `floor` (events,): how far from its level a quantity is told apart from it. `least` (events,):
      the least rate of a gap that is told apart from zero. `noise` (events,): what of the values is
      rounding.
    - `reach`: how far the motion has got. `by_q`, `by_v` (events, n): the sizes of the slopes of
      the quantities at the start.
    """

    floor: Float[Array, " events"]
    least: Float[Array, " events"]
    noise: Float[Array, " events"]
    reach: Reach
    by_q: Float[Array, "events n"]
    by_v: Float[Array, "events n"]

    @classmethod
    def of(
        cls,
        tolerances: Tolerances,
        reach: Reach,
        y: Any,
        slopes: tuple[Float[Array, "events n"], Float[Array, "events n"]],
        span: Float[Array, ""],
    ) -> "Scales":
        """Return the scales in the state `y` of a run that lasts for `span` [s]."""
        by_q, by_v = (jnp.abs(jax.lax.stop_gradient(x)) for x in slopes)
        q_errors, v_errors = (
            _FLOOR * x for x in tolerances.errors(reach, y[0][None], y[1][None], _STEP * span)
        )
        # By the slopes of the quantity, errors of the state are errors of its value, and those of
        # velocities, of its rate.
        floor, least = by_q @ q_errors + by_v @ v_errors, by_q @ v_errors
        unit = _ROUNDING * jnp.finfo(floor.dtype).eps
        return cls(
            floor, least, unit * (by_q @ reach.farthest + by_v @ reach.speed), reach, by_q, by_v
        )

    def after(
        self,
        tolerances: Tolerances,
        y0: Any,
        y1: Any,
        span: Float[Array, ""],
        keep: Bool[Array, ""],
    ) -> "Scales":
        """Return the scales after a step from the state `y0` to `y1`, if it was kept."""
        reach = tolerances.after(self.reach, y0, y1)
        later = Scales.of(tolerances, reach, y1, (self.by_q, self.by_v), span)
        scales: Scales = jax.tree.map(lambda a, b: jnp.where(keep, a, b), later, self)
        return scales
