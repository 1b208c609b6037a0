"""The numbers of a run as variables of a dataset: names, dimensions and units."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ...assembly.names import unique
from ...common.described import Described
from ...common.errors import InputError
from ...events.record import Events
from ...integrate.follow.branching import Branching
from ...integrate.follow.energy_balance import EnergyBalance
from ...integrate.statistics import Statistics
from ...integrate.status import Status
from ...integrate.step_states import StepStates
from ...integrate.trajectory import Trajectory
from ...system.flags import Flag
from ...system.stabilization import Baumgarte, Projection

# A variable: its dimensions, its values, its attributes.
Variable = tuple[tuple[str, ...], Any, dict[str, Any]]

# The arrays of a run itself, with the axes after that of lanes.
ARRAYS = {
    "q": Described(("time", "coordinate"), "", "generalized coordinates"),
    "v": Described(("time", "coordinate"), "", "their rates"),
    "violation": Described(("time",), "m or rad", "largest size of the constraints"),
    "imbalance": Described(("time",), "J", "energy gained, and not by work, up to the step before"),
    "multipliers": Described(("time", "constraint"), "N or N m", "Lagrange multipliers"),
    "metric": Described(("coordinate", "column"), "", "mass matrix at the start"),
}


class Record(NamedTuple):
    """A field of runs that is a record, or None: its class, and the `prefix` of names in files."""

    kind: Any
    prefix: str


RECORDS = {
    "stats": Record(Statistics, ""),
    "balance": Record(EnergyBalance, "balance_"),
    "branching": Record(Branching, "branching_"),
    "states": Record(StepStates, "step_"),
    "events": Record(Events, "event_"),
}


def variables_of(run: Trajectory) -> dict[str, Variable]:
    """All numbers of a run, or of runs of one batch, whose first dimension is `lane`."""
    lanes = ("lane",) * (run.t.ndim - 1)
    variables: dict[str, Variable] = {}

    def put(name: str, axes: tuple[str, ...], value: Any, unit: str, meaning: str) -> None:
        if value is not None:
            attributes = {"long_name": meaning} | ({"units": unit} if unit else {})
            variables[name] = (lanes + axes, np.asarray(value), attributes)

    def put_record(owner: Any, arrays: Mapping[str, Described], prefix: str = "") -> None:
        for name, (axes, unit, meaning) in arrays.items():
            put(prefix + name, axes, getattr(owner, name), unit, meaning)

    put_record(run, ARRAYS)
    variables["q"][2]["units"] = _together(run, "")
    variables["v"][2]["units"] = _together(run, "/s")
    put("status", (), run.status, "1", "how the run ended")
    variables["status"][2].update(meanings_of_status())
    put("flags", (), run.flags, "1", "what speaks against it, as a sum")
    variables["flags"][2].update(meanings_of_flags())
    for field, (kind, prefix) in RECORDS.items():
        record = getattr(run, field)
        if record is not None:
            record = _of_one_run(record) if kind is Events else record
            put_record(record, kind.arrays(), prefix)
    if run.bar is not None:
        put("estimate", (), run.bar.error, "1", "estimated error of the run that it corrects")
        if run.bar.groups:
            put("estimate_per_group", ("group",), run.bar.per_group, "1", "that of each group")
    # One number for all constraints, or one for each.
    used = run.stats.stabilization
    if isinstance(used, Baumgarte):
        rows = ("constraint",) * (np.ndim(used.alpha) - len(lanes))
        put("baumgarte_alpha", rows, used.alpha, "1/s", "of Baumgarte's stabilisation")
        put("baumgarte_beta", rows, used.beta, "1/s^2", "of Baumgarte's stabilisation")
    elif isinstance(used, Projection):
        variables["projection_sweeps"] = ((), used.sweeps, {"long_name": "of each projection"})
    return variables


def _together(run: Trajectory, per: str) -> str:
    """The units of all coordinates; which has which is in `coordinate_unit`."""
    # Metres and radians stand in one array.
    units = dict.fromkeys(column.unit or "unknown" for column in run.coordinates)
    return " or ".join(f"{unit}{per}" for unit in units)


def _of_one_run(events: Events) -> Events:
    if events.count.ndim:
        raise InputError(
            "Trajectory.to_xarray: events of several runs at once are of different number; map "
            "over the runs, and save each by itself."
        )
    return events.without_unused()


def meanings_of_flags() -> dict[str, Any]:
    """Return the meanings of the bits of flags, as attributes."""
    return _meanings(Flag)


def meanings_of_status() -> dict[str, Any]:
    """Return the meanings of the numbers of a status, as attributes."""
    return _meanings(Status)


def _meanings(kind: Any) -> dict[str, Any]:
    """Return the meanings of the values of an enumeration, in the words of the CF conventions."""
    members = list(kind)
    name = "flag_masks" if kind is Flag else "flag_values"
    return {
        name: np.array([int(member) for member in members], np.int64),
        "flag_meanings": " ".join(member.name.lower() for member in members),
    }


def names_of(run: Trajectory) -> dict[str, Variable]:
    """Return the variables that name output times, coordinates, constraints and lanes."""
    columns = run.coordinates
    named: dict[str, Variable] = {
        "time": (("time",), times_of(run), {"units": "s", "long_name": "time"}),
        "coordinate": (("coordinate",), _texts(run.labels), {"long_name": "its label"}),
        "constraint": (("constraint",), _texts(_constraints(run)), {"long_name": "its joint"}),
    }
    for field in ("owner", "name", "unit", "symbol", "description"):
        values = _texts([getattr(column, field) for column in columns])
        named[f"coordinate_{field}"] = (("coordinate",), values, {"long_name": field})
    if run.bar is not None and run.bar.groups:
        words = {"long_name": "position, angle or deflection of a body"}
        named["group"] = (("group",), _texts(run.bar.groups), words)
    if run.t.ndim > 1:
        named["lane"] = (("lane",), np.arange(len(run.t)), {"long_name": "one run of a batch"})
    return named


def times_of(run: Trajectory) -> np.ndarray:
    """The output times, of all lanes; raises InputError where these differ."""
    times = np.asarray(run.t)
    if times.ndim == 1:
        return times
    # A sweep hides all numbers of lanes that failed.
    known = times[np.all(np.isfinite(times), axis=1)]
    if len(known) == 0:
        return np.full(times.shape[1], np.nan)
    if np.any(known != known[:1]):
        raise InputError(
            "Trajectory.to_xarray: the lanes have different output times; save each by itself."
        )
    first: np.ndarray = known[0]
    return first


def _constraints(run: Trajectory) -> list[str]:
    count = run.multipliers.shape[-1]
    if run.derived.parts is None:
        return [f"constraint {i + 1}" for i in range(count)]
    return unique(run.system.structure.constraints)


def _texts(words: Any) -> np.ndarray:
    return np.array(list(words), dtype=object)
