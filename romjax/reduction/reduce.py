"""Reduction: the system of few coordinates for a system and a basis."""

from typing import Literal, overload

from ..basis.basis import Basis
from ..common.checks import check_kind, check_order
from ..common.errors import ReductionError, UnsuitedError
from ..system.base import AbstractSystem, check_reducible, check_system
from ..system.reduced import AbstractReducedSystem
from ..system.training import remember_training
from .formulation.base import AbstractFormulation
from .formulation.galerkin import Galerkin
from .formulation.instead import tried_instead
from .formulation.minimal import Minimal
from .formulation.parse import as_formulation
from .joint.formulation import JointCoordinates
from .system import ReducedSystem


@overload
def reduce(
    system: AbstractSystem,
    basis: Basis,
    formulation: Galerkin | Minimal | Literal["galerkin", "minimal"] = ...,
) -> ReducedSystem: ...


@overload
def reduce(
    system: AbstractSystem, basis: Basis | None = ..., formulation: AbstractFormulation | str = ...
) -> AbstractReducedSystem: ...


def reduce(
    system: AbstractSystem,
    basis: Basis | None = None,
    formulation: AbstractFormulation | str = "galerkin",
) -> AbstractReducedSystem:
    """The system in the coordinates of a basis, or exactly in those of its joints.

    It starts where the snapshots start, or with modes of one's own where the system does;
    `starting_at` gives another start, and `with_full` the same reduction of other numbers, from the
    start of that system.

    **Arguments:**

    - `system`: the full one; `basis`: from `pod`, `sod` or `Basis.from_modes`.
    - `formulation`: `Galerkin()`, "galerkin": d'Alembert's principle in the subspace, with the
      constraints that it can violate. `Minimal()`, "minimal": in minimal coordinates, of which the
      modes of the basis span a subspace, with all constraints satisfied exactly, best of a basis
      by `Minimal.basis`. `Local()`, "local": few modes for each flexible body, with all joints.
      `Tabulated()`, "table": configurations of one or two freedoms, looked up. `HyperReduced()`,
      "hyper": a few of many hinged rigid bodies stand for all. `Projected()`, "projected": the
      chapter's equation 39.6, unstable, for reference only. `JointCoordinates()`, "joint": exact.

    Raises ReductionError for effects with states (but for local and joint), a basis that does not
    fit, a mechanism that locks, comes apart (galerkin) or is singular (minimal), with what suits
    it.
    """
    chosen: AbstractFormulation = as_formulation(formulation)
    check_system("reduce", system)
    check_reducible(system, chosen)
    if isinstance(chosen, JointCoordinates) and basis is None:
        return chosen.reduce(system)
    check_kind("reduce", "the basis", basis, Basis, "what romjax.pod or romjax.sod returns")
    assert basis is not None
    if system.full is not system:
        raise ReductionError(
            "reduce: the system is reduced already; give its full one, as `rom.full`, with a basis "
            "of a simulation of that."
        )
    if basis.modes.shape[0] != system.n:
        raise ReductionError(
            f"reduce: the basis has {basis.modes.shape[0]} coordinates and the system {system.n}; "
            "make the basis from a simulation of this system."
        )
    labels = basis.snapshots.labels
    remedy = "make it from a simulation of this system"
    check_order("reduce: the basis", system.structure.labels, labels, ReductionError, remedy)
    try:
        return remember_training(chosen.reduce(system, basis), basis, chosen)
    except UnsuitedError as refusal:
        raise ReductionError(f"{refusal} {tried_instead(system, basis, chosen)}") from None
