"""A reduced model that holds in a box of parameters."""

import dataclasses
import math
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ...common.errors import InputError
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem, beginning_at
from ...system.reduced import AbstractReducedSystem, reduced_of
from ..errors.corrected import corrected, true_start
from ..errors.flow import Flows
from ..errors.residual import with_motion
from ..errors.richer import Finer
from ..errors.richer_run import told
from .box import Box

# A model of a box is validated with this confidence.
_CONFIDENCE = 0.95
# The share of unseen runs that a factor on estimates is to cover.
_COVERED = 0.95


@runtime_checkable
class Training(Protocol):
    """The training runs of a model, which make others of it."""

    def with_run(self, tol: float, parameters: dict[str, float]) -> "ReducedBox":
        """The model of one more training run, for a tolerance."""

    def flows(
        self, rom: AbstractReducedSystem, finer: tuple[Finer, ...], times: Any
    ) -> Flows | None:
        """The flow of errors along the training runs."""


@dataclasses.dataclass(frozen=True)
class ReducedBox:
    """A reduced model of all mechanisms of a `box`.

    - `rom`: the model, of the mechanism in the middle; `finer`: those whose difference estimates
      its error, with their names, richer ones first; () of a model with all freedoms. `tol`: the
      error asked for.
    - `training`: the parameters of its training runs, each array (runs,).
    - `candidates`: the parameters at which its error was estimated, and `estimates` (candidates,).
    - `held_out`: those at which it was measured, by full runs that it was not made of, and
      `errors` (held out,); `guesses` (held out,): what was estimated there.
    - `flows`: the flow of errors along the training runs, by which `corrected` and `sweep_over`
      estimate errors; None unless asked for, and of a model with all freedoms.
    - `greedy`: the training runs themselves, to go on from.
    """

    box: Box
    rom: AbstractReducedSystem
    finer: tuple[Finer, ...]
    tol: float
    training: dict[str, np.ndarray]
    candidates: dict[str, np.ndarray]
    estimates: np.ndarray
    held_out: dict[str, np.ndarray]
    errors: np.ndarray
    guesses: np.ndarray
    flows: Flows | None
    greedy: Training = dataclasses.field(repr=False)

    @property
    def error(self) -> float:
        """The largest error that was estimated or measured."""
        return float(np.max([*self.estimates, *self.errors]))

    @property
    def share(self) -> float:
        """The share of the box in which errors are no larger than the largest measured one, with a
        confidence of 95 %: with n runs, 0.05^(1/n) (Wilks 1941, doi:10.1214/aoms/1177731788).
        """
        count = len(self.errors)
        return float((1 - _CONFIDENCE) ** (1 / count)) if count else 0.0

    @property
    def factor(self) -> tuple[float, float]:
        """The factor by which estimates are multiplied to cover errors, and the share of other runs
        that it covers, by the held-out runs: the least of these factors that covers 19 of 20, or
        the largest one, which covers n of n + 1, where there are fewer than 19 (Wilks 1941).

        Estimates are those by `finer`, as in `sweep_over` without a flow. `corrected` judges by a
        flow, or by one more mode in each body for joint forces; for an estimate that this factor
        covers give `by=ReducedBox.finer[0].model` to `romjax.corrected`.

        Infinite, and zero, without held-out runs or where nothing was estimated.
        """
        return covering(self.errors, self.guesses if self.finer else np.zeros(0))

    def at(self, **parameters: float) -> AbstractReducedSystem:
        """The reduced model of the mechanism of some parameters, from its own start; those that are
        not given are in the middle.

        Raises InputError outside of the box.
        """
        return reduced_as(self.rom, self.box.system(**parameters))

    def corrected(self, run: Trajectory) -> Trajectory:
        """A run of the model with its error, as `romjax.corrected`: by the flow along the nearest
        training run where flows are kept, which takes no second run, else by a richer model.

        The flow is linear: beyond 5 % it says no more than that the run is not to be used.

        Raises InputError for the run of another model, and with a flow for a run at other times
        than those of the training.
        """
        rom = reduced_of(run.system)
        if rom is None or rom.n != self.rom.n:
            raise InputError(
                f"ReducedBox.corrected: the run is one of {run.system.n} coordinates, but the "
                f"model of the box has {self.rom.n}; simulate ReducedBox.at(…)."
            )
        if self.flows is None:
            return corrected(rom, run)
        if not np.array_equal(run.t, self.flows.t):
            raise InputError(
                f"ReducedBox.corrected: the run has {len(run.t)} output times that are not those "
                f"of the training, {len(self.flows.t)} from {float(self.flows.t[0]):g} to "
                f"{float(self.flows.t[-1]):g} s, by which the flow is kept; simulate at these."
            )
        q, v = true_start(rom, run)
        change, rate = self.flows.error(rom, run, q, v)
        start = beginning_at(rom.full, q, v)
        other = with_motion(rom.full, start, run, run.q + change, run.v + rate)
        return told(run, other, "flow along a training run")

    def flows_at(self, times: Any) -> Flows | None:
        """The flow of errors along the training runs at some output times [s]."""
        if self.flows is None or np.array_equal(times, self.flows.t):
            return self.flows
        return self.greedy.flows(self.rom, self.finer, times)

    def trained_at(self, **parameters: float) -> "ReducedBox":
        """The model with the full run of some parameters in its training too; it is estimated and
        measured anew. Those that are not given are in the middle.

        Raises InputError outside of the box, ReductionError if no rank reaches `tol` then.
        """
        return self.greedy.with_run(self.tol, self.box.center | parameters)

    def summary(self) -> str:
        """Say in words of how many runs the model was made, and how well it does."""
        count = len(next(iter(self.training.values())))
        words = f"{self.rom.summary}; {count} training run{'s' * (count > 1)}"
        words += f"; at most {np.max(self.estimates):.1e} estimated at {len(self.estimates)} points"
        if len(self.errors):
            words += f", {np.max(self.errors):.1e} measured at {len(self.errors)} that no snapshot "
            words += f"is from: {self.share:.0%} of the box with a confidence of {_CONFIDENCE:.0%}"
        factor, covered = self.factor
        if covered:
            words += (
                f"; errors within {factor:.3g} times the estimate in {covered:.1%} of runs, as "
            )
            words += f"{len(self.errors)} tell"
            words += " (95.0% need 19 or more)" if covered < _COVERED else ""
        return words


def covering(errors: np.ndarray, estimates: np.ndarray) -> tuple[float, float]:
    """The factor on estimates that covers errors, and the share of unseen runs that it covers."""
    n = len(estimates)
    if not n or len(errors) != n:
        return math.inf, 0.0
    known = np.where(errors > 0, errors, 0.0) / np.maximum(estimates, np.finfo(float).tiny)
    ratios = np.sort(known)
    # The last of n + 1 ratios that are drawn alike is above the k-th in n + 1 - k cases of n + 1.
    k = min(math.ceil(_COVERED * (n + 1) - 1e-9), n)
    return float(ratios[k - 1]), k / (n + 1)


def reduced_as(rom: AbstractReducedSystem, system: AbstractSystem) -> AbstractReducedSystem:
    """A reduced model for a system with other numbers, from its own start."""
    return rom.with_full(system).starting_at(system.q0, system.v0)
