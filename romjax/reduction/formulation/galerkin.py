"""Galerkin's reduction: an affine subspace, with the constraints that it can violate."""

import dataclasses
from typing import ClassVar

import equinox as eqx

from ...arrays import concrete
from ...basis.basis import Basis
from ...errors import ReductionError
from ...kept.constraints import (
    LOOSE,
    ReducedConstraints,
    locks,
    looseness,
    most_kept,
    reduced_constraints,
)
from ...system.base import AbstractSystem
from ...system.validity import TrainingBox
from ..lift.affine import AffineLift
from ..system import ReducedSystem
from .base import AbstractFormulation, start

# In a subspace quaternions change their lengths as bodies turn, 6° about their mean at this share
# of the kinetic energy, and the motion errs by as much.
STRETCHED = 1e-3


class Galerkin(AbstractFormulation):
    """d'Alembert's principle in the affine subspace q = q̄ + Φ z.

    What the chapter's equations 39.6 and 39.7 mean to be. Of the constraints, those combinations
    are kept that the basis can violate and that do not stop the snapshots' own motion.

    **Arguments:**

    - `constraints`: how many combinations to keep, instead of the rule; needed under jit and grad
      through the basis, where it is `rom.m` of a model that was made outside.
    """

    name: ClassVar[str] = "galerkin"

    constraints: int | None = eqx.field(static=True, default=None)

    def reduce(self, system: AbstractSystem, basis: Basis) -> ReducedSystem:
        """Raises ReductionError if the constraints that are kept lock the mechanism, or those that
        are not free its joints, or if bodies in space turn too far for a subspace.
        """
        count, r = self.constraints, basis.rank
        if r < system.n:
            _check_turns(basis)
        # Words and settings are static: with them, each basis would compile a program of its own.
        bare = dataclasses.replace(basis, summary="", decomposition=None)
        candidates = reduced_constraints(system, bare)
        kept = _count(system, candidates, r) if count is None else count
        if count and concrete(candidates.missed) is not None and locks(candidates, count):
            free = next(fewer for fewer in range(count, -1, -1) if not locks(candidates, fewer))
            raise ReductionError(
                f"reduce: the basis locks the mechanism. {count} constraints on its {r} modes "
                f"would stop the motion of the snapshots; keep fewer (constraints={free}), or take "
                "more modes."
            )
        lift, dual = AffineLift(basis.modes, basis.offset), basis.modes.T @ basis.snapshots.metric
        validity = TrainingBox.of_basis(system, basis, basis.modes, dual)
        summary = f"{r} modes, {kept} of {system.m} constraints kept, {r - kept} degrees of freedom"
        combinations = candidates.combinations(kept)
        given = combinations, validity, summary, basis.snapshots.turns
        return ReducedSystem.of(system, lift, start(system, basis), *given)


def _check_turns(basis: Basis) -> None:
    """Refuse a subspace in which the lengths of quaternions are much of the motion."""
    share = concrete(basis.stretching)
    if share is not None and share > STRETCHED:
        raise ReductionError(
            "reduce: bodies turn too far in space for a subspace of their quaternions, whose "
            f"lengths would take {100 * share:.1g} % of the kinetic energy; use "
            "formulation=romjax.Minimal() of rigid mechanisms, romjax.Local() of flexible ones."
        )


def _count(system: AbstractSystem, candidates: ReducedConstraints, r: int) -> int:
    """As many constraints as the motion of the snapshots allows; refuse if joints come apart."""
    if r == system.n:
        return system.m  # the same mechanism, in other coordinates
    if concrete(candidates.missed) is None:
        raise ValueError(
            "reduce: under jit, grad or vmap say how many constraints to keep, such as "
            "romjax.Galerkin(constraints=2); find the number first, outside (rom.m)."
        )
    most = most_kept(candidates)
    counts = range(most, -1, -1)
    kept = next(count for count in counts if not count or not locks(candidates, count))
    loose, row = looseness(candidates, kept) if system.m else (0.0, 0)
    if loose > LOOSE:
        raise ReductionError(
            f"reduce: the basis frees the mechanism. With {r} modes only {kept} of {system.m} "
            f"constraints can be kept, {most - kept} more would lock its motion, and what moves "
            f"then violates {system.structure.constraints[row]} by {100 * loose:.0f} % of a free "
            "motion; take more modes, or formulation=romjax.Minimal()."
        )
    return kept
