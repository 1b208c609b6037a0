"""The `[parameters]` of a file: their values, which others may stand for."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import concrete
from .numbers import PARAMETER
from .problems import Problems, unknown


def is_reference(value: Any) -> bool:
    """Whether a value is "=name"."""
    return isinstance(value, str) and value.startswith(PARAMETER)


def free_parameters(table: Mapping[str, Any]) -> dict[str, Any]:
    """Those with numbers of their own, as floats or arrays; the others stand for these."""
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
    for name in table:
        way = [name]
        while is_reference(table[way[-1]]):
            following = table[way[-1]][len(PARAMETER) :]
            if following not in table:
                known = list(table)
                problems.add(("parameters", way[-1]), unknown("parameter", following, known))
                break
            if following in way:
                circle = " = ".join([*way[way.index(following) :], following])
                words = f"Parameters stand for each other: {circle}; give one of them a number."
                problems.add(("parameters", name), words)
                break
            way.append(following)
        else:
            values[name] = given[way[-1]]
    return values


def check_given(owner: str, given: Mapping[str, Any], free: Mapping[str, Any]) -> str:
    """What is wrong with parameters that a caller gives, in words."""
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
