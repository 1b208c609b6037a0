"""From a system and a basis to a reduced system."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...basis.basis import Basis
from ...scene.fields import concrete
from ..base import AbstractSystem
from ..consistent import ROUNDING, consistent
from .base import AbstractReducedSystem
from .constraints import active_freedoms, count_kept, reduced_constraints
from .galerkin import GalerkinSystem
from .projected import ProjectedSystem


class ReductionError(ValueError):
    """A basis that does not make a reduced model, with the reason and the remedy."""


def reduce(
    system: AbstractSystem,
    basis: Basis,
    formulation: str = "galerkin",
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
    found = reduced_constraints(system, basis)
    kept = count_kept(found) if count is None else count
    r, active = basis.rank, active_freedoms(found, basis)
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
    combinations = found.combinations[:, :kept]
    start = _start(system, basis.modes, basis.offset, combinations, basis.recording.t[0])
    rom = GalerkinSystem(system, basis.modes, basis.offset, combinations, start.q, start.v, reason)
    violation = concrete(start.violation)
    if kept == 0 or (violation is not None and violation <= ROUNDING[start.q.dtype]):
        return rom
    q0, v0 = consistent(rom, t=basis.recording.t[0])
    return GalerkinSystem(system, basis.modes, basis.offset, combinations, q0, v0, reason)


def _projected(system: AbstractSystem, basis: Basis) -> ProjectedSystem:
    modes, _ = jnp.linalg.qr(basis.modes)
    q0, v0 = modes.T @ (system.q0 - basis.offset), modes.T @ system.v0
    reason = f"{basis.rank} modes, all {system.m} constraints inside; for reference only"
    return ProjectedSystem(system, modes, basis.offset, q0, v0, reason)


class _Start(NamedTuple):
    q: Float[Array, " r"]
    v: Float[Array, " r"]
    violation: Float[Array, ""]  # of the kept constraints and their rates


@eqx.filter_jit
def _start(
    system: AbstractSystem,
    modes: Float[Array, "n r"],
    offset: Float[Array, " n"],
    combinations: Float[Array, "m kept"],
    t: Float[Array, ""],
) -> _Start:
    """The start of the full system, projected in the mass metric."""
    weighted = system.mass(system.q0) @ modes
    gram = jax.scipy.linalg.cho_factor(modes.T @ weighted)
    q = jax.scipy.linalg.cho_solve(gram, weighted.T @ (system.q0 - offset))
    v = jax.scipy.linalg.cho_solve(gram, weighted.T @ system.v0)
    state = system.constraint_state(t, offset + modes @ q, modes @ v)
    left = jnp.abs(combinations.T @ jnp.stack([state.violation, state.rate], axis=1))
    return _Start(q, v, jnp.max(left, initial=0.0))
