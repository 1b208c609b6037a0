"""The system: how a mechanism moves. Full, user-made and reduced ones are all of this kind."""

import abc
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..arrays import Time
from ..linalg.kkt import Saddle
from ..linalg.pattern import Topology
from .stabilization import Baumgarte


class ConstraintState(NamedTuple):
    """The constraints and their rates along a motion."""

    violation: Float[Array, " m"]  # C
    rate: Float[Array, " m"]  # Ċ = C_q v + C_t
    curvature: Float[Array, " m"]  # C̈ = C_q a + (C_q v)_q v + 2 C_qt v + C_tt


class Linearization(NamedTuple):
    """The acceleration and its derivatives at one state."""

    acceleration: Float[Array, " n"]
    by_position: Float[Array, "n n"]  # ∂a/∂q
    by_velocity: Float[Array, "n n"]  # ∂a/∂v
    by_time: Float[Array, " n"]  # ∂a/∂t


class Frequencies(NamedTuple):
    """How fast a system is at one state [rad/s]."""

    rigid: Float[Array, ""]  # fastest rigid-body frequency
    fastest: Float[Array, ""]  # fastest frequency or rate of decay of all


class AbstractSystem(eqx.Module):
    """M(q) q̈ + C_qᵀ λ = Q(t, q, q̇), C(t, q) = 0 (chapter equation 39.1, with the sign of 39.2).

    A kind of system says `mass`, `force` and `constraint`; the rest follows, by autodiff.
    """

    q0: eqx.AbstractVar[Float[Array, " n"]]
    v0: eqx.AbstractVar[Float[Array, " n"]]

    def __hash__(self) -> int:
        # By identity, so that `jax.jit(system.force)` works; equinox would hash the arrays.
        return id(self)

    @property
    def n(self) -> int:
        """Number of generalized coordinates."""
        return self.q0.shape[0]

    @property
    @abc.abstractmethod
    def m(self) -> int:
        """Number of constraints."""

    @abc.abstractmethod
    def mass(self, q: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Mass matrix M, symmetric positive definite."""

    @abc.abstractmethod
    def force(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
        """Generalized force Q: applied, elastic, dissipative and quadratic-velocity forces."""

    @abc.abstractmethod
    def constraint(self, t: Time, q: Float[Array, " n"]) -> Float[Array, " m"]:
        """Constraints C; length zero if there are none."""

    # What a kind of system may know better.

    def coordinate_labels(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(f"q{i + 1}" for i in range(self.n))

    def constraint_label(self, row: int) -> str:
        """What messages call a constraint."""
        return f"constraint {row + 1}"

    def rigid(self) -> Bool[Array, " n"]:
        """Which coordinates are rigid-body ones; all, where nothing is known of them."""
        return jnp.ones(self.n, bool)

    @property
    def flexible(self) -> bool:
        """Whether it has parts that may be much faster than its motion; true if unknown."""
        return True

    def physical(
        self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " N"], Float[Array, " N"]]:
        """The physical coordinates and velocities that a state stands for."""
        return q, v

    def physical_metric(self) -> Float[Array, "N N"]:
        """Mass matrix of the physical coordinates at the start: the metric of errors and bases."""
        return self.mass(self.q0)

    def physical_constraint(self, t: Time, q: Float[Array, " N"]) -> Float[Array, " M"]:
        """The constraints of the mechanism at physical coordinates, all of them."""
        return self.constraint(t, q)

    def judge(
        self,
        ts: Float[Array, " k"],
        q: Float[Array, "k n"],
        v: Float[Array, "k n"],
        violation: Float[Array, " k"],
    ) -> Int[Array, ""]:
        """What speaks against a motion with this `violation`, as the number of a `Flag`."""
        return jnp.zeros((), int)

    holds: ClassVar[bool] = True  # whether Baumgarte's term can hold the constraints

    settles: ClassVar[bool] = False  # whether `settle` does anything

    def settle(
        self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """The same state in the coordinates that suit it best; asked for after each step."""
        return q, v

    def momentum(self, q: Float[Array, " n"], v: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        """M v, for one or several v."""
        return self.mass(q) @ v

    def jacobian(self, t: Time, q: Float[Array, " n"]) -> Float[Array, "m n"]:
        """Constraint Jacobian C_q."""
        return jax.jacfwd(self.constraint, argnums=1)(t, q)

    # What follows.

    def constraint_state(
        self,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        a: Float[Array, " n"] | None = None,
    ) -> ConstraintState:
        """C, Ċ and C̈ (without an acceleration `a`, C̈ without its part C_q a).

        By two nested derivatives along the motion, time included. A constraint that ignores t
        leaves no trace of it: its tangent is symbolically zero.
        """
        t = jnp.asarray(t, q.dtype)
        one = jnp.ones_like(t)

        def rate(t, q, v):  # type: ignore[no-untyped-def]
            return jax.jvp(self.constraint, (t, q), (one, v))

        if a is None:
            turn = jax.jvp(lambda t, q: rate(t, q, v), (t, q), (one, v))
        else:
            turn = jax.jvp(rate, (t, q, v), (one, v, a))
        (violation, first), (_, curvature) = turn
        return ConstraintState(violation, first, curvature)

    def saddle(self, t: Time, q: Float[Array, " n"]) -> Saddle:
        """The extended mass matrix at one configuration, factored."""
        topology = Topology.dense(self.n, self.m)
        return Saddle(topology, self.mass(q)[None], self.jacobian(t, q)[None][: min(self.m, 1)])

    def acceleration(
        self,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        stabilization: Baumgarte | None = None,
    ) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
        """Accelerations and Lagrange multipliers (chapter equation 39.3).

        C_q q̈ = γ with γ = −(C_q q̇)_q q̇ − 2 C_qt q̇ − C_tt − α Ċ − β C.
        """
        force = self.force(t, q, v)
        return self.saddle(t, q).solve(force, self.gamma(t, q, v, stabilization))

    def gamma(
        self,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        stabilization: Baumgarte | None = None,
    ) -> Float[Array, " m"]:
        """Right-hand side γ of the constraints at acceleration level."""
        if self.m == 0:
            return jnp.zeros(0, q.dtype)
        state = self.constraint_state(t, q, v)
        if stabilization is None:
            return -state.curvature
        return -state.curvature - stabilization.term(state.violation, state.rate)

    def linearize(
        self,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        stabilization: Baumgarte | None = None,
    ) -> Linearization:
        """Acceleration and its derivatives.

        With the residual R = (M a + C_qᵀ λ − Q, C_q a − γ) and a, λ held fixed, the derivatives
        solve the extended system with the right-hand sides −∂R: one factorisation, instead of
        differentiating through the solve.
        """
        t = jnp.asarray(t, q.dtype)
        n, saddle = self.n, self.saddle(t, q)
        a, multipliers = saddle.solve(self.force(t, q, v), self.gamma(t, q, v, stabilization))

        def residual(t, q, v):  # type: ignore[no-untyped-def]
            inertia = self.momentum(q, a)
            if self.m == 0:
                return inertia - self.force(t, q, v), jnp.zeros(0, q.dtype)
            reaction = jax.grad(lambda q: multipliers @ self.constraint(t, q))(q)
            state = self.constraint_state(t, q, v, a)
            bend = state.curvature
            if stabilization is not None:
                bend += stabilization.term(state.violation, state.rate)
            return inertia + reaction - self.force(t, q, v), bend

        def push(direction):  # type: ignore[no-untyped-def]
            tangent = (direction[2 * n], direction[:n], direction[n : 2 * n])
            return jax.jvp(residual, (t, q, v), tangent)[1]

        down, across = jax.vmap(push, out_axes=1)(jnp.eye(2 * n + 1, dtype=q.dtype))
        slopes, _ = saddle.solve(-down, -across)
        return Linearization(a, slopes[:, :n], slopes[:, n : 2 * n], slopes[:, 2 * n])

    def frequencies(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> Frequencies:
        """The fastest frequencies at a state, by power iteration with products only.

        ω² = |∂a/∂q| sees springs, flexible modes, gravity on hinged bodies and rotation; the rate
        |∂a/∂v| sees dampers.
        """
        # Difference quotients: the derivative would double the program for a rough number.
        step = jnp.sqrt(jnp.finfo(q.dtype).eps)
        among = jnp.stack([self.rigid(), *[jnp.ones(self.n, bool)] * 2])

        def sizes(x):  # type: ignore[no-untyped-def]
            return jnp.sqrt(jnp.sum(x * self.momentum(q, x.T).T, axis=1))

        def push(x, _):  # type: ignore[no-untyped-def]
            bend = jnp.concatenate([x[:2], jnp.zeros_like(x[:2])])
            rate = jnp.concatenate([jnp.zeros_like(x), x[2:]])
            moved = jax.vmap(lambda x, w: self.acceleration(t, q + step * x, v + step * w)[0])
            found = moved(bend, rate)
            bent = jnp.where(among, (found[np.array([0, 1, 3])] - found[2][None]) / step, 0)
            size = sizes(bent)
            return bent / jnp.where(size > 0, size, 1)[:, None], size

        # No symmetric direction, so that no mode of a symmetric mechanism is missed.
        x = jnp.where(among, jnp.cos(1.0 + jnp.arange(self.n, dtype=q.dtype) ** 1.5)[None], 0)
        size = sizes(x)
        _, found = jax.lax.scan(push, x / jnp.where(size > 0, size, 1)[:, None], None, length=12)
        # The largest stretch met, not the last: a level pendulum's ∂a/∂q is nilpotent.
        rigid, all_, rate = jnp.max(found, axis=0)
        return Frequencies(jnp.sqrt(rigid), jnp.maximum(jnp.sqrt(all_), rate))

    def kinetic_energy(self, q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, ""]:
        """T = ½ vᵀ M v [J]."""
        return 0.5 * v @ self.momentum(q, v)


def quadratic_velocity_force(mass):  # type: ignore[no-untyped-def]
    """The quadratic velocity vector −Ṁ v + ½ ∂(vᵀ M v)/∂q of a mass matrix function, by autodiff.

    `mass(q)` gives M (n, n), or the diagonal (n,) of a diagonal one. Returns a function of (q, v).
    It belongs into the `force` of a CustomSystem whose mass matrix changes with q.
    """

    def force(q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
        def momentum(q):  # type: ignore[no-untyped-def]
            m = mass(q)
            return m * v if m.ndim == 1 else m @ v

        _, rate = jax.jvp(momentum, (q,), (v,))
        _, transpose = jax.vjp(momentum, q)
        return 0.5 * transpose(v)[0] - rate

    return force
