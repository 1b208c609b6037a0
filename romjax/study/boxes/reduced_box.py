"""A reduced model that holds in a box of parameters."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem
from .box import Box

if TYPE_CHECKING:
    # It makes these models, so its module imports this one.
    from .greedy import Greedy

# A model of a box is validated with this confidence.
_CONFIDENCE = 0.95


@dataclasses.dataclass(frozen=True)
class ReducedBox:
    """A reduced model of all mechanisms of a `box`.

    - `rom`: the model, of the mechanism in the middle; `finer`: that of the next rank, whose
      difference estimates the error, or None if there is none. `tol`: the error asked for.
    - `training`: the parameters of its training runs, each array (runs,).
    - `candidates`: the parameters at which its error was estimated, and `estimates` (candidates,).
    - `held_out`: those at which it was measured, by full runs that it was not made of, and
      `errors` (held out,).
    - `greedy`: the training runs themselves, to go on from.
    """

    box: Box
    rom: AbstractReducedSystem
    finer: AbstractReducedSystem | None
    tol: float
    training: dict[str, np.ndarray]
    candidates: dict[str, np.ndarray]
    estimates: np.ndarray
    held_out: dict[str, np.ndarray]
    errors: np.ndarray
    greedy: "Greedy" = dataclasses.field(repr=False)

    @property
    def error(self) -> float:
        """The largest error that was estimated or measured."""
        return float(np.max([*self.estimates, *self.errors]))

    @property
    def share(self) -> float:
        """The share of the box in which errors are no larger than the largest measured one, with a
        confidence of 95 %: with n runs, 0.05^(1/n) (Wilks 1941, doi:10.1214/aoms/1177731788).
        """
        count = len(self.errors)
        return float((1 - _CONFIDENCE) ** (1 / count)) if count else 0.0

    def at(self, **parameters: float) -> AbstractReducedSystem:
        """The reduced model of the mechanism of some parameters, from its own start; those that are
        not given are in the middle.

        Raises InputError outside of the box.
        """
        return reduced_as(self.rom, self.box.system(**parameters))

    def trained_at(self, **parameters: float) -> "ReducedBox":
        """The model with the full run of some parameters in its training too; it is estimated and
        measured anew. Those that are not given are in the middle.

        Raises InputError outside of the box, ReductionError if no rank reaches `tol` then.
        """
        return self.greedy.with_run(self.tol, self.box.center | parameters)

    def summary(self) -> str:
        """Say in words of how many runs the model was made, and how well it does."""
        count = len(next(iter(self.training.values())))
        words = f"{self.rom.summary}; {count} training run{'s' * (count > 1)}"
        words += f"; at most {np.max(self.estimates):.1e} estimated at {len(self.estimates)} points"
        if len(self.errors):
            words += f", {np.max(self.errors):.1e} measured at {len(self.errors)} that no snapshot "
            words += f"is from: {self.share:.0%} of the box with a confidence of {_CONFIDENCE:.0%}"
        return words


def reduced_as(rom: AbstractReducedSystem, system: AbstractSystem) -> AbstractReducedSystem:
    """A reduced model for a system with other numbers, from its own start."""
    return rom.with_full(system).starting_at(system.q0, system.v0)
