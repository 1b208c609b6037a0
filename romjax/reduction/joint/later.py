"""What a state in joint coordinates needs of its system, and makes only where it is asked for."""

from typing import Protocol, runtime_checkable

import equinox as eqx
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...common.arrays import Time
from ...system.reduced import Reduced
from ...system.state import AbstractState
from ...system.structure import Structure
from .along import AlongJoints
from .cuts import Cut
from .lift import TreeLift
from .tree import Tree


@runtime_checkable
class TreeSystem(Protocol):
    """The methods of a `JointSystem` that its states call."""

    @property
    def full(self) -> AssembledSystem: ...
    @property
    def tree(self) -> Tree: ...
    @property
    def lift(self) -> TreeLift: ...
    @property
    def cut(self) -> Cut: ...
    @property
    def along(self) -> AlongJoints: ...
    @property
    def structure(self) -> Structure: ...
    @property
    def n(self) -> int: ...
    @property
    def m(self) -> int: ...
    def state(self, t: Time, q: Reduced, v: Reduced) -> AbstractState: ...


class Later(eqx.Module):
    """The extended mass matrix of a state, made where more right-hand sides are solved with it."""

    system: TreeSystem
    t: Float[Array, ""]
    z: Reduced
    w: Reduced

    def solve(
        self, force: Float[Array, "r *k"], gamma: Float[Array, "m *k"]
    ) -> tuple[Float[Array, "r *k"], Float[Array, "m *k"]]:
        """Return what `KKT.solve` does."""
        return self.system.state(self.t, self.z, self.w).kkt().solve(force, gamma)
