"""Consequences of the equations of motion of any system, in the order of the theory."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common import compat
from ..common.arrays import Time
from ..linalg.dense import invert_any, multiply
from ..linalg.implicit import ImplicitKKT, Slopes
from ..linalg.kkt import KKT
from .base import AbstractSystem
from .constraints import ConstraintState, differentiate, right_hand_side
from .stabilization import Baumgarte
from .state import AbstractState, Solved

# The solution of the linear equations of a stage, for both of its right-hand sides.
Stage = Callable[[Float[Array, " n"], Float[Array, " n"]], Float[Array, " n"]]

# A generalized force (n,) as a function of t, q and v.
Applied = Callable[[Array, Array, Array], Array]


class Linearization(NamedTuple):
    """The acceleration and its derivatives at one state."""

    acceleration: Float[Array, " n"]
    by_position: Float[Array, "n n"]  # ∂a/∂q
    by_velocity: Float[Array, "n n"]  # ∂a/∂v
    by_time: Float[Array, " n"]  # ∂a/∂t

    def stages(self, step: Float[Array, ""]) -> Stage:
        """The solution of W w = b + s ∂a/∂q c with W = 1/s − ∂a/∂v − s ∂a/∂q for a `step` s, as a
        function of b and c.
        """
        # An implicit stage is (1/s − J) k = r with the Jacobian J of (v, a). Its upper half gives
        # k_q = s (r_q + k_v), and with that its lower half
        # (1/s − ∂a/∂v − s ∂a/∂q) k_v = r_v + s ∂a/∂q r_q.
        unit = jnp.eye(self.acceleration.size, dtype=self.acceleration.dtype)
        # One inverse serves all stages; at these sizes a product is far cheaper than two triangular
        # solves, and W is well scaled.
        inverse = invert_any(unit / step - self.by_velocity - step * self.by_position)
        return lambda b, c: multiply(inverse, b + step * multiply(self.by_position, c))


class LinearizationByParts(NamedTuple):
    """The acceleration, and what its derivatives follow from without being formed."""

    acceleration: Float[Array, " n"]
    by_time: Float[Array, " n"]
    kkt: KKT
    slopes: Slopes
    redundant: bool  # whether constraints may repeat each other

    def stages(self, step: Float[Array, ""]) -> Stage:
        """The solution of the equations of stages, as in `Linearization`."""
        return ImplicitKKT(self.kkt, self.slopes, step, self.redundant).stage


@eqx.filter_jit
def solve(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None,
) -> Solved:
    """The equations of motion at one state, jitted so that all that ask for it share one trace."""
    state = system.state(t, q, v)
    return state.solve(_gamma(system, state, t, q, v, stabilization))


def solve_with(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None,
    applied: Applied | None,
) -> Solved:
    """The equations of motion as in `solve`, with a generalized force `applied` in addition."""
    if applied is None:
        return solve(system, t, q, v, stabilization)
    state, right = system.state(t, q, v), gamma(system, t, q, v, stabilization)
    kkt, force = state.kkt(), state.force() + applied(jnp.asarray(t, q.dtype), q, v)
    return Solved(*kkt.solve(force, right), kkt)


def apply_mass(
    system: AbstractSystem, q: Float[Array, " n"], x: Float[Array, "n *k"]
) -> Float[Array, "n *k"]:
    """M x at the configuration q, for one or several x."""
    return system.state(0.0, q, jnp.zeros_like(q)).apply_mass(x)


def kinetic_energy(
    system: AbstractSystem, q: Float[Array, " n"], v: Float[Array, " n"]
) -> Float[Array, ""]:
    """T = ½ vᵀ M v [J]."""
    return 0.5 * multiply(v, apply_mass(system, q, v))


def quadratic_velocity_force(mass: Callable[..., Array]) -> Callable[..., Array]:
    """The quadratic velocity vector −Ṁ v + ½ ∂(vᵀ M v)/∂q of a mass matrix function, by autodiff.

    `mass(q)` gives M (n, n), or the diagonal (n,) of a diagonal one. Returns a function of (q, v).
    It belongs into the `force` of a CustomSystem whose mass matrix changes with q.
    """

    # Lagrange's equations of T = ½ vᵀ M v are M a + Ṁ v − ½ ∂(vᵀ M v)/∂q = Q. The transpose with v
    # held gives v · ∂(M v)/∂q, the whole of that gradient.
    def force(q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
        def momentum(q: Float[Array, " n"]) -> Float[Array, " n"]:
            m = mass(q)
            return m * v if m.ndim == 1 else multiply(m, v)

        rate: Array
        _, rate = jax.jvp(momentum, (q,), (v,))
        _, transpose = jax.vjp(momentum, q)
        slope: Array = transpose(v)[0]
        return 0.5 * slope - rate

    return force


def jacobian(system: AbstractSystem, t: Time, q: Float[Array, " n"]) -> Float[Array, "m n"]:
    """Constraint Jacobian C_q."""
    return system.state(t, q, jnp.zeros_like(q)).jacobian()


def constraint_state(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    a: Float[Array, " n"] | None = None,
) -> ConstraintState:
    """C, Ċ and C̈; without an acceleration `a`, C̈ without its part C_q a."""
    own = system.state(t, q, v).constraints() if a is None else None
    return own or differentiate(system.constraint, t, q, v, a)


def gamma(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None = None,
) -> Float[Array, " m"]:
    """The right-hand side γ of the constraints at the level of accelerations, C_q a = γ."""
    return _gamma(system, system.state(t, q, v), t, q, v, stabilization)


def _gamma(
    system: AbstractSystem,
    state: AbstractState,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None,
) -> Float[Array, " m"]:
    known = state.constraints()
    return right_hand_side(system.constraint, system.m, t, q, v, stabilization, known)


def linearize(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None = None,
    applied: Applied | None = None,
) -> Linearization:
    """Acceleration and its derivatives, with a force that is `applied` beside the system's own.

    With the residual R = (M a + C_qᵀ λ − Q, C_q a − γ) and a, λ held fixed, the derivatives solve
    the extended system with the right-hand sides −∂R: one factorisation, instead of differentiating
    through the solve.
    """
    t = jnp.asarray(t, q.dtype)
    solved = solve_with(system, t, q, v, stabilization, applied)
    return _linearized(system, t, q, v, stabilization, solved, applied)


def linearize_for_steps(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None = None,
) -> Linearization | LinearizationByParts:
    """Acceleration and its derivatives, for the stages of implicit steps: part by part, where the
    system gives them so.
    """
    t = jnp.asarray(t, q.dtype)
    solved = solve(system, t, q, v, stabilization)
    a, multipliers, kkt = solved
    slopes = system.state(t, q, v).slopes(a, multipliers, stabilization)
    if slopes is None:
        return _linearized(system, t, q, v, stabilization, solved)
    by_time = jnp.zeros_like(a)
    residual = _residual(system, a, multipliers, stabilization)
    if compat.depends_on_first(residual, t, q, v):
        change: tuple[Array, Array]
        change = jax.jvp(lambda t: residual(t, q, v), (t,), (jnp.ones_like(t),))[1]
        by_time, _ = kkt.solve(-change[0], -change[1])
    return LinearizationByParts(a, by_time, kkt, slopes, system.structure.loops)


def _linearized(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None,
    solved: Solved,
    applied: Applied | None = None,
) -> Linearization:
    """All derivatives, by pushing each coordinate and each velocity through the whole residual."""
    n, (a, multipliers, kkt) = system.n, solved
    residual = _residual(system, a, multipliers, stabilization, applied)

    def push(direction: Array) -> tuple[Array, Array]:
        tangent = (direction[2 * n], direction[:n], direction[n : 2 * n])
        change: tuple[Array, Array] = jax.jvp(residual, (t, q, v), tangent)[1]
        return change

    # Jitted to be a part that the compiler can take by itself.
    by_state = jax.jit(jax.vmap(push, out_axes=1))(jnp.eye(2 * n + 1, dtype=q.dtype))
    slopes, _ = kkt.solve(-by_state[0], -by_state[1])
    return Linearization(a, slopes[:, :n], slopes[:, n : 2 * n], slopes[:, 2 * n])


def _residual(
    system: AbstractSystem,
    a: Float[Array, " n"],
    multipliers: Float[Array, " m"],
    stabilization: Baumgarte | None,
    applied: Applied | None = None,
) -> Callable[[Array, Array, Array], tuple[Array, Array]]:
    """M a + C_qᵀ λ − Q and C_q a − γ as functions of t, q and v."""

    def residual(t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        unbalanced = system.state(t, q, v).residual(a)
        if applied is not None:
            unbalanced -= applied(t, q, v)
        if system.m == 0:
            return unbalanced, jnp.zeros(0, q.dtype)
        # C_qᵀ λ as the gradient of λ · C: C_q itself is not formed.
        reaction = jax.grad(lambda q: multiply(multipliers, system.constraint(t, q)))(q)
        along = constraint_state(system, t, q, v, a)
        curvature = along.curvature
        if stabilization is not None:
            curvature += stabilization.term(along.violation, along.rate)
        return unbalanced + reaction, curvature

    return residual
