"""The smallest rank that is good enough, and the runs that say so."""

import dataclasses
from collections.abc import Iterable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from ...basis.basis import Basis
from ...basis.decomposition.pod import POD
from ...basis.snapshots import Motion, Sensitivity
from ...common.errors import RankError, ReductionError
from ...integrate.simulate import simulate
from ...integrate.training_error import TrainingError, error_of
from ...integrate.trajectory import Trajectory
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.reduce import reduce
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem
from ...system.training import forget_training
from ..compare import apart, compare

# The next rank shows the error of this one up to a factor of two.
SAFETY = 2.0
# Runs are more accurate than what is asked of models by this factor.
_SHARPER = 1e-4


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A reduced model with its runs, one for each training run."""

    rom: AbstractReducedSystem
    basis: Basis
    runs: list[Trajectory]


class Accepted(NamedTuple):
    """The smallest model that is good enough."""

    candidate: Candidate
    estimate: float  # of its error on the training

    def errors(self, search: "RankSearch") -> tuple[TrainingError, ...]:
        """Its errors on each training run of a search, which has asked for its `tol`."""
        pairs = zip(search.truths, self.candidate.runs, strict=True)
        return tuple(error_of(truth, run, search.tol, np.asarray(run.q)) for truth, run in pairs)


@dataclasses.dataclass(frozen=True)
class RankSearch:
    """Training runs, each with its system, and what a model of them should do; for the function
    `name`. `sensitivities` are snapshots beside those of the runs.
    """

    name: str
    systems: list[AbstractSystem]
    truths: list[Trajectory]
    tol: float
    formulation: AbstractFormulation
    sensitivities: list[Sensitivity] = dataclasses.field(default_factory=list)

    def smallest(self, rank: int, bar: tqdm) -> Accepted:  # type: ignore[type-arg]  # generic in the stubs only
        """The model of the smallest rank from `rank` on that is good enough, and its estimate.

        Raises ReductionError if there is none.
        """
        tol, truths = self.tol, self.truths
        snapshots: list[Motion | Sensitivity] = [*truths, *self.sensitivities]
        most = min(truths[0].q.shape[1], sum(len(one.t) for one in snapshots))
        previous, best, refusal = None, np.inf, ""
        for r in range(rank, most + 1):
            bar.set_postfix_str(f"rank {r}")
            bar.update()
            try:
                basis = self.formulation.basis(self.systems[0], snapshots, POD(r))
                if float(basis.projection_error) > self.formulation.most_missed * tol:
                    continue
                candidate = self.candidate(basis)
            except (RankError, ReductionError) as error:  # no more directions, or it would lock
                refusal = str(error)
                continue
            if previous is not None:
                estimate = max(_change(truths, previous, candidate), _error(truths, previous))
                best = min(best, estimate)
                if estimate <= tol / SAFETY:
                    return Accepted(previous, estimate)
                if candidate.rom.n == previous.rom.n:
                    break  # all minimal coordinates are there
            previous = candidate
        if previous is not None:
            # The largest model has no next one; the full one takes its place.
            estimate = _error(truths, previous)
            best = min(best, estimate)
            if estimate <= tol:
                return Accepted(previous, estimate)
        raise ReductionError(
            f"{self.name}: no rank up to {most} reaches tol={tol:g}; "
            + (f"the best error is {best:.1e}. " if np.isfinite(best) else "")
            + (f"{refusal} " if refusal else "")
            + "Simulate the training run more accurately, or ask for less."
        )

    def candidate(self, basis: Basis) -> Candidate:
        """The model of a basis, with its runs from the starts of all training runs."""
        # All formulations but those for reference make such systems.
        rom = reduce(self.systems[0], basis, self.formulation)
        forget_training(rom)
        pairs = zip(self.systems, self.truths, strict=True)
        runs = [run_as(rom, system, truth, sharper(self.tol)) for system, truth in pairs]
        return Candidate(rom, basis, runs)


def _change(truths: list[Trajectory], coarse: Candidate, fine: Candidate) -> float:
    """‖q̃_{r+1} − q̃_r‖ relative to the motion, the largest of all training runs."""
    sizes = []
    for truth, one, other in zip(truths, coarse.runs, fine.runs, strict=True):
        root = jnp.linalg.cholesky(truth.metric)
        pairs = (truth.q, truth.q[:1]), (one.q, other.q)
        size, change = (jnp.linalg.norm(apart(*x, truth.quaternions) @ root) for x in pairs)
        sizes.append(float(change / size))
    return _finite(sizes)


def _error(truths: list[Trajectory], candidate: Candidate) -> float:
    """The largest error of all training runs."""
    pairs = zip(truths, candidate.runs, strict=True)
    return _finite([float(compare(truth, run).error) for truth, run in pairs])


def _finite(errors: list[float]) -> float:
    """The largest; infinite where a run has failed."""
    return max(error if np.isfinite(error) else np.inf for error in errors)


def run_as(
    rom: AbstractReducedSystem, system: AbstractSystem, truth: Trajectory, rtol: float
) -> Trajectory:
    """The reduced model of a system with other numbers, from the start of a run of it.

    Without the audit of energy, which takes as long again to compile: the run is compared.
    """
    return simulate(
        rom.with_full(system).starting_at(truth.q[0], truth.v[0], truth.t[0]),
        truth.t,
        rtol=rtol,
        throw=False,
        audit=False,
    )


def held_out_error(
    rom: AbstractReducedSystem, system: AbstractSystem, truth: Trajectory, rtol: float
) -> float:
    """The error on a run that the model has not seen; infinite where it cannot even start."""
    try:
        run = run_as(rom, system, truth, rtol)
    except ReductionError:
        return np.inf
    return _finite([float(compare(truth, run).error)])


def first_hidden(errors: Iterable[TrainingError]) -> str:
    """What the norm hides in a training run, for a summary; "" where it hides nothing."""
    hidden = next((one.hidden for one in errors if one.hidden), "")
    return f"; {hidden}, which a smaller tol mends" if hidden else ""


def sharper(tol: float) -> float:
    """The relative tolerance of runs that judge models by `tol`."""
    return max(_SHARPER * tol, 1e-10)
