"""The base of formulations: ways from a system and a basis to a reduced system."""

import abc
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...basis.basis import AbstractDecomposition, Basis
from ...basis.snapshots import Motions
from ...basis.turns import by_turns
from ...common.arrays import pick
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem


class AbstractFormulation(eqx.Module):
    """A way to reduce a system; one of one's own is a subclass with a `name` and `reduce`."""

    name: ClassVar[str]
    in_subspace: ClassVar[bool] = True  # whether q stays in the affine subspace of the basis
    # What a basis may miss of its snapshots, over the error asked for; inf where that says nothing.
    most_missed: ClassVar[float] = float("inf")
    # Whether it takes mechanisms of many kinds, so that refusals of others name it.
    is_general: ClassVar[bool] = False
    # Whether its models err on other motions as on their training, which then confines none.
    is_predictive: ClassVar[bool] = False
    keeps_states: ClassVar[bool] = False  # first-order ones, of effects
    # Whether it is there to be compared with, not to be used.
    for_reference: ClassVar[bool] = False

    def basis(
        self, system: AbstractSystem, motion: Motions, decomposition: AbstractDecomposition
    ) -> Basis:
        """The basis for this formulation from motions of `system`, by a decomposition such as
        `POD(rank=5)`: that of the snapshots as they are, unless the formulation maps them first.
        """
        del system
        return decomposition(motion)

    @abc.abstractmethod
    def reduce(self, system: AbstractSystem, basis: Basis) -> AbstractReducedSystem:
        """`system` in the coordinates that the formulation makes of a basis of its coordinates.

        Raises ReductionError if the basis does not make such a model.
        """


def start(
    system: AbstractSystem, basis: Basis
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, ""]]:
    """q, v (n,) and t of the start of a reduced model: that of the snapshots, or of the system
    where the modes are given.
    """
    snapshots = basis.snapshots
    if basis.decomposition is None:
        return system.q0, system.v0, pick(snapshots.t, 0)
    q, v = snapshots.q, snapshots.v
    if snapshots.turns is not None:
        q, v = by_turns(snapshots.turns.of_unit_length, q, v)
    return pick(q, 0), pick(v, 0), pick(snapshots.t, 0)
