"""The change from one chart of minimal coordinates to another, between two steps."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..reduction.lift.atlas import AtlasLift
from ..reduction.lift.base import Reduced
from .post_step import Chart

# A motion leaves its chart where the cosine between its directions and the chart's is less.
_LEAVE = 0.5


class ChartChange(eqx.Module):
    """Changes the chart after each step in which the motion has left its own."""

    atlas: AtlasLift

    @classmethod
    def of(cls, system: Any) -> "ChartChange":
        """Return the object for a system with charts."""
        return cls(system.lift)

    def start(self, system: Any) -> Float[Array, ""]:
        """The chart of the coordinates in which the start is given."""
        return self.atlas.current.astype(system.q0.dtype)

    def in_chart(self, system: Any, chart: Chart) -> Any:
        """The system in the coordinates of one chart."""
        assert chart is not None
        number = jnp.round(jax.lax.stop_gradient(chart)).astype(int)
        return eqx.tree_at(lambda s: s.lift, system, self.atlas.lift(number))

    def after_step(
        self, system: Any, chart: Chart, t: Time, q: Reduced, v: Reduced
    ) -> tuple[Float[Array, ""], Reduced, Reduced]:
        """The state in the chart that the simulation goes on in."""
        assert chart is not None
        motion = system.lift.motion(system.full, t, q, v)
        # In a chart's own directions, tangents are unit vectors; elsewhere longer by 1/cosine.
        stretch = jnp.linalg.norm(self.atlas.root @ motion.tangent, axis=0)
        leave = jnp.max(stretch) > 1 / _LEAVE
        number = self.atlas.number(motion.q)
        # The same physical state by the coordinates of the nearest chart.
        others = self.atlas.lift(number).restrict(system.full, motion.q, motion.v)
        new = (number.astype(chart.dtype), *others)
        chosen: tuple[Float[Array, ""], Reduced, Reduced] = jax.tree.map(
            lambda new, old: jnp.where(leave, new, old), new, (chart, q, v)
        )
        return chosen
