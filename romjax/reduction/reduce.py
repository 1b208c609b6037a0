"""From a system and a basis to a reduced system."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import concrete
from ..basis.basis import Basis
from ..errors import ReductionError
from ..study.projected import ProjectedSystem
from ..system.base import AbstractSystem
from ..system.consistent import ROUNDING, consistent
from .atlas import Atlas
from .base import AbstractReducedSystem, project, start
from .chart import Chart
from .constraints import LOOSE, ReducedConstraints, locks, looseness, most_kept, reduced_constraints
from .galerkin import GalerkinSystem
from .parametrize import minimal
from .validity import Training

# Snapshots of which the constraints are evaluated.
_LOOKS = 200


def reduce(
    system: AbstractSystem,
    basis: Basis,
    formulation: str = "galerkin",
    *,
    constraints: int | None = None,
    chart: Chart | Atlas | None = None,
) -> AbstractReducedSystem:
    """The system in the coordinates of a basis.

    It starts where the snapshots start, or with a basis of one's own where the system does. For
    another start, `simulate(rom, ts, q0=z, v0=w)` with `z, w = rom.reduced(q0, v0)`.

    **Arguments:**

    - `system`: the full system; `basis`: from `pod`, `sod` or `Basis.from_modes`.
    - `formulation`: "galerkin": d'Alembert's principle in the subspace, with the constraints that
      the basis can violate and that do not stop the snapshots' own motion; "minimal": in a
      subspace of minimal coordinates, decomposed as the basis was, in which all constraints hold
      exactly, or where no choice of these holds over all snapshots, in several charts with a state
      that ends with the chart's number; "projected": the chapter's equation 39.6 to the letter,
      unstable and no faster, for reference only.
    - `constraints`: how many combinations of constraints to keep, instead of the rule (galerkin);
      needed under jit and grad.
    - `chart`: which coordinates are independent and where (minimal), that of another reduced
      model, such as `rom.chart`; needed under jit and grad.

    Raises ReductionError if the basis does not fit the system, if the constraints that are kept
    lock the mechanism or those that are not free its joints, or if the mechanism passes a singular
    position (minimal).
    """
    # Words and ranks as asked for are static: with them, each basis would compile programs of its
    # own.
    made = basis.decomposition and basis.decomposition.with_rank(basis.rank, basis.offset)
    basis = dataclasses.replace(basis, summary="", decomposition=made)
    if basis.modes.shape[0] != system.n:
        raise ReductionError(
            f"reduce: the basis has {basis.modes.shape[0]} coordinates and the system {system.n}; "
            "make the basis from a simulation of this system."
        )
    if formulation == "galerkin":
        return _galerkin(system, basis, constraints)
    if formulation == "minimal":
        return minimal(system, basis, chart)
    if formulation == "projected":
        return _projected(system, basis)
    raise ReductionError(
        f'reduce: formulation={formulation!r}; it must be "galerkin", "minimal" or "projected".'
    )


def _galerkin(system: AbstractSystem, basis: Basis, count: int | None) -> GalerkinSystem:
    found, r = reduced_constraints(system, basis), basis.rank
    kept = _count(system, found, r) if count is None else count
    if count and concrete(found.missed) is not None and locks(found, count):
        free = _count(system, found, r)
        raise ReductionError(
            f"reduce: the basis locks the mechanism. {count} constraints on its {r} modes would "
            f"stop the motion of the snapshots; keep fewer (constraints={free}), or take more "
            "modes."
        )
    combinations = found.combinations(kept)
    reason = f"{r} modes, {kept} of {system.m} constraints kept, {r - kept} degrees of freedom"
    time = basis.snapshots.t[0]
    q, v = start(system, basis)
    found_start = _galerkin_start(system, basis, combinations, time, q, v)
    known = _training(system, basis)
    parts = (system, basis.modes, basis.offset, combinations)
    rom = GalerkinSystem(*parts, *found_start[:2], known, reason)
    violation = concrete(found_start.violation)
    if kept == 0 or (violation is not None and violation <= ROUNDING[q.dtype]):
        return rom
    q0, v0 = consistent(rom, t=time)
    return GalerkinSystem(*parts, q0, v0, known, reason)


def _count(system: AbstractSystem, found: ReducedConstraints, r: int) -> int:
    """As many constraints as the motion of the snapshots allows; refuse if joints come apart."""
    if concrete(found.missed) is None:
        raise ValueError(
            "reduce: under jit, grad or vmap say how many constraints to keep, such as "
            "constraints=2; find the number first, outside (rom.m)."
        )
    most = most_kept(found)
    kept = next(count for count in range(most, -1, -1) if not count or not locks(found, count))
    loose, row = looseness(found, kept) if system.m else (0.0, 0)
    if loose > LOOSE:
        raise ReductionError(
            f"reduce: the basis frees the mechanism. With {r} modes only {kept} of {system.m} "
            f"constraints can be kept, {most - kept} more would lock its motion, and what moves "
            f"then violates {system.constraint_label(row)} by {100 * loose:.0f} % of a free "
            'motion; take more modes, or formulation="minimal".'
        )
    return kept


def _projected(system: AbstractSystem, basis: Basis) -> ProjectedSystem:
    modes, _ = jnp.linalg.qr(basis.modes)
    q, v = start(system, basis)
    q0, v0 = modes.T @ (q - basis.offset), modes.T @ v
    reason = f"{basis.rank} modes, all {system.m} constraints inside; for reference only"
    turn = modes.T @ basis.modes
    known = _training(system, basis, turn)
    return ProjectedSystem(system, modes, basis.offset, q0, v0, known, reason)


def _training(
    system: AbstractSystem, basis: Basis, turn: Float[Array, "r r"] | None = None
) -> Training | None:
    """The box of the snapshots, and how far they violate the constraints once in the subspace.

    `turn`: from the coordinates of the basis to those of the system, if they are others.
    """
    if basis.decomposition is None:
        return None
    z = basis.coordinates
    stride = -(-len(z) // _LOOKS)
    some, t = z[::stride], basis.snapshots.t[::stride]
    violation = _violation(system, t, basis.offset[None] + some @ basis.modes.T)
    return Training.of(z if turn is None else z @ turn.T, violation)


@eqx.filter_jit
def _violation(
    system: AbstractSystem, t: Float[Array, " h"], q: Float[Array, "h n"]
) -> Float[Array, ""]:
    found = jax.vmap(system.physical_constraint)(t, q)
    return jnp.max(jnp.abs(found), initial=0.0)


class _GalerkinStart(NamedTuple):
    q: Float[Array, " r"]
    v: Float[Array, " r"]
    violation: Float[Array, ""]  # of the kept constraints and their rates


@eqx.filter_jit
def _galerkin_start(
    system: AbstractSystem,
    basis: Basis,
    combinations: Float[Array, "m kept"],
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
) -> _GalerkinStart:
    """A start projected in the mass metric."""
    z, w = project(system.mass(q), basis.modes, q - basis.offset, v)
    state = system.constraint_state(t, basis.offset + basis.modes @ z, basis.modes @ w)
    left = jnp.abs(combinations.T @ jnp.stack([state.violation, state.rate], axis=1))
    return _GalerkinStart(z, w, jnp.max(left, initial=0.0))
