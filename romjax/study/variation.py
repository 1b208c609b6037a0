"""What the studies ask of reduced models: to be made, of other numbers, and from another start."""

from typing import NamedTuple

import equinox as eqx

from ..arrays import Vector
from ..basis.basis import Basis
from ..errors import InputError, ReductionError
from ..reduction.atlas import AtlasSystem
from ..reduction.base import AbstractReducedSystem
from ..reduction.minimal import MinimalSystem
from ..reduction.reduce import reduce
from ..system.base import AbstractSystem
from ..system.consistent import consistent
from .projected import ProjectedSystem


class Formulation(NamedTuple):
    """A formulation of reduced equations.

    `in_subspace`: whether q stays in the affine subspace of the basis; else it depends on minimal
    coordinates, of which there are no more than degrees of freedom. `for_reference`: whether it is
    there to be compared with, not to be used.
    """

    name: str
    in_subspace: bool = True
    for_reference: bool = False


_FORMULATIONS = (
    Formulation("galerkin"),
    Formulation("minimal", in_subspace=False),
    Formulation("projected", for_reference=True),
)


def as_formulation(formulation: Formulation | str) -> Formulation:
    """The formulation of that name; an object is returned as it is.

    Raises ReductionError for an unknown name.
    """
    if isinstance(formulation, Formulation):
        return formulation
    named = {one.name: one for one in _FORMULATIONS}
    if formulation not in named:
        raise ReductionError(
            f"reduce: formulation={formulation!r}; it must be one of {', '.join(named)}."
        )
    return named[formulation]


def reduced(
    system: AbstractSystem, basis: Basis, formulation: Formulation
) -> AbstractReducedSystem:
    """`system` in the coordinates of `basis`. Raises ReductionError as `romjax.reduce`."""
    return reduce(system, basis, formulation.name)


def with_full(
    rom: AbstractReducedSystem, basis: Basis, system: AbstractSystem
) -> AbstractReducedSystem:
    """The same reduction of a `system` with other numbers: same basis and constraints or chart."""
    if isinstance(rom, MinimalSystem | AtlasSystem):
        return reduce(system, basis, "minimal", chart=rom.chart)
    if isinstance(rom, ProjectedSystem):
        return reduce(system, basis, "projected")
    return reduce(system, basis, "galerkin", constraints=rom.m)


def starting_at(
    rom: AbstractReducedSystem, q: Vector, v: Vector, t: Vector
) -> AbstractReducedSystem:
    """The reduced system with the start nearest to physical `q`, `v` (n,), on its constraints.

    Raises ReductionError if its constraints cannot be satisfied there.
    """
    nearest = rom.reduced(q, v)
    try:
        start = consistent(rom, *nearest, t=t)
    except InputError as error:
        raise ReductionError(f"The reduced model has no start there. {error}") from error
    return eqx.tree_at(lambda r: (r.q0, r.v0), rom, start)
