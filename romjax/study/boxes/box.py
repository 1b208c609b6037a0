"""Parameters in ranges, and the mechanisms that they make."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from ...assembly.assemble import assemble
from ...common.errors import InputError
from ...scene.scene import Scene
from ...system.base import AbstractSystem


@dataclasses.dataclass(frozen=True)
class Range:
    """The values of a parameter from `low` to `high`; with `log` spread evenly in their logarithm.

    Raises InputError unless low < high, both finite, and positive with `log`.
    """

    low: float
    high: float
    log: bool = False

    def __post_init__(self) -> None:
        if not (np.isfinite(self.low) and np.isfinite(self.high) and self.low < self.high):
            raise InputError(f"Range: {self.low} to {self.high}; give two numbers that ascend.")
        if self.log and self.low <= 0:
            raise InputError(f"Range: low={self.low} has no logarithm; give positive numbers.")

    def at(self, share: np.ndarray | float) -> np.ndarray:
        """Return the value at a share of 0 to 1 of the range."""
        low, high = float(self.low), float(self.high)
        if self.log:
            return np.asarray(low * (high / low) ** np.asarray(share))
        return np.asarray(low + (high - low) * np.asarray(share))

    def moved(self, value: Any, share: Any) -> Any:
        """A value moved by a share of half of the range, both of which may be traced."""
        low, high = float(self.low), float(self.high)
        return value * (high / low) ** (share / 2) if self.log else value + (high - low) / 2 * share

    def share(self, value: Any, start: Any) -> Any:
        """Return the share with which `moved` gets from a start to a value."""
        low, high = float(self.low), float(self.high)
        if self.log:
            return 2 * jnp.log(value / start) / math.log(high / low)
        return 2 * (value - start) / (high - low)

    def holds(self, values: np.ndarray | float) -> np.ndarray:
        """Say of each value whether it lies within, both ends included."""
        return np.asarray((self.low <= np.asarray(values)) & (np.asarray(values) <= self.high))


class Box:
    """All mechanisms that a function makes of parameters in ranges.

    **Arguments:**

    - `make`: a function of the parameters, by name, that returns a `Scene`, of the same structure
      for all of them.
    - `ranges`: one argument for each parameter that varies, its `Range` or (low, high).

    ```python
    box = rj.Box(rj.gallery.cart_pendulum, force=(5, 15), f1=rj.Range(14, 18, log=True))
    ```

    Raises InputError without parameters or for a range that is none.
    """

    make: Callable[..., Scene]
    ranges: Mapping[str, Range]

    def __init__(self, make: Callable[..., Scene], **ranges: Range | tuple[float, ...]):
        if not ranges:
            raise InputError("Box: no parameter has a range; give some, such as mass=(1.0, 2.0).")
        for name, value in ranges.items():
            if not isinstance(value, Range) and len(value) != 2:
                raise InputError(f"Box: {name}={value}; give it as (low, high) or a romjax.Range.")
        self.make = make
        self.ranges = {
            name: value if isinstance(value, Range) else Range(value[0], value[1])
            for name, value in ranges.items()
        }

    def __repr__(self) -> str:
        ranges = (f"{name}: {x.low:g} to {x.high:g}" for name, x in self.ranges.items())
        return f"Box({', '.join(ranges)})"

    @property
    def center(self) -> dict[str, float]:
        """The parameters in the middle of their ranges."""
        return {name: float(values.at(0.5)) for name, values in self.ranges.items()}

    def sample(self, count: int, seed: int = 0) -> dict[str, np.ndarray]:
        """`count` points spread evenly over the box, each array (count,): Halton's sequence,
        scrambled by `seed` (Owen 2017, arXiv:1706.02808).
        """
        # Here, since scipy.stats takes longer to import than all of romjax.
        from scipy.stats import qmc

        shares = qmc.Halton(len(self.ranges), seed=seed).random(count).T
        pairs = zip(self.ranges.items(), shares, strict=True)
        return {name: values.at(share) for (name, values), share in pairs}

    def corners(self) -> dict[str, np.ndarray]:
        """All points at the ends of all ranges, each array (2 to the number of parameters,)."""
        ends = np.meshgrid(*([x.low, x.high] for x in self.ranges.values()), indexing="ij")
        return {name: np.ravel(x).astype(float) for name, x in zip(self.ranges, ends, strict=True)}

    def system(self, **parameters: float) -> AbstractSystem:
        """The mechanism of some parameters, assembled; those that are not given are in the middle.

        Raises InputError for one that the box does not have, or outside of its range.
        """
        self.check_names(parameters)
        for name, value in parameters.items():
            one = self.ranges[name]
            if not one.holds(value):
                raise InputError(
                    f"Box: {name}={value} lies outside of {one.low:g} to {one.high:g}; make a "
                    "larger box."
                )
        return self.system_anywhere(parameters)

    def system_anywhere(self, parameters: Mapping[str, Any]) -> AbstractSystem:
        """The mechanism of some parameters, which may be traced or outside of their ranges."""
        return assemble(self.make(**(self.center | dict(parameters))))

    def check_names(self, parameters: Mapping[str, Any]) -> None:
        """Raise InputError for a parameter that the box does not have."""
        for name in parameters:
            if name not in self.ranges:
                known = ", ".join(self.ranges)
                raise InputError(f"Box: there is no parameter {name!r}; those are {known}.")
