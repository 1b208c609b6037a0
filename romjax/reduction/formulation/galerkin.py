"""Galerkin's reduction: an affine subspace, with the constraints that it can violate."""

import dataclasses
from typing import ClassVar

import equinox as eqx

from ...basis.basis import Basis
from ...common.arrays import concrete
from ...common.errors import ReductionError, UnsuitedError
from ...system.base import AbstractSystem
from ...system.reduced_constraints import (
    LOOSE,
    ReducedConstraints,
    locks,
    looseness,
    most_kept,
    reduced_constraints,
)
from ...system.validity import TrainingBox
from ..lift.affine import AffineLift
from ..system import ReducedSystem
from .base import AbstractFormulation, start


class Galerkin(AbstractFormulation):
    """d'Alembert's principle in the affine subspace q = q̄ + Φ z.

    What the chapter's equations 39.6 and 39.7 mean to be. Of the constraints, those combinations
    are kept that the basis can violate and that do not stop the snapshots' own motion.

    **Arguments:**

    - `constraints`: how many combinations to keep, instead of the rule; needed under jit and grad
      through the basis, where it is `rom.m` of a model that was made outside.
    """

    name: ClassVar[str] = "galerkin"
    most_missed: ClassVar[float] = 0.2
    is_general: ClassVar[bool] = True

    constraints: int | None = eqx.field(static=True, default=None)

    def reduce(self, system: AbstractSystem, basis: Basis) -> ReducedSystem:
        """Raises ReductionError if the constraints that are kept lock the mechanism, or those that
        are not free its joints.
        """
        count, r = self.constraints, basis.rank
        # Words and settings are static: with them, each basis would compile a program of its own.
        bare = dataclasses.replace(basis, summary="", decomposition=None)
        candidates = reduced_constraints(system, bare)
        turns, kept = basis.snapshots.turns, count
        if kept is None:
            kept = _count(system, candidates, r, 0 if turns is None else turns.without_lengths)
        if count and concrete(candidates.missed) is not None and locks(candidates, count):
            free = next(fewer for fewer in range(count, -1, -1) if not locks(candidates, fewer))
            raise ReductionError(
                f"reduce: the basis locks the mechanism. {count} constraints on its {r} modes "
                f"would stop the motion of the snapshots; keep fewer (constraints={free}), or take "
                "more modes."
            )
        flat = turns if turns is not None and turns.affine else None
        lift = AffineLift(basis.modes, basis.offset, flat)
        dual = basis.modes.T @ basis.snapshots.metric
        validity = TrainingBox.of_basis(system, basis, basis.modes, dual)
        summary = f"{r} modes, {kept} of {system.m} constraints kept, {r - kept} degrees of freedom"
        combinations = candidates.combinations(kept)
        given = combinations, validity, summary, turns
        return ReducedSystem.of(system, lift, start(system, basis), *given)


def _count(system: AbstractSystem, candidates: ReducedConstraints, r: int, lengths: int) -> int:
    """Return how many constraints the motion of the snapshots allows; refuse if joints come apart.

    All of them where the modes hold all directions but those that are `lengths` of quaternions: the
    model is the same mechanism, in other coordinates.
    """
    if r == system.n - lengths:
        return system.m
    if concrete(candidates.missed) is None:
        raise ValueError(
            "reduce: under jit, grad or vmap say how many constraints to keep, such as "
            "romjax.Galerkin(constraints=2); find the number first, outside (rom.m)."
        )
    most = most_kept(candidates)
    counts = range(most, -1, -1)
    # The most constraints with which the motion of the snapshots is still possible.
    kept = next(count for count in counts if not count or not locks(candidates, count))
    loose, row = looseness(candidates, kept) if system.m else (0.0, 0)
    if loose > LOOSE:
        raise UnsuitedError(
            f"reduce: the basis frees the mechanism. With {r} modes only {kept} of {system.m} "
            f"constraints can be kept, {most - kept} more would lock its motion, and what moves "
            f"then violates {system.structure.constraints[row]} by {100 * loose:.0f} % of a free "
            "motion; take more modes."
        )
    return kept
