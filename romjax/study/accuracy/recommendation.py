"""Recommendation of a model and a method for an error."""

import dataclasses
from typing import Any

import numpy as np

from ...common.arrays import Vector
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem
from .model import Model
from .row import Row


@dataclasses.dataclass(frozen=True)
class Recommendation:
    """The cheapest configuration with an `error`: `words`, and `settings` for `simulate`.

    `simulate(system, ts)` does it, of the system that was studied or one with other numbers.
    """

    error: float
    row: Row
    model: Model
    settings: dict[str, Any]
    words: str

    def simulate(self, system: AbstractSystem, ts: Vector, **more: Any) -> Trajectory:
        """A run of `system` as recommended; a reduced model's says in `warnings()` if it left what
        it was trained on.

        `ts`: output times [s]; `more`: arguments of `romjax.simulate`. Raises ReductionError where
        a reduced model cannot start as `system` does.
        """
        return simulate(self.model.of(system, np.asarray(ts)[0]), ts, **{**self.settings, **more})

    def __str__(self) -> str:
        return self.words
