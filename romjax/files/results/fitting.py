"""Whether the arrays in a file of a run fit each other, the run and its scene."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...common.errors import InputError
from ...integrate.status import Status
from ...integrate.trajectory import Trajectory
from ...scene.coordinate import Coordinate
from ...system.flags import Flag
from .variables import ARRAYS, RECORDS

# Numbers that a run that went well knows at all times.
_FINITE = ("time", "q", "v", "violation")
_WHOLE = ("num_steps", "num_accepted_steps", "num_rejected_steps", "status", "flags")
_TRUTHS = ("event_happened", "event_lasting")
_OF_BARS = ("estimate", "estimate_per_group", "group")


def check_arrays(dataset: Any, path: Any) -> None:
    """Raise InputError, with what is wrong, for a dataset of a run whose arrays do not fit."""
    for wrong in _mistakes(dataset):
        raise _damaged(path, wrong)


def check_scene(run: Trajectory, dataset: Any, path: Any) -> None:
    """Raise InputError where a run that was read does not fit the scene that was beside it."""
    if run.derived.parts is None:
        return
    structure = run.system.structure
    if structure.labels != run.labels:
        raise _damaged(
            path,
            f"its coordinates are {listed(run.labels)}, but those of its scene are "
            f"{listed(structure.labels)}",
        )
    rows, count = dataset.sizes.get("constraint", 0), len(structure.constraints)
    if dataset.attrs.get("model") == "full" and rows != count:
        raise _damaged(path, f"it has {rows} constraints, but its scene has {count}")


def _damaged(path: Any, wrong: str) -> InputError:
    return InputError(
        f"load: {path} is damaged: {wrong}; save the run again, or open the file by "
        "xarray.open_dataset."
    )


def _mistakes(dataset: Any) -> Iterator[str]:
    if "time" not in dataset.variables:  # of a dimension without it, xarray would count
        yield "it has no 'time'"
        return
    if not dataset["time"].size:
        yield "'time' is empty"
        return
    lanes = ("lane",) if "lane" in dataset.sizes else ()
    for name, wanted in dimensions_of(lanes).items():
        if name not in dataset or (name in _OF_BARS and "estimate_by" not in dataset.attrs):
            continue  # optional, missed by the reader, or measured and called so before it was kept
        variable = dataset[name]
        if variable.dims not in wanted:
            allowed = " or ".join(f"({', '.join(dims)})" for dims in wanted)
            yield f"'{name}' has the dimensions ({', '.join(variable.dims)}) instead of {allowed}"
        kinds, words = _kinds(name)
        if variable.dtype.kind not in kinds:
            yield f"'{name}' has the type {variable.dtype} instead of {words}"
    if "column" in dataset.sizes and dataset.sizes["column"] != dataset.sizes.get("coordinate"):
        yield f"'metric' has the shape {dataset['metric'].shape}, which is not square"
    types = {str(dataset[name].dtype) for name in _FINITE if name in dataset}
    if len(types) > 1:
        yield f"time, q, v and violation have the types {listed(sorted(types))}, but one is needed"
    if "status" in dataset:
        yield from _in_status(dataset)
    if "flags" in dataset and np.any(dataset["flags"].values & ~int(~Flag.NONE)):
        yield f"flags is {listed(np.unique(dataset['flags'].values))}, which means nothing"
    for name in _WHOLE[:3]:
        if name in dataset and np.any(dataset[name].values < 0):
            yield f"'{name}' is negative"


def _in_status(dataset: Any) -> Iterator[str]:
    """List the problems of a status: values that no run has, or that do not fit each other."""
    status = np.atleast_1d(dataset["status"].values)
    unknown = set(status.tolist()) - {int(member) for member in Status}
    if unknown:
        yield f"status is {listed(sorted(unknown))}, which means nothing"
    well = status == Status.SUCCESS
    if not np.any(well):
        return
    for name in [name for name in _FINITE if name in dataset]:
        values = dataset[name].values
        if dataset["status"].ndim and name != "time":
            values = values[well]
        if not np.all(np.isfinite(values)):
            yield f"'{name}' holds numbers that are not finite, though the run went well"
    steps = np.diff(dataset["time"].values)
    if np.size(dataset.get("event_time", ())):
        # Outputs after an event that ended the run are those at its time.
        steps = np.trim_zeros(steps, "b")
    if not np.all(steps > 0):
        yield "'time' does not increase"


def dimensions_of(lanes: tuple[str, ...] = ()) -> dict[str, list[tuple[str, ...]]]:
    """Return the dimensions that each variable of a file of results may have."""
    arrays = dict(ARRAYS)
    for kind, prefix in RECORDS.values():
        arrays |= {prefix + name: described for name, described in kind.arrays().items()}
    terms = ("baumgarte_alpha", "baumgarte_beta")
    return {
        "time": [("time",)],
        **{name: [(*lanes, *described.axes)] for name, described in arrays.items()},
        **{name: [lanes] for name in ("status", "flags", "estimate")},
        "estimate_per_group": [(*lanes, "group")],
        "group": [("group",)],
        **{f"coordinate_{field}": [("coordinate",)] for field in Coordinate._fields},
        **{name: [lanes, (*lanes, "constraint")] for name in terms},
        "projection_sweeps": [()],
    }


def _kinds(name: str) -> tuple[str, str]:
    """The kinds of types that a variable may have, and what to call them."""
    if name.startswith("coordinate_") or name == "group":
        return "OUT", "text"
    if name in _TRUTHS:
        return "bi", "a truth value"
    if name in _WHOLE or name in ("branching_repeated", "projection_sweeps"):
        return "iu", "a whole number"
    return "f", "a real number"


def listed(values: Any) -> str:
    """The first of some values as a message has them."""
    words = [str(value) for value in values]
    return ", ".join(words[:8]) + (", …" if len(words) > 8 else "")
