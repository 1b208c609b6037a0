"""The change from one chart of minimal coordinates to another, between two steps."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import Time
from ..reduction.lift.base import Reduced

# A motion leaves its chart where the cosine between its directions and the chart's is less.
_LEAVE = 0.5


class ChartChange(eqx.Module):
    """What a simulation does after each step of a system with charts: it moves on to the chart that
    suits the configuration, where the motion has left its own.

    Charts are numbers, as floats, that the integration carries beside q and v.
    """

    def start(self, system: Any) -> Float[Array, ""]:
        """The chart of the system's coordinates."""
        return system.lift.current.astype(system.q0.dtype)

    def in_chart(self, system: Any, chart: Float[Array, ""]) -> Any:
        """The system in the coordinates of one chart."""
        number = jnp.round(jax.lax.stop_gradient(chart)).astype(int)
        return eqx.tree_at(lambda s: s.lift, system, system.lift.lift(number))

    def after_step(
        self, system: Any, chart: Float[Array, ""], t: Time, z: Reduced, w: Reduced
    ) -> tuple[Float[Array, ""], Reduced, Reduced]:
        """The state in the chart that the simulation goes on in."""
        motion = self.in_chart(system, chart).state(t, z, w).motion
        # In a chart's own directions, tangents are unit vectors; elsewhere longer by 1/cosine.
        stretch = jnp.linalg.norm(system.lift.root @ motion.tangent, axis=0)
        leave = jnp.max(stretch) > 1 / _LEAVE
        number = system.lift.number(motion.q)
        others = system.lift.lift(number).restrict(system.full, motion.q, motion.v)
        new = (number.astype(z.dtype), *others)
        return jax.tree.map(lambda new, old: jnp.where(leave, new, old), new, (chart, z, w))
