"""Identification over a box: searches on reduced models, checked by full runs."""

import dataclasses
import os
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from ...basis.decomposition.pod import POD
from ...basis.snapshots import Motion, Sensitivity
from ...common.arrays import as_number
from ...common.errors import InputError, SimulationError
from ...compiling.xla import filter_jit
from ...integrate.adjoint import forward_mode
from ...integrate.doubt import warn_of_outcome
from ...integrate.settings import check_times
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.formulation.parse import as_formulation
from ...reduction.reduce import reduce
from ...system.reduced import AbstractReducedSystem
from ..fits.fit import Fit, fit
from ..fits.least_squares import inverse_square
from .box import Box
from .full_runs import FullRuns, Numbers, moved, still
from .reduced_box import reduced_as

# Shares of the predicted gain, below which the region shrinks and above which it grows.
_POOR, _GOOD = 0.25, 0.75
# Parameters stay off the ends of the search by this share of its width: `fit` takes logarithms.
_MARGIN = 1e-6


@dataclasses.dataclass(frozen=True)
class BoxFit(Fit):
    """The result of `fit_over`: a `Fit`, whose `steps` are full runs with their sensitivities.

    - `rom`: the last reduced model.
    """

    rom: AbstractReducedSystem


def fit_over(
    box: Box,
    ts: ArrayLike,
    see: Callable[[Trajectory], Array],
    measured: ArrayLike,
    *,
    start: dict[str, float] | None = None,
    noise: ArrayLike | None = None,
    rank: int = 4,
    formulation: AbstractFormulation | str = "minimal",
    runs: int = 10,
    rtol: float = 1e-8,
    solver: Any = None,
    tol: float = 1e-6,
    path: str | os.PathLike[str] | None = None,
) -> BoxFit:
    """The parameters of a box whose full runs are nearest to measurements, by few full runs.

    A trust region: the model is trained by the full run and its sensitivities at each point that
    was accepted, and corrected to the value and the slope of what was seen at the last one, so that
    the search converges to the optimum of the full model whatever the model errs by (Alexandrov,
    Dennis, Lewis, Torczon 1998, doi:10.1007/BF01197433; with snapshots of sensitivities Zahr,
    Farhat 2015, arXiv:1407.7618). `fit` searches on it within the region, which grows where the
    full run confirms what the model has promised, and shrinks where it does not.

    **Arguments:**

    - `box`: it must make scenes of traced numbers, as `jax.grad` asks. `ts` (k,): times [s].
    - `see`: from a Trajectory to an array of the shape of `measured`; NaN where nothing was.
    - `start`: parameters to begin with; those that are not given are in the middle.
    - `noise`: standard deviation of the measurements; estimated from the residuals unless given.
    - `rank`, `formulation`: of the reduced models.
    - `runs`: the most full runs. `rtol`, `solver`: of all runs, as of `simulate`.
    - `tol`: change of the parameters, in ranges of the box, that ends the search.
    - `path`: a folder for the full runs, by which a fit that was interrupted goes on, and processes
      that fit other measurements of the same times, or begin elsewhere, share those at the same
      parameters and ranges, as of `sweep`. What the box and `see` do is not compared: another
      function needs another folder. Each run follows from the one before: more processes make one
      fit no faster.

    Warns if the full run at the best parameters is doubtful.
    Raises InputError for a start outside of the box, or a shape that differs; SimulationError if
    the full run at the start fails; ValueError for a folder that holds other runs.
    """
    settings = {"rtol": as_number(rtol, float), "solver": solver}
    runner = FullRuns(box, check_times("fit_over", ts, jnp.result_type(float)), see, settings)
    search = _Search(runner, np.asarray(measured, float), noise, path)
    box.system(**(start or {}))
    best = search.full(box.center | (start or {}))
    if not np.isfinite(best.misfit):
        raise SimulationError(f"fit_over: the run at {best.point} has failed; start elsewhere.")
    accepted, radius, success = [best], 0.5, False
    rom, count = search.model(accepted, rank, as_formulation(formulation)), 1
    while count < runs and not success:
        trial, promised, moved = search.step(rom, best, radius)
        if moved <= tol:
            success = True
            break
        one = search.full(trial)
        count += 1
        # A model that promises nothing has no gain to be measured by; any fall exceeds it.
        gain = (best.misfit - one.misfit) / max(best.misfit - promised, 1e-300)
        # A failed run has no misfit: what compares with it is false.
        radius = radius / 4 if not gain > _POOR else 2 * radius if gain > _GOOD else radius
        if one.misfit < best.misfit:
            best = one
            accepted.append(one)
            rom = search.model(accepted, rank, as_formulation(formulation))
        success = bool(radius <= tol)
    return search.result(best, count, success, rom)


class _Point(eqx.Module):
    """A full run: where, what was seen, and the derivatives by parameter, times half of its range.

    - `misfit`: mean square of the weighted residuals; NaN of a run that failed.
    """

    point: dict[str, float] = eqx.field(static=True)
    run: Trajectory
    seen: Array
    slope: Numbers
    sensitivities: list[Sensitivity]
    misfit: float


@dataclasses.dataclass(frozen=True)
class _Search:
    runs: FullRuns
    measured: np.ndarray
    noise: ArrayLike | None
    path: str | os.PathLike[str] | None

    @property
    def box(self) -> Box:
        return self.runs.box

    def full(self, point: dict[str, float]) -> _Point:
        """The full run at a point, with its sensitivities."""
        run, seen, (q, v, slope) = self.runs.at(point, self.path)
        if seen.shape != self.measured.shape:
            raise InputError(
                f"fit_over: see returns the shape {seen.shape}, but measured has "
                f"{self.measured.shape}."
            )
        times = self.runs.times
        changes = [Sensitivity(times, q[name], v[name]) for name in self.box.ranges]
        misfit = self._misfit(seen) if bool(run.success) else np.nan
        return _Point(point, run, seen, slope, changes, misfit)

    def model(
        self, points: list[_Point], rank: int, formulation: AbstractFormulation
    ) -> AbstractReducedSystem:
        """The reduced model of all accepted points."""
        system = self.box.system(**points[0].point)
        snapshots: list[Motion | Sensitivity] = []
        for point in points:
            snapshots += [point.run, *point.sensitivities]
        basis = formulation.basis(system, snapshots, POD(rank))
        # All formulations but those for reference make such systems.
        return reduce(system, basis, formulation)

    def step(
        self, rom: AbstractReducedSystem, best: _Point, radius: float
    ) -> tuple[dict[str, float], float, float]:
        """The best point of the corrected model in the region, its misfit there, and how far away
        it is, in ranges of the box.
        """
        model, where = _Model(rom, self.runs), self.runs.numbers(best.point)
        with forward_mode():
            seen, slope = _linearize(model, where)
        shift = best.seen - seen
        turn = {name: best.slope[name] - x for name, x in slope.items()}
        corrected = _Corrected(model, where, shift, turn)
        lower, upper = {}, {}
        for name, x in best.point.items():
            one = self.box.ranges[name]
            ends = np.array([one.moved(x, -2 * radius), one.moved(x, 2 * radius)])
            width = _MARGIN * (one.high - one.low)
            lower[name] = float(min(max(ends[0], one.low), x - width))
            upper[name] = float(max(min(ends[1], one.high), x + width))
        fitted = fit(
            corrected, best.point, self.measured, noise=self.noise, lower=lower, upper=upper
        )
        trial = {name: float(x) for name, x in fitted.parameters.items()}
        ranges = self.box.ranges.items()
        moved = max(abs(trial[n] - best.point[n]) / (x.high - x.low) for n, x in ranges)
        return trial, self._misfit(np.asarray(corrected(trial))), moved

    def result(self, best: _Point, runs: int, success: bool, rom: AbstractReducedSystem) -> BoxFit:
        """Return the fit, with the covariance of the full model at the best point."""
        present, spread = np.isfinite(self.measured), self._spread()
        residuals = ((np.asarray(best.seen) - self.measured) / spread)[present]
        warn_of_outcome("fit_over, at the best parameters", best.run.status, best.run.flags)
        # In the order of `jax.tree.leaves`.
        names, columns = sorted(best.point), []
        for name in names:
            one, x = self.box.ranges[name], best.point[name]
            unit = x * np.log(one.high / one.low) / 2 if one.log else (one.high - one.low) / 2
            columns.append((np.asarray(best.slope[name]) / spread)[present] / unit)
        square = float(residuals @ residuals)
        variance = 1.0 if self.noise is not None else square / max(1, len(residuals) - len(columns))
        covariance = variance * inverse_square(np.stack(columns, axis=1))
        errors = dict(zip(names, np.sqrt(np.diagonal(covariance)), strict=True))
        residual = float(np.sqrt(square / max(1, len(residuals))))
        return BoxFit(best.point, errors, covariance, residual, runs, success, rom)

    def _spread(self) -> np.ndarray:
        given = 1.0 if self.noise is None else np.asarray(self.noise, float)
        return np.broadcast_to(given, self.measured.shape)

    def _misfit(self, seen: ArrayLike) -> float:
        return float(np.nanmean(((np.asarray(seen) - self.measured) / self._spread()) ** 2))


class _Model(eqx.Module):
    """Runs a reduced model at some parameters and returns what is seen of the run."""

    rom: AbstractReducedSystem
    runs: FullRuns

    def __call__(self, point: Numbers) -> Array:
        runs = self.runs
        rom = reduced_as(self.rom, runs.box.system_anywhere(point))
        return runs.see(simulate(rom, runs.times, throw=False, **runs.settings))


class _Corrected(eqx.Module):
    """A model that is right at one point, with its first derivatives."""

    model: _Model
    point: Numbers
    shift: Array
    turn: Numbers

    def __call__(self, point: Numbers) -> Array:
        seen = self.model(point) + self.shift
        for name, x in self.turn.items():
            share = self.model.runs.box.ranges[name].share(point[name], self.point[name])
            seen = seen + share * x
        return seen


@filter_jit
def _linearize(model: _Model, point: Numbers) -> tuple[Array, Numbers]:
    def motion(shares: Numbers) -> tuple[Array, Array]:
        seen = model(moved(model.runs.box, point, shares))
        return seen, seen

    slope, seen = jax.jacfwd(motion, has_aux=True)(still(model.runs.box))
    return seen, slope
