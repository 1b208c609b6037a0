"""A model that is simulated in a study: the full system, or a reduced one."""

import dataclasses
from typing import Any

from ...basis.basis import Basis
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.system import ReducedSystem
from ...system.base import AbstractSystem
from ..projected import ProjectedSystem
from .row import FULL


@dataclasses.dataclass(frozen=True)
class Reduction:
    """A reduced system and what it was made of."""

    rom: ReducedSystem | ProjectedSystem
    basis: Basis
    formulation: AbstractFormulation
    offline: float  # [s] to simulate the training run, decompose it and reduce

    @property
    def name(self) -> str:
        """Such as "POD minimal, r = 3"."""
        return f"{self.basis.name} {self.formulation.name}, r = {self.rom.n}"


@dataclasses.dataclass(frozen=True)
class Model:
    """The full system, or with a `reduction` the reduced one."""

    full: AbstractSystem
    reduction: Reduction | None = None

    @property
    def name(self) -> str:
        """What it is called in tables: "full", or the name of the reduction."""
        return FULL if self.reduction is None else self.reduction.name

    @property
    def system(self) -> AbstractSystem:
        """What is simulated."""
        return self.full if self.reduction is None else self.reduction.rom

    @property
    def formulation(self) -> str:
        """The name of its formulation, for tables; "full" where nothing is reduced."""
        return FULL if self.reduction is None else self.reduction.formulation.name

    @property
    def rank(self) -> int:
        """Its number of coordinates."""
        return self.system.n

    @property
    def offline(self) -> float:
        """How long it took to make [s]."""
        return 0.0 if self.reduction is None else self.reduction.offline

    def of(self, system: AbstractSystem, t: Any) -> AbstractSystem:
        """The same model of a `system` with other numbers, with the start of that at time `t` [s].

        Raises ReductionError where the reduced one cannot start there.
        """
        if self.reduction is None:
            return system
        rom = self.reduction.rom.with_full(system)
        return rom.starting_at(system.q0, system.v0, t)
