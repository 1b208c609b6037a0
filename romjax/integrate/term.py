"""The equation of motion as a diffrax term that knows its second-order structure."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import Time
from ..system.base import AbstractSystem
from ..system.dynamics import Linearization, linearize
from ..system.stabilization import Baumgarte

State = tuple[Float[Array, " n"], Float[Array, " n"]]


@eqx.filter_jit
def acceleration(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None,
) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
    """`system.acceleration`, jitted so that a program that asks for it often traces it once."""
    return system.acceleration(t, q, v, stabilization)


def unwrap(terms: Any) -> tuple[Any, Any]:
    """The term itself and the direction of time, which diffrax wraps around it."""
    return getattr(terms, "term", terms), getattr(terms, "direction", 1)


class MotionTerm(diffrax.AbstractTerm):
    """(q, v)' = (v, a(t, q, v)) (chapter equation 39.4)."""

    system: AbstractSystem
    stabilization: Baumgarte | None

    def vf(self, t: Any, y: State, args: Any) -> State:
        del args
        q, v = y
        t = jnp.asarray(t, q.dtype)
        return v, acceleration(self.system, t, q, v, self.stabilization)[0]

    def contr(self, t0: Any, t1: Any, **kwargs: Any) -> Any:
        return t1 - t0

    def prod(self, vf: State, control: Any) -> State:
        return jax.tree.map(lambda f: control * f, vf)

    def linearize(self, t: Any, y: State) -> Linearization:
        """The acceleration and its derivatives at one state."""
        q, v = y
        return linearize(self.system, jnp.asarray(t, q.dtype), q, v, self.stabilization)
