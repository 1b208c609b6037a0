"""Tables: mechanisms with one or two freedoms whose configurations are looked up."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...basis.basis import Basis
from ...basis.build import modes_of
from ...basis.snapshots import weigh
from ...basis.subspace import span
from ...common.arrays import as_jax, concrete, put
from ...common.errors import InputError, UnsuitedError
from ...compiling.program import program_once
from ...system.base import AbstractSystem
from ...system.validity import TrainingBox
from ..charts.survey import survey
from ..formulation.base import AbstractFormulation, start
from ..formulation.minimal import Minimal
from ..system import ReducedSystem
from .curve import trace_curve
from .frames import Frames
from .grid import Goal
from .lift import TableLift
from .surface import trace_surface

# What tables hold unless something else is asked for.
_GOAL = Goal(1e-9, 1e-5)


class Tabulated(AbstractFormulation):
    """A table of configurations, looked up by as many coordinates as freedoms, one or two.

    With one freedom the joints leave the frames of the bodies a curve, which is traced once; a step
    then solves no constraints. Its coordinate singles out no body, so that cranks go round and dead
    points are passed. With two freedoms they leave a surface, of which the table holds what the
    snapshots of the basis reach and a tenth more on each side, away from singular positions.
    Beyond the ends of a table a run fails. Without freedom, where drives prescribe the whole
    motion, the snapshots are the table, and the model is that of `Minimal`.

    Masses, stiffnesses and effects need no new table. Where bodies deform, a basis of rank r gives
    r − 1 or r − 2 modes of their amplitudes, decomposed as the basis was; small amplitudes are
    added to second order. Constraints that do not hold to that order are flagged.

    Global modal parametrization: Brüls, Duysinx, Golinval, "The global modal parameterization for
    non-linear model-order reduction in flexible multibody dynamics", IJNME 69, 948 (2007),
    doi:10.1002/nme.1795.

    **Arguments:**

    - `tol`: how well the table holds the constraints between its nodes: largest |C̈| [m/s², rad/s²]
      of the undeformed bodies at a speed of 1 √kg m/s in the mass metric. None: to 1e-9, or where
      rounding or the number of nodes forbids that, as well as a table can, to 1e-5 at least.

    Raises InputError for a `tol` that is not positive.
    """

    name: ClassVar[str] = "table"
    in_subspace: ClassVar[bool] = False
    is_predictive: ClassVar[bool] = True

    tol: float | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        if self.tol is not None and not self.tol > 0:
            raise InputError(f"Tabulated: tol={self.tol}, but it must be positive.")

    def reduce(self, system: AbstractSystem, basis: Basis) -> ReducedSystem:
        """Raises ReductionError where no table holds the constraints well enough, for bodies in
        space, for more than two freedoms, for constraints
        that change with time, at singular positions, and without snapshots for two
        freedoms or an open curve.
        """
        if system.full.structure.quaternions:
            raise UnsuitedError(
                "reduce: tables are made of mechanisms in the plane, and bodies move in space."
            )
        q, v, t = start(system, basis)
        known = concrete(q) is not None
        if known and not survey(system, t[None], q[None], 1).null_spaces.shape[2]:
            return Minimal().reduce(system, basis)
        frames = Frames.of(system, t, q)
        amplitudes = np.setdiff1d(np.arange(system.n), frames.numbers)
        undeformed = as_jax(put(q, amplitudes, 0.0))
        trained, bent = basis.decomposition is not None, np.s_[:, amplitudes]
        snapshots = as_jax(put(basis.snapshots.q, bent, 0.0)) if trained else None
        goal = _GOAL if self.tol is None else Goal(self.tol, self.tol)
        if frames.freedoms == 1:
            grid = trace_curve(system, frames, undeformed, snapshots, goal)
        else:
            grid = trace_surface(system, frames, snapshots, goal)
        own = _modes(basis, amplitudes, basis.rank - frames.freedoms)
        modes = as_jax(put(np.zeros((system.n, own.shape[1]), q.dtype), amplitudes, own))
        lift = TableLift.of(system, frames, grid, modes)
        summary = grid.summary
        if amplitudes.size:
            summary += f", {own.shape[1]} of {amplitudes.size} modes of flexible bodies"
        # Undeformed bodies leave the constraints nowhere.
        violation = _violation(system, lift, basis.snapshots.q) if trained else 0.0
        everywhere = np.outer([-np.inf, np.inf], np.ones(frames.freedoms + own.shape[1]))
        validity = TrainingBox.of(as_jax(everywhere.astype(q.dtype)), violation)
        return ReducedSystem.of(
            system, lift, (q, v, t), None, validity, f"{summary}, no constraints"
        )


def _modes(basis: Basis, amplitudes: np.ndarray, most: int) -> Float[Array, "a k"]:
    """Modes of the amplitudes of all bodies, orthonormal in their metric."""
    own = basis.snapshots.of_coordinates(amplitudes)
    count = min(most, amplitudes.size)
    if count <= 0:
        return as_jax(np.zeros((amplitudes.size, 0), own.q.dtype))
    if basis.decomposition is None:
        return span(basis.modes[amplitudes], own.metric)
    weighted = weigh(own, jnp.zeros(amplitudes.size, own.q.dtype))
    return modes_of(weighted.root, basis.decomposition.directions(weighted, count).vectors)


@program_once
def _violation(system: AbstractSystem, lift: TableLift, q: Float[Array, "K n"]) -> Float[Array, ""]:
    """Largest |C| where the lift comes nearest to snapshots."""

    def one(q: Array) -> Array:
        z, _ = lift.restrict(system, q, jnp.zeros_like(q))
        return jnp.abs(system.constraint(lift.frames.time, lift.position(system, 0.0, z)))

    return jnp.max(jax.vmap(one)(q), initial=0.0)
