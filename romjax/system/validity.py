"""Flags of the result of a reduced model."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from ..basis.basis import Basis
from ..basis.passed import passed
from ..compiling.program import program_once
from .base import AbstractSystem, AbstractValidity, Run
from .flags import Flag

# A motion may leave the training box on each side by this share of its width. Directions much
# narrower than the widest one are allowed a thousandth of that.
_MARGIN, _NARROW = 0.1, 1e-3
# How many times the training's violation is too much, and how many tolerances of the steps: of
# these, stabilization leaves up to 2.1, in a top's subspace. What is never too much.
_TIMES, _DRIFTS, _ROUNDING = 10.0, 3.0, 1e-7
# Snapshots at which the constraints are evaluated.
_SNAPSHOTS = 200


class TrainingBox(AbstractValidity):
    """The box of the snapshots that a reduced model was made of.

    - `lower`, `upper` (r,): in its own coordinates, or with a `root` R in R q, where the own ones
      change on the way, or of times (1,), where a mechanism without freedom has none.
    - `violation`: largest |C| of the snapshots in the subspace.
    - `error`: estimated error of a run, relative in the energy norm; NaN if nobody estimated it.
    """

    lower: Float[Array, " r"]
    upper: Float[Array, " r"]
    violation: Float[Array, ""]
    error: Float[Array, ""]
    root: Float[Array, "n n"] | None

    @classmethod
    def of(
        cls,
        points: Float[Array, "K r"],
        violation: ArrayLike = 0.0,
        root: Float[Array, "n n"] | None = None,
    ) -> "TrainingBox":
        """The box of points."""
        most, error = jnp.asarray(violation, points.dtype), jnp.full((), jnp.nan, points.dtype)
        return cls(jnp.min(points, 0), jnp.max(points, 0), most, error, root)

    @classmethod
    def of_basis(
        cls, system: AbstractSystem, basis: Basis, modes: Float[Array, "n r"], dual: Array
    ) -> "TrainingBox | None":
        """The box of the snapshots of a basis in the subspace of `modes`, whose coordinates are
        z = `dual` (q − q̄), and how far they violate the constraints there; None without snapshots.
        """
        if basis.decomposition is None:
            return None
        t, q = basis.snapshots.t, basis.snapshots.q
        return _in_subspace(system, t, q, passed(basis.snapshots), basis.offset, modes, dual)

    def including(self, run: Run) -> "TrainingBox":
        points = self._points(run)
        return dataclasses.replace(
            self,
            lower=jnp.minimum(self.lower, jnp.min(points, 0)),
            upper=jnp.maximum(self.upper, jnp.max(points, 0)),
            violation=jnp.maximum(self.violation, jnp.max(run.violation)),
        )

    @property
    def of_states(self) -> "TrainingBox":
        return self

    def _points(self, run: Run) -> Float[Array, "k r"]:
        if not run.q.shape[1]:
            return run.t[:, None]
        return run.q if self.root is None else run.physical @ self.root.T

    def flags(self, system: AbstractSystem, run: Run) -> Int[Array, ""]:
        del system
        points = self._points(run)
        width = self.upper - self.lower
        allowed = _MARGIN * jnp.maximum(width, _NARROW * jnp.max(width))
        outside = jnp.maximum(self.lower[None] - points, points - self.upper[None])
        limit = jnp.maximum(_TIMES * self.violation, jnp.maximum(_DRIFTS * run.drift, _ROUNDING))
        flags: Array = jnp.any(outside > allowed[None]) * int(Flag.OUTSIDE_TRAINING)
        return flags + jnp.any(run.violation > limit) * int(Flag.VIOLATION)


@program_once
def _in_subspace(
    system: AbstractSystem,
    t: Array,
    q: Array,
    passed: Array,
    offset: Array,
    modes: Array,
    dual: Array,
) -> TrainingBox:
    z = (q - offset[None]) @ dual.T
    stride = -(-len(z) // _SNAPSHOTS)
    q = offset[None] + z[::stride] @ modes.T
    violation = jnp.abs(jax.vmap(system.constraint)(t[::stride], q))
    return TrainingBox.of((passed - offset[None]) @ dual.T, jnp.max(violation, initial=0))
