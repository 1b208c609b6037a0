"""Local bases: few modes for each flexible body, from its own amplitudes."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly.locate import assembled
from ...basis.basis import AbstractDecomposition, Basis
from ...basis.build import modes_of
from ...basis.snapshots import SnapshotSet, WeightedSnapshots, weigh
from ...basis.subspace import span
from ...common.arrays import concrete, pick
from ...common.errors import InputError, ReductionError
from ...common.fields import Converted, number
from ...system.base import AbstractSystem
from ..formulation.base import AbstractFormulation, start
from .bases import BodyBases
from .system import LocalSystem
from .validity import LargestDeflections


class Local(AbstractFormulation):
    """Each flexible body in the span of a few modes of its own; frames and joints stay.

    The decomposition of the basis, POD or SOD, is applied to the snapshots of each body's own
    amplitudes, in its modal mass. What confines a body to few shapes is its stiffness and not the
    training, so the model also predicts motions far from the snapshots, where a basis of all
    coordinates at once does not. The result is a mechanism of bodies with fewer modes: a step costs
    O(N) in their number, and no constraint is projected. With modes of one's own
    (`Basis.from_modes`), each body takes the span of its own rows.

    Bases of components in floating frames: Hou, Liu, Hu, "Component-level proper orthogonal
    decomposition for flexible multibody systems", CMAME 361, 112690 (2020),
    doi:10.1016/j.cma.2019.112690.

    **Arguments:**

    - `tol`: keep, of all bodies, the modes whose singular value is above `tol` times the largest
      one of the whole motion; a body that hardly bends becomes rigid. Unless given, as many modes
      in all bodies as the basis has.
    - `ranks`: the number of modes of each body instead, 0 of rigid ones, in the order of the scene
      and without counters of angles and states of effects, which follow the bodies; needed under
      jit and grad through the basis, where it is `LocalSystem.ranks` of a model that was made
      outside.

    Raises InputError for a `tol` outside of 0 to 1, or with `ranks`.
    """

    name: ClassVar[str] = "local"
    in_subspace: ClassVar[bool] = False
    is_general: ClassVar[bool] = True
    is_predictive: ClassVar[bool] = True
    keeps_states: ClassVar[bool] = True

    tol: Converted[Float[Array, ""] | None] = number(default=None)
    ranks: tuple[int, ...] | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        tol = None if self.tol is None else concrete(self.tol)
        if tol is not None and not 0 < tol < 1:
            raise InputError(f"Local: tol={tol}, but it must lie between 0 and 1.")
        if tol is not None and self.ranks is not None:
            raise InputError(f"Local: give tol={tol} or ranks={self.ranks}, not both.")

    def reduce(self, system: AbstractSystem, basis: Basis) -> LocalSystem:
        """Raises ReductionError for a system without flexible bodies or one that is reduced, for
        `ranks` that do not fit, or if bodies with so few modes lock the joints.
        """
        full = assembled("reduce", system)
        if full is not system or not full.structure.flexible:
            why = "is reduced already" if full is not system else "has no body that deforms"
            raise ReductionError(f"reduce: Local is for flexible bodies, but the system {why}.")
        owned = sorted(
            (row, group.bodies.frame_size)
            for group in full.bodies
            for row in group.coordinates.rows
        )
        columns = [row for row, _ in owned]
        amplitudes = [np.array(row[frame:], int) for row, frame in owned]
        bodies = [basis.snapshots.of_coordinates(own) for own in amplitudes]
        if basis.decomposition is None:
            modes = [
                span(pick(basis.modes, own), body.metric) if own.size else body.metric
                for own, body in zip(amplitudes, bodies, strict=True)
            ]
        else:
            # Counters of angles and states of effects come after the bodies, without modes.
            count = len(full.structure.frames)
            modes = self._decompose(basis, basis.decomposition, bodies[:count])
            modes += [body.metric for body in bodies[count:]]
        bases, validity = BodyBases.of(modes, [body.metric for body in bodies], columns), None
        if basis.decomposition is not None:
            validity = LargestDeflections.of(bases, basis.snapshots.q)
        few, most = sum(x.shape[1] for x in modes), sum(len(x) for x in modes)
        flexible = sum(len(x) > 0 for x in modes)
        summary = f"{few} of {most} modes of {flexible} flexible bodies, all constraints"
        return LocalSystem.of(full, bases, start(system, basis), validity, summary)

    def _decompose(
        self, basis: Basis, decomposition: AbstractDecomposition, bodies: Sequence[SnapshotSet]
    ) -> list[Array]:
        """Φ (K, k) of each body, from its own snapshots, about the undeformed body."""
        weighted = [weigh(body, jnp.zeros(body.q.shape[1], body.q.dtype)) for body in bodies]
        ranks = self._ranks(basis, decomposition, weighted)
        return [
            modes_of(own.root, decomposition.directions(own, rank).vectors)
            if rank
            else jnp.zeros((len(own.root), 0), own.root.dtype)
            for own, rank in zip(weighted, ranks, strict=True)
        ]

    def _ranks(
        self,
        basis: Basis,
        decomposition: AbstractDecomposition,
        bodies: Sequence[WeightedSnapshots],
    ) -> list[int]:
        """The number of modes of each body."""
        sizes = [len(own.root) for own in bodies]
        if self.ranks is not None:
            fits = len(self.ranks) == len(sizes)
            if not fits or any(not 0 <= k <= n for k, n in zip(self.ranks, sizes, strict=True)):
                raise ReductionError(
                    f"reduce: ranks={self.ranks}, but the bodies of the scene have {tuple(sizes)} "
                    "modes; give one number for each body, no more than it has."
                )
            return list(self.ranks)
        criteria = [decomposition.criterion(own) if len(own.root) else None for own in bodies]
        values = list[np.ndarray]()
        for one in criteria:
            own = np.zeros(0) if one is None else concrete(one.values)
            if own is not None:
                values.append(own)
        if len(values) < len(bodies):
            raise ValueError(
                "reduce: under jit, grad or vmap say how many modes each body has, such as "
                "romjax.Local(ranks=rom.ranks) of a reduced model that was made outside."
            )
        every = np.sort(np.concatenate(values))[::-1]
        rounding = max(one.rounding for one in criteria if one is not None)
        if self.tol is None:
            level = every[basis.rank] if basis.rank < len(every) else 0.0
        else:
            level = float(self.tol) * float(basis.spectrum[0])
        level = max(level, rounding * every[0])
        return [int(np.sum(own > level)) for own in values]
