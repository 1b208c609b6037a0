"""A model that is simulated in a study: the full system, or a capped or a reduced one."""

import dataclasses
import functools
from typing import Any

from ...assembly.assemble import assemble
from ...assembly.capping import following
from ...assembly.disassemble import disassemble
from ...assembly.locate import assembled
from ...basis.basis import Basis
from ...reduction.formulation.base import AbstractFormulation
from ...scene.body.capped import with_caps
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem
from .row import FULL

CAPPED = "capped"


@dataclasses.dataclass(frozen=True)
class Reduction:
    """A reduced system and what it was made of."""

    rom: AbstractReducedSystem
    basis: Basis
    formulation: AbstractFormulation
    offline: float  # [s] to simulate the training run, decompose it and reduce

    @property
    def name(self) -> str:
        """The name of the reduction in tables, such as "POD minimal, r = 3"."""
        return f"{self.basis.name} {self.formulation.name}, r = {self.rom.n}"


@dataclasses.dataclass(frozen=True)
class Model:
    """The full system, with a `reduction` the reduced, and with a `cap` [Hz] the capped one."""

    full: AbstractSystem
    reduction: Reduction | None = None
    cap: float | None = None

    @property
    def name(self) -> str:
        """The name of the model in tables: "full", "capped, 40 Hz", or that of the reduction."""
        if self.cap is not None:
            return f"{CAPPED}, {self.cap:.3g} Hz"
        return FULL if self.reduction is None else self.reduction.name

    @functools.cached_property
    def system(self) -> AbstractSystem:
        """The system that is simulated."""
        if self.cap is not None:
            return capped(self.full, self.cap)
        return self.full if self.reduction is None else self.reduction.rom

    @property
    def formulation(self) -> str:
        """The name of its formulation, for tables; "full" or "capped" where nothing is reduced."""
        if self.cap is not None:
            return CAPPED
        return FULL if self.reduction is None else self.reduction.formulation.name

    @property
    def rank(self) -> int:
        """Its number of coordinates."""
        return self.system.n

    @property
    def offline(self) -> float:
        """The time to make the model [s]."""
        return 0.0 if self.reduction is None else self.reduction.offline

    def of(self, system: AbstractSystem, t: Any) -> AbstractSystem:
        """The same model of a `system` with other numbers, with the start of that at time `t` [s].

        Raises ReductionError where the reduced one cannot start there.
        """
        if self.cap is not None:
            return capped(system, self.cap)
        if self.reduction is None:
            return system
        rom = self.reduction.rom.with_full(system)
        return rom.starting_at(system.q0, system.v0, t)


def capped(system: AbstractSystem, hertz: float) -> AbstractSystem:
    """The system, from the same start, with no mode of a body above `hertz`; see `romjax.cap`.

    Raises InputError for a system without bodies, or without modes.
    """
    slow = assemble(with_caps(disassemble(assembled("cap", system)), hertz))
    return following(dataclasses.replace(slow, q0=system.q0, v0=system.v0))
