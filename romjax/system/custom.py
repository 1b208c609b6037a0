"""Systems that users write themselves."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common import compat
from ..common.arrays import Time, as_array
from ..common.checks import check_finite, check_shape
from ..common.errors import InputError
from ..linalg.pattern import Pattern
from .base import AbstractSystem
from .mobility import check_mobility
from .standing import AbstractConstrained
from .state import FullState, Power
from .structure import Structure

Function = Callable[..., Float[Array, "..."]]


class CustomSystem(AbstractSystem, AbstractConstrained):
    """A system from pure JAX functions in any coordinates.

    **Arguments:**

    - `mass(q) -> (n, n)`: mass matrix, symmetric positive definite.
    - `force(t, q, v) -> (n,)`: the whole of Q, quadratic-velocity forces included
      (`quadratic_velocity_force(mass)` derives them).
    - `constraint(t, q) -> (m,)`: holonomic constraints, zero where they hold; None means none.
    - `q0`, `v0`: the start, (n,).
    - `energy(t, q)`: the potential energy [J] of all forces that have one, and
      `power(t, q, v)`: the power [W] of all others; none unless given. A run whose energy does not
      balance with them is doubted. Without `energy`, the work of the whole `force` is taken as it
      is, and only errors of the integration are seen.

    The functions may be equinox modules; their arrays are then parameters like any other, and
    changing them recompiles nothing. Raises ValueError where a function returns the wrong shape.
    """

    mass_: Function
    force_: Function
    constraint_: Function | None
    energy_: Function | None
    power_: Function | None
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
        energy: Function | None = None,
        power: Function | None = None,
    ):
        self.q0, self.v0 = as_array(q0), as_array(v0)
        # They are pytrees, so that arrays inside modules are traced, not baked in.
        self.mass_, self.force_, self.constraint_ = mass, force, constraint
        self.energy_, self.power_ = energy, power
        m = 0 if constraint is None else _length(constraint, self.q0)
        self.structure = Structure.unnamed(self.q0.size, m)

    def __check_init__(self) -> None:
        owner = "CustomSystem"
        check_shape(owner, "q0", self.q0, (None,))
        check_shape(owner, "v0", self.v0, self.q0.shape)
        check_finite(owner, "q0", self.q0)
        check_finite(owner, "v0", self.v0)
        n, t = self.n, jnp.zeros((), self.q0.dtype)
        if self.power_ is not None and self.energy_ is None:
            raise InputError(
                f"{owner}: power is given without energy; give the potential energy of the other "
                "forces too, zero if they have none."
            )
        for name, function, arguments, shape in (
            ("mass(q)", self.mass_, (self.q0,), (n, n)),
            ("force(t, q, v)", self.force_, (t, self.q0, self.v0), (n,)),
            ("energy(t, q)", self.energy_, (t, self.q0), ()),
            ("power(t, q, v)", self.power_, (t, self.q0, self.v0), ()),
        ):
            if function is None:
                continue
            check_shape(owner, name, jax.eval_shape(function, *arguments), shape)
        check_mobility(owner, self)

    @property
    def full(self) -> AbstractSystem:
        return self

    @property
    def validity(self) -> None:
        return None

    def standing_at(self, t: Time) -> "CustomSystem":
        if self.constraint_ is None:
            return self
        held: CustomSystem
        held = eqx.tree_at(lambda x: x.constraint_, self, _Held(self.constraint_, t))
        return held

    def mass(self, q: Float[Array, " n"]) -> Float[Array, "n n"]:
        return self.mass_(q)

    def force(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
        return self.force_(t, q, v)

    def constraint(self, t: Time, q: Float[Array, " n"]) -> Float[Array, " m"]:
        return jnp.zeros(0, q.dtype) if self.constraint_ is None else self.constraint_(t, q)

    def state(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> FullState:
        def jacobian() -> Array:
            # One side, or none where there are no constraints, as the dense pattern has it.
            rows: Array = jax.jacfwd(self.constraint, argnums=1)(jnp.asarray(t, q.dtype), q)
            return rows[None][: min(self.m, 1)]

        return FullState(
            q,
            v,
            Pattern.dense(self.n, self.m),
            lambda: self.mass(q)[None],
            jacobian,
            lambda: self.force(t, q, v),
            lambda q: (jnp.zeros((), q.dtype), self._energy(t, q)),
            lambda: self._power(t, q, v),
        )

    def _energy(self, t: Time, q: Float[Array, " n"]) -> Float[Array, ""]:
        return jnp.zeros((), q.dtype) if self.energy_ is None else self.energy_(t, q)

    def _power(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> Power | None:
        zero, one = jnp.zeros((), q.dtype), jnp.ones((), q.dtype)
        if self.energy_ is None:
            # With M a = Q, the rate of ½ vᵀ M v is vᵀ Q + ½ vᵀ Ṁ v.
            change: Array = jax.jvp(self.mass, (q,), (v,))[1]
            return Power(zero, v @ self.force(t, q, v) + 0.5 * v @ change @ v)
        time = jnp.asarray(t, q.dtype)
        if self.power_ is not None:
            work = self.power_(time, q, v)
        elif compat.depends_on_first(self.energy_, time, q):
            work = zero
        else:
            return None
        by_time: Array = jax.jvp(lambda t: self._energy(t, q), (time,), (one,))[1]
        return Power(zero, work + by_time)


class _Held(eqx.Module):
    """Constraints as they are at one time."""

    constraint: Function
    at: Time

    def __call__(self, t: Time, q: Float[Array, " n"]) -> Float[Array, " m"]:
        held: Float[Array, " m"] = self.constraint(self.at, q)
        return held


def _length(constraint: Function, q: Float[Array, " n"]) -> int:
    residual = jax.eval_shape(constraint, jnp.zeros((), q.dtype), q)
    check_shape("CustomSystem", "constraint(t, q)", residual, (None,))
    length: int = residual.shape[0]
    return length
