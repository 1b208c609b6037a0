"""The chapter's study: one full model, its reduced models, what they save and what they cost."""

import dataclasses
import time
from collections.abc import Callable

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..basis.basis import Basis
from ..basis.decomposition.naive import naive_sod
from ..basis.decomposition.pod import pod
from ..basis.decomposition.sod import sod
from ..basis.rank import Rank
from ..errors import ReductionError
from ..integrate.simulate import simulate
from ..integrate.trajectory import Trajectory
from ..reduction.reduce import reduce
from ..system.base import AbstractSystem
from ..system.stabilization import Stabilization
from .compare import Comparison, compare

# The chapter samples at 100 Hz, then at 300 Hz to see whether the ranks move.
REFINEMENT = 3


@dataclasses.dataclass(frozen=True)
class Run:
    """One model, simulated: what it is, how long it took and how far off it is."""

    name: str
    system: AbstractSystem
    trajectory: Trajectory
    compile_time: float  # [s] first call less a later one
    run_time: float  # [s] least of the later calls
    comparison: Comparison


@dataclasses.dataclass(frozen=True)
class Ranks:
    """The ranks that the methods report at one sample rate."""

    rate: float  # [Hz]
    naive: int  # generalised SVD of raw snapshots (equation 39.13)
    pod: int
    sod: int


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
    repeats: int = 2,
    report: Callable[[str], None] = lambda stage: None,
) -> ReductionStudy:
    """Simulate, reduce by POD and SOD, each in all formulations, and compare.

    **Arguments:**

    - `system`: the full system.
    - `end`: simulated time [s]; `rate`: sample rate of the snapshots [Hz].
    - `pod_rank`, `sod_rank`: numbers of modes; the drop point unless given.
    - `rtol`: of all runs; a basis cannot be better than its snapshots.
    - `repeats`: how many times each run is timed.
    - `report`: called with a few words before each stage.

    Raises ValueError for an end or a rate that make no time grid, SimulationError if the full run
    fails. A reduced model that is refused or fails is reported, not raised.
    """
    if not (end > 0 and rate > 0 and end * rate >= 1):
        raise ValueError(f"study: end={end} s at rate={rate} Hz is no sample; make both larger.")
    samples = round(end * rate)
    ts = jnp.linspace(0.0, end, REFINEMENT * samples + 1)
    report("full model")
    full = _run("full", system, ts, rtol, "default", repeats, None)
    fine = full.trajectory
    coarse = fine.every(REFINEMENT)
    bases = {"POD": pod(coarse, pod_rank), "SOD": sod(coarse, sod_rank)}
    # One stabilisation for all: that of the full run.
    used = fine.stats.stabilization
    runs, refused = [full], {}
    for formulation in ("galerkin", "minimal", "projected"):
        for kind, basis in bases.items():
            name = f"{kind} {formulation}, r = {basis.rank}"
            report(name)
            try:
                rom = reduce(system, basis, formulation)
            except ReductionError as error:
                refused[name] = str(error)
                continue
            stabilization = used if rom.m else None
            runs.append(_run(f"{kind} {formulation}", rom, ts, rtol, stabilization, repeats, fine))
    ranks = [
        Ranks(
            hertz,
            naive_sod(motion).rank,
            pod(motion, "drop").rank,
            sod(motion, "drop").rank,
        )
        for hertz, motion in ((rate, coarse), (REFINEMENT * rate, fine))
    ]
    return ReductionStudy(runs, bases, ranks, refused)


def _run(
    name: str,
    system: AbstractSystem,
    ts: Float[Array, " k"],
    rtol: float,
    stabilization: Stabilization | str,
    repeats: int,
    truth: Trajectory | None,
) -> Run:
    times = []
    for _ in range(1 + repeats):
        start = time.perf_counter()
        trajectory = simulate(
            system,
            ts,
            rtol=rtol,
            stabilization=stabilization,
            adjoint=diffrax.ForwardMode(),  # no gradient is asked for: the plain loop traces faster
            throw=truth is None,
        )
        jax.block_until_ready(trajectory.q)
        times.append(time.perf_counter() - start)
    least = min(times[1:])
    comparison = compare(trajectory if truth is None else truth, trajectory)
    return Run(name, system, trajectory, times[0] - least, least, comparison)
