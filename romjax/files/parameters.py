"""The `[parameters]` of a file: their values, which others may stand for."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..common.arrays import concrete
from .numbers import PARAMETER
from .problems import Problems, unknown

# A message names so many parameters at most.
_SHOWN = 8


def is_reference(value: Any) -> bool:
    """Whether a value is "=name"."""
    return isinstance(value, str) and value.startswith(PARAMETER)


def free_parameters(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that have numbers, as floats or arrays; the others refer to these."""
    return {
        name: np.array(value, float) if isinstance(value, list) else float(value)
        for name, value in table.items()
        if not is_reference(value)
    }


def resolve_parameters(
    table: Mapping[str, Any], given: Mapping[str, Any], problems: Problems
) -> dict[str, Any]:
    """The values of all parameters, where those that are `given` take the place of their own."""
    values: dict[str, Any] = {}
    failed: set[str] = set()
    for name in table:
        way: dict[str, None] = {}  # in order, and quick to look up
        at = name
        while at not in values and at not in failed and is_reference(table[at]):
            way[at] = None
            following = table[at][len(PARAMETER) :]
            if following in way:
                names = list(way)
                circle = [*names[names.index(following) :], following]
                shown = circle if len(circle) <= _SHOWN else [*circle[:_SHOWN], "…"]
                words = f"Parameters stand for each other: {' = '.join(shown)}; give a number."
                problems.add(("parameters", name), words)
                failed.add(at)
            elif following not in table:
                problems.add(("parameters", at), no_parameter(following, table))
                failed.add(at)
            else:
                at = following
        if at in failed:
            failed.update(way)
        else:
            values |= dict.fromkeys([*way, at], values.get(at, given.get(at)))
    return values


def no_parameter(name: str, known: Mapping[str, Any]) -> str:
    """Return the message that there is no parameter of this name, which may be a formula."""
    formula = " There are no formulas: = takes the name of one." if set(name) & set("+-*/(") else ""
    return unknown("parameter", name, list(known)) + formula


def check_given(owner: str, given: Mapping[str, Any], free: Mapping[str, Any]) -> str:
    """Say in words what is wrong with the parameters that a caller gives."""
    for name, value in given.items():
        if name not in free:
            return f"{owner}: {unknown('parameter', name, list(free))}"
        shape = np.shape(value)
        if shape != np.shape(free[name]):
            return f"{owner}: {name} has shape {shape}, but it must have {np.shape(free[name])}."
        number = concrete(value)
        if number is not None and not np.all(np.isfinite(number)):
            return f"{owner}: {name} is {number}; every number must be finite."
    return ""
