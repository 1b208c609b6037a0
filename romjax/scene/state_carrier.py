"""First-order states of effects, as coordinates of the system.

A state x' = f of an effect is the rate of a coordinate s of its own, s' = x, with a unit inertia
and the force f, so that its equation of motion is x' = f. Methods, events, outputs, derivatives and
batches take it as they take any coordinate; only energies leave it out, since its inertia is none.
Nothing depends on s itself, which begins at the value of the state. Configurations that runs and
equilibria return have the state in its place.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common.arrays import pick
from .coordinate import INTEGRAL, Coordinate
from .one_coordinate import AbstractOneCoordinate


class StateCarrier(AbstractOneCoordinate):
    """A body whose rate is a state of an effect, with the name "state of effect" and a `unit`.

    `begin`: the value of the state at the start.
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    dimension: int = eqx.field(static=True)  # type: ignore[misc]
    begin: Float[Array, ""]

    def weight(self) -> Float[Array, ""]:
        return jnp.ones_like(self.begin)

    def start(self) -> tuple[Float[Array, "1"], Float[Array, "1"]]:
        begin = pick(self.begin, None)
        return begin, begin

    def coordinates(self) -> tuple[Coordinate, ...]:
        state, _, owner = self.name.partition(" of ")
        about = f"state {state} of {owner}"
        return (Coordinate(owner, f"{INTEGRAL}{state}", self.unit, "", about),)
