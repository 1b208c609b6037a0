"""Many mechanisms of a box: by its reduced model where that holds, else by the full one."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from ..arrays import as_array
from ..errors import InputError
from ..integrate.simulate import simulate
from ..integrate.trajectory import Trajectory
from .estimate import run_and_change
from .rank_search import SAFETY, sharper
from .reduced_box import ReducedBox, reduced_as
from .sweep import Sweep, sweep


@dataclasses.dataclass(frozen=True)
class BoxSweep(Sweep):
    """The result of `sweep_over`: a `Sweep`, and how each lane was computed.

    - `by_full` (lanes,): whether by the full model.
    - `estimates` (lanes,): of the errors of the reduced runs; zero of full ones.
    """

    by_full: np.ndarray
    estimates: np.ndarray


def sweep_over(
    reduced: ReducedBox,
    parameters: Mapping[str, ArrayLike],
    ts: ArrayLike,
    see: Callable[[Trajectory], Any],
    *,
    chunk: int | None = None,
    progress: bool = False,
) -> BoxSweep:
    """What is seen of the runs of many mechanisms, none of which errs by more than asked for.

    The reduced model simulates all points within its box, and the model of the next rank estimates
    the errors. Where the estimate is above half of `ReducedBox.tol`, where something speaks against
    the run, and outside of the box, the full model takes over.

    **Arguments:**

    - `reduced`: of `reduce_over`. Its box must make scenes of traced numbers, as `jax.grad` asks.
    - `parameters`: by name, each array (lanes,); those that are not given are in the middle.
    - `ts` (k,): times of the runs [s]. `see`: from a Trajectory to a pytree of arrays.
    - `chunk`, `progress`: as `sweep`.

    Raises InputError for a parameter that the box does not have, or values of different counts.
    """
    box, times, rtol = reduced.box, as_array(ts), sharper(reduced.tol)
    points = _points(reduced, parameters)

    def cheap(point: dict[str, Any]) -> dict[str, Any]:
        if reduced.finer is None:
            # All minimal coordinates are there: what remains are the flags.
            rom = reduced_as(reduced.rom, box.system_anywhere(point))
            run, change = simulate(rom, times, rtol=rtol, throw=False), jnp.zeros_like(times[0])
        else:
            _, run, change = run_and_change(
                reduced.rom, reduced.finer, box.system_anywhere(point), times, rtol
            )
        return {"seen": see(run), "change": change, "flags": run.flags, "status": run.status}

    def accurate(point: dict[str, Any]) -> dict[str, Any]:
        run = simulate(box.system_anywhere(point), times, rtol=rtol, throw=False)
        return {"seen": see(run), "status": run.status}

    inside = [box.ranges[name].holds(x) for name, x in points.items()]
    within = np.flatnonzero(np.all(inside, axis=0))
    by_full, estimates = np.ones_like(inside[0]), np.zeros(inside[0].shape)
    parts = []
    if len(within):
        first = sweep(cheap, _at(points, within), chunk=chunk, progress=progress)
        change = first.values["change"]
        good = first.success & (first.values["flags"] == 0) & (change <= reduced.tol / SAFETY)
        by_full[within[good]], estimates[within[good]] = False, change[good]
        parts.append((within, first))
    others = np.flatnonzero(by_full)
    if len(others):
        parts.append((others, sweep(accurate, _at(points, others), chunk=chunk, progress=progress)))
    values, status = _together(len(by_full), parts)
    return BoxSweep(values, status, points, by_full, estimates)


def _together(lanes: int, parts: list[tuple[np.ndarray, Sweep]]) -> tuple[Any, np.ndarray]:
    """What was seen and the status of all lanes; of a lane in two parts, those of the later one."""
    status = np.zeros(lanes, int)
    seen, tree = jax.tree.flatten(parts[0][1].values["seen"])
    arrays = [np.zeros((lanes, *x.shape[1:]), x.dtype) for x in seen]
    for numbers, part in parts:
        status[numbers] = part.status
        for whole, x in zip(arrays, jax.tree.leaves(part.values["seen"]), strict=True):
            whole[numbers] = x
    return jax.tree.unflatten(tree, arrays), status


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
