"""Outputs of runs over time, as they are plotted under the motion."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...common.checks import unknown_name
from ...common.errors import InputError
from ...integrate.trajectory import Trajectory
from ..choice import choose


class Output(NamedTuple):
    """An output over the frames of a picture.

    - `name`: with its unit. `values`: a column for each run that has it, in the order of the
      models, (frames, curves).
    """

    name: str
    values: Float[np.ndarray, "frames curves"]


# Names of coordinates, how many of those that move most, or values by their names.
Wanted = int | Sequence[str] | Mapping[str, Any]


def outputs_of(
    wanted: Wanted,
    runs: Sequence[Trajectory],
    courses: Sequence[Float[np.ndarray, "frames n"]],
    chosen: Int[np.ndarray, " frames"],
) -> list[Output]:
    """Return what is `wanted` of runs whose coordinates at the frames are `courses`.

    The frames are the outputs `chosen` of the first run. Raises InputError for what the runs do not
    have.
    """
    if not wanted:
        return []
    if not runs:
        raise InputError("animate: outputs are those of a run; give one.")
    if isinstance(wanted, Mapping):
        t = np.asarray(runs[0].t, float)[chosen]
        return [_given(str(name), values, runs, t) for name, values in wanted.items()]
    labels = list(runs[0].labels)
    if isinstance(wanted, int):
        columns, _ = choose("animate", runs[0], None, most=wanted)
    else:
        names = [wanted] if isinstance(wanted, str) else wanted
        for name in names:
            if name not in labels:
                raise unknown_name("animate: outputs", "coordinate", name, labels)
        columns = [labels.index(name) for name in names]
    return [
        Output(name, held(name, np.stack([q[:, column] for q in courses], axis=1)))
        for column in columns
        for name in [_named(runs[0], column)]
    ]


def _named(run: Trajectory, column: int) -> str:
    coordinate = run.coordinates[column]
    return f"{coordinate.label} [{coordinate.unit}]" if coordinate.unit else coordinate.label


def _given(
    name: str, values: Any, runs: Sequence[Trajectory], t: Float[np.ndarray, " frames"]
) -> Output:
    """Values of the first run, or a list with those of each, at the outputs of each."""
    several = values if isinstance(values, list | tuple) and np.ndim(values[0]) else [values]
    columns = []
    for run, own in zip(runs, several, strict=False):
        times, numbers = np.asarray(run.t, float), np.asarray(own, float)
        if numbers.shape != times.shape:
            raise InputError(
                f"animate: the output '{name}' has shape {numbers.shape}, but its run has "
                f"{len(times)} outputs; give a value for each."
            )
        columns.append(np.interp(t, times, numbers, right=numbers[-1]))
    if len(several) > len(runs):
        raise InputError(f"animate: '{name}' has {len(several)} curves for {len(runs)} runs.")
    return Output(name, held(name, np.stack(columns, axis=1)))


def held(
    name: str, values: Float[np.ndarray, "frames columns"]
) -> Float[np.ndarray, "frames columns"]:
    """Repeat the last number of each column where a run has ended, or has none; before its start,
    the first.

    Raises InputError for a column without any.
    """
    known = np.isfinite(values)
    if not np.all(np.any(known, axis=0)):
        raise InputError(f"animate: '{name}' has no finite number; see the run's summary().")
    first = np.argmax(known, axis=0)
    count = np.arange(len(values))[:, None]
    # The number of the last row up to each that has a number.
    last = np.maximum.accumulate(np.where(known, count, first), axis=0)
    return np.take_along_axis(values, last, axis=0)
