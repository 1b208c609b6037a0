"""Controllers with a clock, at the ends of steps."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..assembly.assembled import controllers_of
from ..common.arrays import Time
from ..system.base import AbstractSystem
from .post_step import Chart, PostStep


class Ticking(eqx.Module):
    """Lets controllers act after each step that ends at one of their ticks, and after what the
    `inner` object changes there.
    """

    inner: PostStep | None

    def start(self, system: AbstractSystem) -> Chart:
        return None if self.inner is None else self.inner.start(system)

    def in_chart(self, system: AbstractSystem, chart: Chart) -> AbstractSystem:
        return system if self.inner is None else self.inner.in_chart(system, chart)

    def after_step(
        self,
        system: AbstractSystem,
        chart: Chart,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
    ) -> tuple[Chart, Float[Array, " n"], Float[Array, " n"]]:
        # Projection first: what controllers measure is on the constraints.
        if self.inner is not None:
            chart, q, v = self.inner.after_step(system, chart, t, q, v)
        return chart, *ticked(system, jnp.asarray(t, q.dtype), q, v)


def ticks(system: AbstractSystem) -> bool:
    """Whether a system has controllers with a clock."""
    return bool(controllers_of(system))


def ticked(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"], v: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Positions, and velocities in which controllers have set what they hold, if t is one of their
    ticks.

    The positions are as they were, but change with the time of a tick as the motion does.
    """
    for controller in controllers_of(system):
        q, v = controller.ticked(system, t, q, v)
    return q, v


class UntilTick(eqx.Module):
    """How long a step may be [s]: up to the next tick of any controller, and as `other` says."""

    controllers: tuple[Any, ...]
    other: Any

    @classmethod
    def of(cls, system: AbstractSystem, other: Any) -> Any:
        """Return the function; `other` alone where nothing ticks."""
        return cls(controllers_of(system), other) if ticks(system) else other

    def __call__(self, t: Float[Array, ""]) -> Float[Array, ""]:
        each = [controller.sampled.until_tick(t) for controller in self.controllers]
        others = [] if self.other is None else [self.other(t)]
        return jnp.min(jnp.stack(each + others))
