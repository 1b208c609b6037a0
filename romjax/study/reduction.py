"""The chapter's study: one full model, its reduced models, what they save and what they cost."""

import dataclasses
from collections.abc import Iterator
from typing import Any, Literal

import diffrax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..basis.basis import Basis
from ..basis.decomposition.naive import naive_sod
from ..basis.decomposition.pod import POD
from ..basis.decomposition.sod import SOD
from ..basis.rank import Rank
from ..common.errors import InputError, ReductionError
from ..integrate.simulate import simulate
from ..integrate.trajectory import Trajectory
from ..reduction.formulation.base import AbstractFormulation
from ..reduction.formulation.galerkin import Galerkin
from ..reduction.formulation.minimal import Minimal
from ..reduction.reduce import reduce
from ..system import unit_length
from ..system.base import AbstractSystem
from ..system.stabilization import Baumgarte, Stabilization
from .compare import Comparison, compare
from .projected import Projected
from .timing import worked

# The chapter samples at 100 Hz, then at 300 Hz to see whether the ranks move.
REFINEMENT = 3


@dataclasses.dataclass(frozen=True)
class Run:
    """One model, simulated: what it is, how long it took and how far off it is."""

    name: str
    system: AbstractSystem
    trajectory: Trajectory
    compile_time: float  # [s] of the processor, first call less a later one
    run_time: float  # [s] of the processor, least of the later calls
    comparison: Comparison
    basis: Basis | None = None  # None for the full model, as is the formulation
    formulation: AbstractFormulation | None = None

    @property
    def degrees_of_freedom(self) -> int | None:
        """Coordinates that the constraints leave free; None for a formulation that is for reference
        only, since it keeps the constraints of the full system, not of its own coordinates.
        """
        if self.formulation is not None and self.formulation.for_reference:
            return None
        return unit_length.freedoms(self.system)


@dataclasses.dataclass(frozen=True)
class Ranks:
    """The ranks that the methods report at one sample rate."""

    rate: float  # [Hz]
    naive: int  # generalised SVD of raw snapshots (equation 39.13)
    pod: int
    sod: int

    @classmethod
    def of(cls, rate: float, motion: Trajectory) -> "Ranks":
        """Find the ranks of a motion sampled at that rate."""
        bases = (POD("drop")(motion), SOD("drop")(motion))
        return cls(rate, naive_sod(motion).rank, *(basis.rank for basis in bases))


@dataclasses.dataclass(frozen=True)
class ReductionStudy:
    """The full run first, then the reduced ones; bases by name; ranks at both sample rates."""

    runs: list[Run]
    bases: dict[str, Basis]
    ranks: list[Ranks]
    refused: dict[str, str]  # models that were not made, and why

    @property
    def full(self) -> Run:
        return self.runs[0]


def reduction_study(
    system: AbstractSystem,
    end: float,
    rate: float,
    *,
    pod_rank: Rank | None = None,
    sod_rank: Rank | None = None,
    rtol: float = 1e-8,
    solver: diffrax.AbstractSolver[Any] | None = None,
    repeats: int = 2,
) -> ReductionStudy:
    """Simulate, reduce by POD and SOD, each in all formulations, and compare.

    **Arguments:**

    - `system`: the full system.
    - `end`: simulated time [s]; `rate`: sample rate of the snapshots [Hz].
    - `pod_rank`, `sod_rank`: numbers of modes; the drop point unless given.
    - `rtol`: of all runs; a basis cannot be better than its snapshots.
    - `solver`: of all runs; for each the one that suits it unless given.
    - `repeats`: how many times each run is timed.

    Raises InputError for an end or a rate that make no time grid, SimulationError if the full run
    fails. A reduced model that is refused or fails is reported, not raised.
    """
    if not (end > 0 and rate > 0 and end * rate >= 1):
        raise InputError(f"study: end={end} s at rate={rate} Hz is no sample; make both larger.")
    ts = jnp.linspace(0.0, end, REFINEMENT * round(end * rate) + 1)
    runner = _Runner(ts, rtol, solver, repeats)
    full = runner.run("full", system, "default", None)
    fine = full.trajectory
    coarse = fine.every(REFINEMENT)
    bases = {made.name: made(coarse) for made in (POD(pod_rank), SOD(sod_rank))}
    refused: dict[str, str] = {}
    runs = [full, *_reduced_runs(full, bases, runner, refused)]
    ranks = [Ranks.of(rate, coarse), Ranks.of(REFINEMENT * rate, fine)]
    return ReductionStudy(runs, bases, ranks, refused)


@dataclasses.dataclass(frozen=True)
class _Runner:
    """Runs and times every model in the same way."""

    ts: Float[Array, " k"]
    rtol: float
    solver: diffrax.AbstractSolver[Any] | None
    repeats: int

    def run(
        self,
        name: str,
        system: AbstractSystem,
        stabilization: Stabilization | Literal["default"],
        truth: Trajectory | None,
    ) -> Run:
        """Simulate and compare with the `truth`; without one, a run that fails raises.

        Models are compared, so that an audit of their energy, which takes as long again to compile,
        would tell nothing new.
        """

        def simulated() -> Trajectory:
            return simulate(
                system,
                self.ts,
                rtol=self.rtol,
                solver=self.solver,
                stabilization=stabilization,
                throw=truth is None,
                audit=truth is None,
            )

        trajectory, first = worked(simulated)
        least = min(worked(simulated)[1] for _ in range(self.repeats))
        comparison = compare(trajectory if truth is None else truth, trajectory)
        return Run(name, system, trajectory, first - least, least, comparison)


def _reduced_runs(
    full: Run,
    bases: dict[str, Basis],
    runner: _Runner,
    refused: dict[str, str],
) -> Iterator[Run]:
    """Each basis in each formulation; the reasons of refusals go into `refused`."""
    # One stabilisation for all: that of the full run.
    used = full.trajectory.stats.stabilization
    baumgarte = used if isinstance(used, Baumgarte) else None
    for formulation in (Galerkin(), Minimal(), Projected(baumgarte)):
        for basis in bases.values():
            name = f"{basis.name} {formulation.name}"
            try:
                rom = reduce(full.system, basis, formulation)
            except ReductionError as error:
                refused[f"{name}, r = {basis.rank}"] = str(error)
                continue
            run = runner.run(name, rom, used if rom.m else None, full.trajectory)
            yield dataclasses.replace(run, basis=basis, formulation=formulation)
