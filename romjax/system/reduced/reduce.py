"""From a system and a basis to a reduced system."""

from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...basis.basis import Basis
from ..base import AbstractSystem
from ..consistent import consistent
from .base import AbstractReducedSystem
from .constraints import active_freedoms, select_constraints
from .galerkin import GalerkinSystem
from .projected import ProjectedSystem

Formulation = Literal["galerkin", "projected"]


class ReductionError(ValueError):
    """A basis that does not make a reduced model, with the reason and the remedy."""


def reduce(
    system: AbstractSystem,
    basis: Basis,
    formulation: Formulation = "galerkin",
    *,
    constraints: int | None = None,
) -> AbstractReducedSystem:
    """The system in the coordinates of a basis.

    **Arguments:**

    - `system`: the full system; `basis`: from `pod`, `sod` or `Basis.from_modes`.
    - `formulation`: "galerkin": d'Alembert's principle in the subspace, with the constraints that
      the basis can violate; "projected": the chapter's equation 39.6 to the letter, unstable and no
      faster, for reference only.
    - `constraints`: how many combinations of constraints to keep, instead of the rule (galerkin);
      needed under jit and grad.

    Raises ReductionError if the basis does not fit the system, or if the constraints that are kept
    leave fewer degrees of freedom than the snapshots use: the mechanism would lock.
    """
    if basis.modes.shape[0] != system.n:
        raise ReductionError(
            f"reduce: the basis has {basis.modes.shape[0]} coordinates and the system {system.n}; "
            "make the basis from a simulation of this system."
        )
    if formulation == "galerkin":
        return _galerkin(system, basis, constraints)
    if formulation == "projected":
        return _projected(system, basis)
    raise ReductionError(
        f'reduce: formulation={formulation!r}; it must be "galerkin" or "projected".'
    )


def _galerkin(system: AbstractSystem, basis: Basis, count: int | None) -> GalerkinSystem:
    selection = select_constraints(system, basis, count)
    kept, r = selection.combinations.shape[1], basis.rank
    active = active_freedoms(system, basis)
    if active is not None and r - kept < active:
        remedy = (
            f"keep fewer constraints (constraints={r - active}), or take more modes"
            if r >= active
            else "take more modes"
        )
        raise ReductionError(
            f"reduce: the basis locks the mechanism. Its {r} modes with {kept} kept constraints "
            f"leave {r - kept} degrees of freedom, but the snapshots move in {active}; {remedy}."
        )
    reason = f"{r} modes, {kept} of {system.m} constraints kept, {r - kept} degrees of freedom" + (
        "" if active is None else f" ({active} used by the snapshots)"
    )
    q0, v0 = _start(system, basis.modes, basis.offset)
    start = GalerkinSystem(
        system, basis.modes, basis.offset, selection.combinations, q0, v0, reason
    )
    if kept == 0:
        return start
    q0, v0 = consistent(start, q0, v0, t=basis.t[0])
    return GalerkinSystem(system, basis.modes, basis.offset, selection.combinations, q0, v0, reason)


def _projected(system: AbstractSystem, basis: Basis) -> ProjectedSystem:
    modes, _ = jnp.linalg.qr(basis.modes)
    q0, v0 = modes.T @ (system.q0 - basis.offset), modes.T @ system.v0
    reason = f"{basis.rank} modes, all {system.m} constraints inside; for reference only"
    return ProjectedSystem(system, modes, basis.offset, q0, v0, reason)


@jax.jit
def _start(
    system: AbstractSystem, modes: Float[Array, "n r"], offset: Float[Array, " n"]
) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
    """The start of the full system, projected in the mass metric."""
    weighted = system.mass(system.q0) @ modes
    gram = jax.scipy.linalg.cho_factor(modes.T @ weighted)
    q0 = jax.scipy.linalg.cho_solve(gram, weighted.T @ (system.q0 - offset))
    return q0, jax.scipy.linalg.cho_solve(gram, weighted.T @ system.v0)
