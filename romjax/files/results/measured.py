"""Quantities that were measured along a run, as arrays with names and units."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ...common.errors import InputError

# What results are called where they are measured, and their units.
UNITS = {
    "position": "m",
    "velocity": "m/s",
    "acceleration": "m/s^2",
    "angle": "rad",
    "rotation": "",
    "angular_velocity": "rad/s",
    "angular_acceleration": "rad/s^2",
    "distance": "m",
    "distance_rate": "m/s",
    "force": "N",
    "torque": "N m",
    "power": "W",
    "axial": "N",
    "shear": "N",
    "moment": "N m",
    "kinetic": "J",
    "elastic": "J",
    "potential": "J",
    "total": "J",
    "balance": "J",
}
# Quantities that are vectors by the inertial axes, in the plane and in space or in space alone.
VECTORS = {"position", "velocity", "acceleration", "force"}
TURNING = {"angular_velocity", "angular_acceleration", "torque"}


class Measured(NamedTuple):
    """One variable of a dataset: its name, the axes after that of the outputs, values and unit."""

    name: str
    axes: tuple[str, ...]
    values: np.ndarray
    unit: str


def measured(name: str, value: Any, count: int) -> Iterator[Measured]:
    """The variables that a result of `measure`, `energy`, … along `count` outputs consists of.

    `value` may also be a mapping of such, an array, or a pair of an array and its unit. Raises
    InputError for an array that has not one row for each output.
    """
    unit = None
    if isinstance(value, tuple) and len(value) == 2 and isinstance(value[1], str):
        value, unit = value
    if hasattr(value, "items"):
        for key, part in value.items():
            yield from measured(f"{name}.{key}", part, count)
        return
    # `hasattr` would evaluate the property.
    known = set(dir(type(value))) | set(getattr(value, "__dataclass_fields__", ()))
    parts = [part for part in UNITS if part in known]
    if "rotation" in parts:  # a point in space has no angle, and in the plane the angle says it
        parts.remove("angle" if np.shape(value.position)[-1] == 3 else "rotation")
    if parts:
        for part in parts:
            yield from measured(f"{name}.{part}", getattr(value, part), count)
        return
    values, kind = np.asarray(value), name.rpartition(".")[2]
    if values.dtype.kind not in "biuf" or values.shape[:1] != (count,):
        raise InputError(
            f"Trajectory.to_xarray: {name} is an array of shape {values.shape} and type "
            f"{values.dtype}; give real numbers with one row for each of the {count} outputs."
        )
    axes = tuple(f"{name}_{axis}" for axis in range(1, values.ndim))
    size = values.shape[1:]
    if (kind in VECTORS and size in ((2,), (3,))) or (kind in TURNING and size == (3,)):
        axes = ("axis",)
    yield Measured(name, axes, values, UNITS.get(kind, "") if unit is None else unit)
