"""The same reduction of a system with other numbers."""

from ..arrays import Vector
from ..basis.basis import Basis
from ..reduction.atlas import AtlasSystem
from ..reduction.base import AbstractReducedSystem
from ..reduction.minimal import MinimalSystem
from ..reduction.reduce import reduce
from ..system.base import AbstractSystem
from ..system.consistent import consistent
from .projected import ProjectedSystem


def vary(rom: AbstractReducedSystem, basis: Basis, system: AbstractSystem) -> AbstractReducedSystem:
    """`system` in the coordinates of `rom`: the same basis, and the same constraints or chart."""
    if isinstance(rom, MinimalSystem | AtlasSystem):
        return reduce(system, basis, "minimal", chart=rom.chart)
    if isinstance(rom, ProjectedSystem):
        return reduce(system, basis, "projected")
    return reduce(system, basis, "galerkin", constraints=rom.m)


def begin(rom: AbstractReducedSystem, q: Vector, v: Vector, t: Vector) -> tuple[Vector, Vector]:
    """The start of a reduced system nearest to physical coordinates, on its constraints."""
    return consistent(rom, *rom.reduced(q, v), t=t)
