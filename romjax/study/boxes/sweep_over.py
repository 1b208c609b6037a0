"""Many mechanisms of a box: by its reduced model where that holds, else by the full one."""

import dataclasses
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ...common.arrays import as_number
from ...common.errors import InputError, ReductionError, SimulationError
from ...integrate.settings import check_times
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...system.reduced import AbstractReducedSystem
from ..errors.flow import Flows
from ..ranks.rank_search import SAFETY, sharper
from ..sweeps.sweep import Sweep, sweep
from .box import Box
from .estimate import run_with_error_by_flow, run_with_error_estimate
from .reduced_box import ReducedBox


@dataclasses.dataclass(frozen=True)
class BoxSweep(Sweep):
    """The result of `sweep_over`: a `Sweep`, and how each lane was computed.

    - `by_full` (lanes,): whether by the full model.
    - `estimates` (lanes,): of the errors of the reduced runs; zero of full ones.
    - `reduced`: the model of the box, with the full runs that joined its training.
    """

    by_full: np.ndarray
    estimates: np.ndarray
    reduced: ReducedBox


def sweep_over(
    reduced: ReducedBox,
    parameters: Mapping[str, ArrayLike],
    ts: ArrayLike,
    see: Callable[[Trajectory], Any],
    *,
    learn: int = 3,
    chunk: int | None = None,
    path: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> BoxSweep:
    """Run many mechanisms, none with a larger error than asked for, and return what is seen.

    The reduced model simulates all points within its box, and one of a richer kind estimates the
    errors, or the flow of errors along the training runs where that is kept. Where the estimate is
    above half of `ReducedBox.tol`, where something speaks against the run, and outside of the box,
    the full model takes over. While it would have to at many points, the full run of the worst one
    joins the training, and the better model tries the others first (a hierarchy of models:
    Haasdonk, Kleikamp, Ohlberger, Schindler, Wenzel 2022, arXiv:2204.13454).

    **Arguments:**

    - `reduced`: of `reduce_over`. Its box must make scenes of traced numbers, as `jax.grad` asks.
    - `parameters`: by name, each array (lanes,); those that are not given are in the middle.
    - `ts` (k,): times of the runs [s]. `see`: from a Trajectory to a pytree of arrays.
    - `learn`: the most runs that join the training, as long as more points than that are doubted;
      each of them compiles a model.
    - `chunk`, `path`, `progress`: as `sweep`. Processes that share a `path` all train alike.

    Raises InputError for a parameter that the box does not have, or values of different counts.
    """
    points = _points(reduced, parameters)
    times = check_times("sweep_over", ts, jnp.result_type(float))
    lanes = _Lanes(reduced, points, times, see, {"chunk": chunk, "progress": progress}, path)
    inside = [reduced.box.ranges[name].holds(x) for name, x in points.items()]
    lanes.by_model(np.flatnonzero(np.all(inside, axis=0)))
    for _ in range(learn):
        if len(lanes.doubted) <= learn or not lanes.learn():
            break
    lanes.by_full_model()
    together = _together(len(lanes.by_full), lanes.parts)
    return BoxSweep(*together, points, lanes.by_full, lanes.estimates, lanes.reduced)


class _Lanes:
    """The lanes that are computed, and how; `parts` are numbers of lanes with their sweeps."""

    def __init__(
        self,
        reduced: ReducedBox,
        points: dict[str, np.ndarray],
        times: Float[Array, " k"],
        see: Callable[[Trajectory], Any],
        settings: dict[str, Any],
        path: str | os.PathLike[str] | None,
    ):
        self.reduced, self.points, self.times = reduced, points, times
        self.see, self.settings, self.path = see, settings, path
        self.rtol = as_number(sharper(reduced.tol), times.dtype)
        count = len(next(iter(points.values())))
        self.by_full, self.estimates = np.ones(count, bool), np.zeros(count)
        # Within the box, of which the model is not sure, and how large it says its errors are.
        self.doubted, self.changes = np.zeros(0, int), np.zeros(0)
        self.parts: list[tuple[np.ndarray, Sweep]] = []

    def by_model(self, numbers: np.ndarray) -> None:
        """Lanes by the reduced model; what it is not sure of is `doubted`."""
        if not len(numbers):
            return
        reduced, times = self.reduced, self.times
        # Where all freedoms are there, what remains are the flags.
        finer = tuple(one.model for one in reduced.finer)
        settings = times, self.rtol, reduced.flows_at(times)
        cheap = _ByModel(reduced.box, self.see, reduced.rom, finer, *settings)
        part = self._swept(cheap, numbers)
        change = part.values["change"]
        good = part.is_valid & (change <= reduced.tol / SAFETY)
        self.by_full[numbers[good]], self.estimates[numbers[good]] = False, change[good]
        self.doubted, self.changes = numbers[~good], change[~good]
        self.parts.append((numbers, part))

    def learn(self) -> bool:
        """Train the model at the worst of the doubted lanes, and try all of them again; False if no
        model is good enough.
        """
        # A run that failed has no estimate: it is the worst.
        worst = self.doubted[np.argmax(np.where(np.isfinite(self.changes), self.changes, np.inf))]
        parameters = {name: float(x[worst]) for name, x in self.points.items()}
        try:
            self.reduced = self.reduced.trained_at(**parameters)
        except (ReductionError, SimulationError):
            return False
        self.by_model(self.doubted)
        return True

    def by_full_model(self) -> None:
        """All others."""
        accurate = _ByFull(self.reduced.box, self.see, self.times, self.rtol)
        others = np.flatnonzero(self.by_full)
        if len(others):
            self.parts.append((others, self._swept(accurate, others)))

    def _swept(self, lane: Callable[[Any], Any], numbers: np.ndarray) -> Sweep:
        """Some lanes, whose chunks have a folder of their own."""
        path = None if self.path is None else Path(self.path) / f"part-{len(self.parts)}"
        return sweep(lane, _at(self.points, numbers), path=path, **self.settings)


class _ByModel(eqx.Module):
    """A function of parameters: what is seen of a reduced run, and the estimate of its error."""

    box: Box = eqx.field(static=True)
    see: Callable[[Trajectory], Any]
    rom: AbstractReducedSystem
    finer: tuple[AbstractReducedSystem, ...]
    times: Float[Array, " k"]
    rtol: Any
    flows: Flows | None

    def __call__(self, point: dict[str, Any]) -> dict[str, Any]:
        system, judged = self.box.system_anywhere(point), (self.times, self.rtol)
        if self.flows is not None:
            run, change = run_with_error_by_flow(self.rom, self.flows, system, *judged)
        else:
            _, run, change = run_with_error_estimate(self.rom, self.finer, system, *judged)
        return {"seen": self.see(run), "change": change, "flags": run.flags, "status": run.status}


class _ByFull(eqx.Module):
    """A function of parameters: what is seen of a full run."""

    box: Box = eqx.field(static=True)
    see: Callable[[Trajectory], Any]
    times: Float[Array, " k"]
    rtol: Any

    def __call__(self, point: dict[str, Any]) -> dict[str, Any]:
        run = simulate(self.box.system_anywhere(point), self.times, rtol=self.rtol, throw=False)
        return {"seen": self.see(run), "flags": run.flags, "status": run.status}


def _together(
    lanes: int, parts: list[tuple[np.ndarray, Sweep]]
) -> tuple[Any, np.ndarray, np.ndarray]:
    """Return what was seen, the status and the flags of all lanes; of a lane in two parts, those of
    the later one.
    """
    status, flags = np.zeros(lanes, int), np.zeros(lanes, int)
    seen, tree = jax.tree.flatten(parts[0][1].values["seen"])
    arrays = [np.zeros((lanes, *x.shape[1:]), x.dtype) for x in seen]
    for numbers, part in parts:
        status[numbers], flags[numbers] = part.status, part.flags
        for whole, x in zip(arrays, jax.tree.leaves(part.values["seen"]), strict=True):
            whole[numbers] = x
    return jax.tree.unflatten(tree, arrays), status, flags


def _points(reduced: ReducedBox, parameters: Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
    """The parameters as arrays of one length; raises InputError if they are not."""
    reduced.box.check_names(parameters)
    points = {name: np.asarray(x, float) for name, x in parameters.items()}
    shapes = {x.shape for x in points.values()}
    if len(shapes) != 1 or any(len(shape) != 1 or shape == (0,) for shape in shapes):
        given = ", ".join(map(str, shapes)) or "none"
        raise InputError(
            f"sweep_over: parameters of the shapes {given}; give each as an array with one value "
            "for each lane."
        )
    return points


def _at(points: dict[str, np.ndarray], numbers: np.ndarray) -> dict[str, np.ndarray]:
    return {name: x[numbers] for name, x in points.items()}
