"""Minimal coordinates in several charts, and the change from one to another."""

from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...arrays import Time
from ...system.base import AbstractSystem
from ..atlas import Atlas
from .base import AbstractLift, Motion
from .implicit import ImplicitLift

# A motion leaves its chart where the cosine between its directions and the chart's is less.
_LEAVE = 0.5


class AtlasLift(AbstractLift):
    """Several implicit lifts, of which `current` says to which the coordinates refer.

    All freedoms are in each: of a subspace of them, two charts would hold two different motions.
    """

    lifts: ImplicitLift  # stacked
    current: Int[Array, ""]
    root: Float[Array, "n n"]  # R with RᵀR the metric
    seen: Float[Array, "P n"]  # R q of snapshots
    owners: Int[Array, " P"]  # and the chart that suits each best
    chart: Atlas

    @classmethod
    def of(
        cls, lifts: list[ImplicitLift], q: Float[Array, "h n"], root: Array, atlas: Atlas
    ) -> "AtlasLift":
        """From the lift of each chart; in the chart of the first of the snapshots `q`."""
        stacked = jax.tree.map(lambda *x: jnp.stack([jnp.asarray(y) for y in x]), *lifts)
        owners = jnp.asarray(atlas.owners)
        return cls(stacked, owners[0], root, q[atlas.seen] @ root.T, owners, atlas)

    def lift(self, number: Int[Array, ""]) -> ImplicitLift:
        """That of one chart."""
        return jax.tree.map(lambda x: x[number], self.lifts)

    def number(self, q: Float[Array, " n"]) -> Int[Array, ""]:
        """The chart of the nearest snapshot."""
        distances = jnp.sum((self.seen - (self.root @ q)[None]) ** 2, axis=1)
        return self.owners[jnp.argmin(distances)]

    def position(self, full: AbstractSystem, t: Time, z: Float[Array, " r"]) -> Float[Array, " n"]:
        return self.lift(self.current).position(full, t, z)

    def motion(
        self, full: AbstractSystem, t: Time, z: Float[Array, " r"], w: Float[Array, " r"]
    ) -> Motion:
        return self.lift(self.current).motion(full, t, z, w)

    def restrict(
        self, full: AbstractSystem, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
        return self.lift(self.current).restrict(full, q, v)

    def with_full(self, full: AbstractSystem) -> Self:
        lifts = jax.vmap(lambda lift: lift.with_full(full))(self.lifts)
        return eqx.tree_at(lambda atlas: atlas.lifts, self, lifts)


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
        self,
        system: Any,
        chart: Float[Array, ""],
        t: Time,
        z: Float[Array, " r"],
        w: Float[Array, " r"],
    ) -> tuple[Float[Array, ""], Float[Array, " r"], Float[Array, " r"]]:
        """The state in the chart that the simulation goes on in."""
        motion = self.in_chart(system, chart).state(t, z, w).motion
        # In a chart's own directions, tangents are unit vectors; elsewhere longer by 1/cosine.
        stretch = jnp.linalg.norm(system.lift.root @ motion.tangent, axis=0)
        leave = jnp.max(stretch) > 1 / _LEAVE
        number = system.lift.number(motion.q)
        others = system.lift.lift(number).restrict(system.full, motion.q, motion.v)
        new = (number.astype(z.dtype), *others)
        return jax.tree.map(lambda new, old: jnp.where(leave, new, old), new, (chart, z, w))
