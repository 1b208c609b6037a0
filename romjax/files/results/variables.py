"""The numbers of a run as variables of a dataset: names, dimensions and units."""

from typing import Any

import numpy as np

from ...assembly.names import unique
from ...common.errors import InputError
from ...integrate.status import Status
from ...integrate.trajectory import Trajectory
from ...system.flags import Flag
from ...system.stabilization import Baumgarte, Projection

# A variable: its dimensions, its values, its attributes.
Variable = tuple[tuple[str, ...], Any, dict[str, Any]]

# Dimensions after that of lanes, unit, and what it is, of each array of a run.
ARRAYS = {
    "q": (("time", "coordinate"), "", "generalized coordinates"),
    "v": (("time", "coordinate"), "", "their rates"),
    "violation": (("time",), "m or rad", "largest size of the constraints"),
    "imbalance": (("time",), "J", "energy gained, and not by work, up to the step before"),
    "multipliers": (("time", "constraint"), "N or N m", "Lagrange multipliers"),
    "metric": (("coordinate", "column"), "", "mass matrix at the start"),
}
STATISTICS = {
    "num_steps": ("1", "steps"),
    "num_accepted_steps": ("1", "steps that were accepted"),
    "num_rejected_steps": ("1", "steps that were rejected"),
    "rtol": ("1", "relative tolerance of the step size control"),
    "atol": ("1", "absolute tolerance of the step size control"),
    "fastest_frequency": ("rad/s", "fastest frequency of the system at its start"),
}
# Of the balance of energy and the passage of singular positions; joules unless given.
_UNITS = {"time": "s", "ambiguity": "1", "repeated": "1"}
EVENTS = {
    "time": (("occurrence",), "s", "when it happened"),
    "happened": (("occurrence", "event"), "1", "which events did"),
    "impulse": (("occurrence", "event"), "N s", "impulses of impacts"),
    "q": (("occurrence", "coordinate"), "", "generalized coordinates then"),
    "v_before": (("occurrence", "coordinate"), "", "their rates before"),
    "v_after": (("occurrence", "coordinate"), "", "their rates after"),
}


STATES = {
    "t": (("step",), "s", "when steps ended"),
    "q": (("step", "coordinate"), "", "generalized coordinates then"),
    "v": (("step", "coordinate"), "", "their rates then"),
}


def variables_of(run: Trajectory) -> dict[str, Variable]:
    """All numbers of a run, or of runs of one batch, whose first dimension is `lane`."""
    lanes = ("lane",) * (run.t.ndim - 1)
    variables: dict[str, Variable] = {}

    def put(name: str, dimensions: tuple[str, ...], value: Any, unit: str, words: str) -> None:
        if value is not None:
            attributes = {"long_name": words} | ({"units": unit} if unit else {})
            variables[name] = (lanes + dimensions, np.asarray(value), attributes)

    for name, (dimensions, unit, words) in ARRAYS.items():
        put(name, dimensions, getattr(run, name), unit, words)
    variables["q"][2]["units"] = _together(run, "")
    variables["v"][2]["units"] = _together(run, "/s")
    for name, (unit, words) in STATISTICS.items():
        put(name, (), getattr(run.stats, name), unit, words)
    put("status", (), run.status, "1", "how the run ended")
    variables["status"][2].update(meanings_of_status())
    put("flags", (), run.flags, "1", "what speaks against it, as a sum")
    variables["flags"][2].update(meanings_of_flags())
    for owner in ("balance", "branching"):
        parts = getattr(run, owner)
        for name, value in ({} if parts is None else parts._asdict()).items():
            put(f"{owner}_{name}", (), value, _UNITS.get(name, "J"), f"{name}, of the {owner}")
    used = run.stats.stabilization
    if isinstance(used, Baumgarte):
        rows = ("constraint",) * (np.ndim(used.alpha) - len(lanes))
        put("baumgarte_alpha", rows, used.alpha, "1/s", "of Baumgarte's stabilisation")
        put("baumgarte_beta", rows, used.beta, "1/s^2", "of Baumgarte's stabilisation")
    elif isinstance(used, Projection):
        variables["projection_sweeps"] = ((), used.sweeps, {"long_name": "of each projection"})
    if run.states is not None:
        for name, (dimensions, unit, words) in STATES.items():
            put(f"step_{name}", dimensions, getattr(run.states, name), unit, words)
    if run.events is not None:
        _put_events(run, variables)
    return variables


def _together(run: Trajectory, per: str) -> str:
    """The units of all coordinates; which has which is in `coordinate_unit`."""
    units = dict.fromkeys(column.unit or "unknown" for column in run.coordinates)
    return " or ".join(f"{unit}{per}" for unit in units)


def _put_events(run: Trajectory, variables: dict[str, Variable]) -> None:
    if run.t.ndim > 1:
        raise InputError(
            "Trajectory.to_xarray: events of several runs at once are of different number; map "
            "over the runs, and save each by itself."
        )
    assert run.events is not None
    # Rows that nothing happened in are left out.
    count = int(run.events.count)
    for name, (dimensions, unit, words) in EVENTS.items():
        attributes = {"long_name": words} | ({"units": unit} if unit else {})
        values = np.asarray(getattr(run.events, name))[:count]
        variables[f"event_{name}"] = (dimensions, values, attributes)
    lasting = {"long_name": "whether the run ended since bodies stayed in contact"}
    variables["event_lasting"] = ((), np.asarray(run.events.lasting), lasting)


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
    if run.t.ndim > 1:
        named["lane"] = (("lane",), np.arange(len(run.t)), {"long_name": "one run of a batch"})
    return named


def times_of(run: Trajectory) -> np.ndarray:
    """The output times, of all lanes; raises InputError where these differ."""
    times = np.asarray(run.t)
    if times.ndim == 1:
        return times
    # Of lanes that failed, a sweep hides all numbers.
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
