"""Minimal coordinates in several charts, and the change from one to another."""

import dataclasses

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from ...common.arrays import Time, as_jax, namespace, stack, untraced
from ...system.base import AbstractSystem
from ..charts.atlas import Atlas
from .base import AbstractLift, Motion, Physical, Reduced
from .implicit import ImplicitLift


class AtlasLift(AbstractLift):
    """A lift made of several implicit ones; `current` is the one that coordinates refer to.

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
        """Make the lift from those of the charts; it begins in that of the first row of `q`."""
        stacked = jax.tree.map(lambda *x: stack(x), *lifts)
        owners, (rows, scale) = np.asarray(atlas.owners), untraced(q, root)
        seen = as_jax(rows[atlas.seen] @ scale.T)
        return cls(stacked, as_jax(np.asarray(owners[0])), root, seen, as_jax(owners), atlas)

    def lift(self, number: Int[Array, ""]) -> ImplicitLift:
        """Return the lift of one chart."""
        lift: ImplicitLift = jax.tree.map(lambda x: x[number], self.lifts)
        return lift

    def number(self, q: Physical) -> Int[Array, ""]:
        """The chart of the nearest snapshot."""
        # NumPy compiles nothing where JAX does not trace.
        seen, root, owners, q = untraced(self.seen, self.root, self.owners, q)
        xp = namespace(q)
        distances = xp.sum((seen - (root @ q)[None]) ** 2, axis=1)
        number: Array = as_jax(xp.asarray(owners[xp.argmin(distances)]))
        return number

    def position(self, full: AbstractSystem, t: Time, z: Reduced) -> Physical:
        return self.lift(self.current).position(full, t, z)

    def motion(self, full: AbstractSystem, t: Time, z: Reduced, w: Reduced) -> Motion:
        return self.lift(self.current).motion(full, t, z, w)

    def restrict(self, full: AbstractSystem, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        return self.lift(self.current).restrict(full, q, v)

    def with_full(self, full: AbstractSystem) -> "AtlasLift":
        # The start is in one of the charts, and no straight way leads from it to the others.
        lifts = jax.vmap(lambda lift: lift.with_full(full, from_start=False))(self.lifts)
        return dataclasses.replace(self, lifts=lifts)
