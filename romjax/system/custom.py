"""Systems that users write themselves."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import Time, as_array
from ..checks import check_finite, check_shape
from ..linalg.pattern import Pattern
from .base import AbstractSystem
from .mobility import check_mobility
from .state import FullState
from .structure import Structure

Function = Callable[..., Float[Array, "..."]]


class CustomSystem(AbstractSystem):
    """A system from pure JAX functions in any coordinates.

    **Arguments:**

    - `mass(q) -> (n, n)`: mass matrix, symmetric positive definite.
    - `force(t, q, v) -> (n,)`: the whole of Q, quadratic-velocity forces included
      (`quadratic_velocity_force(mass)` derives them).
    - `constraint(t, q) -> (m,)`: holonomic constraints, zero where they hold; None means none.
    - `q0`, `v0`: the start, (n,).

    The functions may be equinox modules; their arrays are then parameters like any other, and
    changing them recompiles nothing. Raises ValueError where a function returns the wrong shape.
    """

    mass_: Function
    force_: Function
    constraint_: Function | None
    q0: Float[Array, " n"]
    v0: Float[Array, " n"]
    structure: Structure = eqx.field(static=True)

    def __init__(
        self,
        mass: Function,
        force: Function,
        constraint: Function | None = None,
        *,
        q0: Any,
        v0: Any,
    ):
        self.q0, self.v0 = as_array(q0), as_array(v0)
        # As pytrees, so that arrays inside modules are traced, not baked in.
        self.mass_, self.force_, self.constraint_ = mass, force, constraint
        m = 0 if constraint is None else _length(constraint, self.q0)
        self.structure = Structure.unnamed(self.q0.size, m)

    def __check_init__(self) -> None:
        owner = "CustomSystem"
        check_shape(owner, "q0", self.q0, (None,))
        check_shape(owner, "v0", self.v0, self.q0.shape)
        check_finite(owner, "q0", self.q0)
        check_finite(owner, "v0", self.v0)
        n, t = self.n, jnp.zeros((), self.q0.dtype)
        for name, function, arguments, shape in (
            ("mass(q)", self.mass_, (self.q0,), (n, n)),
            ("force(t, q, v)", self.force_, (t, self.q0, self.v0), (n,)),
        ):
            check_shape(owner, name, jax.eval_shape(function, *arguments), shape)
        check_mobility(owner, self)

    @property
    def full(self) -> AbstractSystem:
        return self

    @property
    def validity(self) -> None:
        return None

    def mass(self, q: Float[Array, " n"]) -> Float[Array, "n n"]:
        return self.mass_(q)

    def force(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
        return self.force_(t, q, v)

    def constraint(self, t: Time, q: Float[Array, " n"]) -> Float[Array, " m"]:
        return jnp.zeros(0, q.dtype) if self.constraint_ is None else self.constraint_(t, q)

    def state(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> FullState:
        def jacobian() -> Array:
            rows: Array = jax.jacfwd(self.constraint, argnums=1)(jnp.asarray(t, q.dtype), q)
            return rows[None][: min(self.m, 1)]

        return FullState(
            q,
            v,
            Pattern.dense(self.n, self.m),
            lambda: self.mass(q)[None],
            jacobian,
            lambda: self.force(t, q, v),
        )


def _length(constraint: Function, q: Float[Array, " n"]) -> int:
    found = jax.eval_shape(constraint, jnp.zeros((), q.dtype), q)
    check_shape("CustomSystem", "constraint(t, q)", found, (None,))
    length: int = found.shape[0]
    return length
