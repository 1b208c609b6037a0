"""A reduced model of a chosen accuracy."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from tqdm import tqdm

from ..arrays import as_number
from ..basis.basis import Basis
from ..basis.decomposition.pod import POD
from ..errors import InputError, RankError, ReductionError
from ..integrate.simulate import simulate
from ..integrate.trajectory import Trajectory
from ..program import program
from ..reduction.formulation.base import AbstractFormulation
from ..reduction.formulation.parse import as_formulation
from ..reduction.reduce import reduce
from ..system.base import AbstractSystem
from ..system.reduced import AbstractReducedSystem
from .compare import compare

# The next rank shows the error of this one up to a factor of two.
_SAFETY = 2.0
# The singular values that are left out may hold this share of the tolerance.
_TAIL = 0.2
# Runs of reduced models are more accurate than what is asked of them by this factor.
_SHARPER = 1e-3


@dataclasses.dataclass(frozen=True)
class _Candidate:
    rom: AbstractReducedSystem
    basis: Basis
    runs: list[Trajectory]  # one for each training run


class _Accepted(NamedTuple):
    candidate: _Candidate
    estimate: float  # of its error


def reduce_to(
    system: AbstractSystem,
    training: Trajectory,
    tol: float,
    *,
    variations: Sequence[AbstractSystem] = (),
    formulation: AbstractFormulation | str = "galerkin",
    progress: bool = False,
) -> AbstractReducedSystem:
    """A reduced system whose runs err by at most `tol`, of the smallest rank that does.

    The rank goes up until the change from one rank to the next, a good estimate of the error, and
    the error on the training are half of `tol`, and the singular values that are left out hold a
    fifth of it. Then the model is tried on all variations it has not seen; if it fails, the one
    with the largest error joins the training, and so on.

    **Arguments:**

    - `system`: the full system; `training`: a run of it, at a tolerance well below `tol`.
    - `tol`: relative error in the energy norm, as `Comparison.error`.
    - `variations`: systems of the same structure with other numbers: amplitudes, frequencies,
      starts. They are simulated in one batch, by the method of the training and at its times.
    - `formulation`: "galerkin", "minimal" or "local", by name or as an object.
    - `progress`: show a progress bar.

    Returns the reduced system. Its `validity` holds the `error`, estimated on the training and
    measured on all variations, and how far the snapshots reach; `Trajectory.warnings` tells of a
    later run beyond. Its `summary` says in words what was done.

    Raises ReductionError if no rank is good enough, naming the best one; InputError for variations
    that differ in structure or cannot be simulated.
    """
    if not 0 < tol < 1:
        raise InputError(f"reduce_to: tol={tol}, but it must lie between 0 and 1.")
    chosen = as_formulation(formulation)
    if chosen.for_reference:
        raise ReductionError(
            f"reduce_to: formulation={chosen.name!r} is for reference only; take another."
        )
    remaining = list(variations)
    unseen = _simulate_all(remaining, training) if remaining else []
    search = _Search([system], [training], tol, chosen)
    held_out = 0.0
    with tqdm(disable=not progress, unit=" models", desc="reduce_to") as bar:
        accepted = search.smallest(1, bar)
        while remaining:
            pairs = zip(remaining, unseen, strict=True)
            errors = [_held_out(accepted.candidate, *pair, tol) for pair in pairs]
            held_out = max(errors)
            if held_out <= tol:
                break
            worst = errors.index(held_out)
            search.systems.append(remaining.pop(worst))
            search.truths.append(unseen.pop(worst))
            accepted = search.smallest(accepted.candidate.basis.rank, bar)
    error, count = accepted.estimate, len(search.truths)
    words = f"; estimated error {error:.1e} for tol {tol:g}, {count} training run"
    words += "s" * (count > 1)
    if remaining:
        error = max(error, held_out)
        words += f", at most {held_out:.1e} on {len(remaining)} variations that are not among them"
    rom = accepted.candidate.rom
    rom = eqx.tree_at(lambda r: r.validity.error, rom, jnp.asarray(error))
    accurate: AbstractReducedSystem = dataclasses.replace(rom, summary=rom.summary + words)
    return accurate


@dataclasses.dataclass(frozen=True)
class _Search:
    """Training runs, each with its system, and what a model of them should do."""

    systems: list[AbstractSystem]
    truths: list[Trajectory]
    tol: float
    formulation: AbstractFormulation

    def smallest(self, rank: int, bar: tqdm) -> _Accepted:  # type: ignore[type-arg]  # generic in the stubs only
        """The model of the smallest rank from `rank` on that is good enough, and its estimate.

        Raises ReductionError if there is none.
        """
        tol, truths = self.tol, self.truths
        most = min(truths[0].q.shape[1], sum(len(run.t) for run in truths))
        previous, best, refusal = None, np.inf, ""
        for r in range(rank, most + 1):
            bar.set_postfix_str(f"rank {r}")
            bar.update()
            try:
                basis = POD(r)(truths)
                if self.tail(basis) > _TAIL * tol:
                    continue
                candidate = self.candidate(basis)
            except (RankError, ReductionError) as error:  # no more directions, or it would lock
                refusal = str(error)
                continue
            if previous is not None:
                estimate = max(_change(truths, previous, candidate), _error(truths, previous))
                best = min(best, estimate)
                if estimate <= tol / _SAFETY:
                    return _Accepted(previous, estimate)
                if candidate.rom.n == previous.rom.n:
                    break  # all minimal coordinates are there
            previous = candidate
        if previous is not None:
            # The largest model has no next one; the full one takes its place.
            estimate = _error(truths, previous)
            best = min(best, estimate)
            if estimate <= tol:
                return _Accepted(previous, estimate)
        raise ReductionError(
            f"reduce_to: no rank up to {most} reaches tol={tol:g}; "
            + (f"the best error is {best:.1e}. " if np.isfinite(best) else "")
            + (f"{refusal} " if refusal else "")
            + "Simulate the training run more accurately, ask for less"
            + (', or use formulation="minimal".' if self.formulation.in_subspace else ".")
        )

    def candidate(self, basis: Basis) -> _Candidate:
        """The model of a basis, with its runs from the starts of all training runs."""
        # All formulations but those for reference make such systems.
        rom = cast(AbstractReducedSystem, reduce(self.systems[0], basis, self.formulation))
        pairs = zip(self.systems, self.truths, strict=True)
        runs = [_run(rom, system, truth, self.tol) for system, truth in pairs]
        return _Candidate(rom, basis, runs)

    def tail(self, basis: Basis) -> float:
        """What the basis misses of the snapshots; it says nothing where q is not in its span."""
        return float(basis.projection_error) if self.formulation.in_subspace else 0.0


def _change(truths: list[Trajectory], coarse: _Candidate, fine: _Candidate) -> float:
    """‖q̃_{r+1} − q̃_r‖ relative to the motion, the largest of all training runs."""
    sizes = []
    for truth, one, other in zip(truths, coarse.runs, fine.runs, strict=True):
        root = jnp.linalg.cholesky(truth.metric)
        size = jnp.linalg.norm((truth.q - truth.q[:1]) @ root)
        sizes.append(float(jnp.linalg.norm((one.q - other.q) @ root) / size))
    return _finite(sizes)


def _error(truths: list[Trajectory], candidate: _Candidate) -> float:
    """The largest error of all training runs."""
    pairs = zip(truths, candidate.runs, strict=True)
    return _finite([float(compare(truth, run).error) for truth, run in pairs])


def _finite(errors: list[float]) -> float:
    """The largest; infinite where a run has failed."""
    return max(error if np.isfinite(error) else np.inf for error in errors)


def _run(
    rom: AbstractReducedSystem,
    system: AbstractSystem,
    truth: Trajectory,
    tol: float,
) -> Trajectory:
    """The reduced model of a system with other numbers, from the start of a run of it."""
    return simulate(
        rom.with_full(system).starting_at(truth.q[0], truth.v[0], truth.t[0]),
        truth.t,
        rtol=max(_SHARPER * tol, 1e-10),
        throw=False,
    )


def _held_out(
    candidate: _Candidate, system: AbstractSystem, truth: Trajectory, tol: float
) -> float:
    """The error on a run that the model has not seen; infinite where it cannot even start."""
    try:
        run = _run(candidate.rom, system, truth, tol)
    except ReductionError:
        return np.inf
    return _finite([float(compare(truth, run).error)])


def _simulate_all(systems: list[AbstractSystem], training: Trajectory) -> list[Trajectory]:
    """All variations in one batch, as accurately as the training."""
    arrays = [eqx.partition(system, eqx.is_array) for system in systems]
    if len({jax.tree.structure(static) for _, static in arrays}) > 1:
        raise InputError(
            "reduce_to: the variations differ in structure; give systems assembled from one scene "
            "with other numbers."
        )
    stacked = jax.tree.map(lambda *x: np.stack(x), *(dynamic for dynamic, _ in arrays))
    rtol = as_number(1e-8 if training.stats.rtol is None else training.stats.rtol, training.q.dtype)
    batch = _simulate_batch(stacked, arrays[0][1], training.t, rtol, training.solver)
    runs = [jax.tree.map(lambda x, i=i: x[i], batch) for i in range(len(systems))]
    for i, run in enumerate(runs):
        if not bool(run.success):
            raise InputError(f"reduce_to: variation {i} cannot be simulated: {run.summary()}.")
    return runs


@program
def _simulate_batch(
    stacked: Any, structure: Any, t: Float[Array, " k"], rtol: Any, solver: Any
) -> Trajectory:
    def one(dynamic: Any) -> Trajectory:
        system = eqx.combine(dynamic, structure)
        return simulate(system, t, rtol=rtol, solver=solver, throw=False)

    runs: Trajectory = jax.vmap(one)(stacked)
    return runs
