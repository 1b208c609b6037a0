"""Rodas5P: a stiffly accurate Rosenbrock method of order 5, without Newton iterations.

Steinebach, "Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the
Julia Differential Equations package", BIT 63 (2023), in the transformed form of Hairer & Wanner,
Solving Ordinary Differential Equations II, section IV.7.
"""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from ..common.compat import parts_of_term, unwrap_term
from ..linalg.dense import invert_any, multiply
from .rodas5p_tableau import DENSE, GAMMA, SLOPES, TIMES, A, C
from .term import MotionTerm

Flat = Float[Array, " size"]


class _Linearized(NamedTuple):
    """The vector field at the start of a step, as Rosenbrock methods use it."""

    slope: Flat  # f
    drift: Flat  # h ∂f/∂t
    solve: Callable[[Flat], Flat]  # with I/(hγ) − J


class RodasInterpolation(diffrax.AbstractLocalInterpolation):
    """Dense output of order 4, from the stages of the step."""

    t0: Any  # type: ignore[misc]
    t1: Any  # type: ignore[misc]
    y0: PyTree
    y1: PyTree
    k: PyTree  # stages, leading axis 8

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> PyTree:
        del left
        if t1 is not None:
            return jax.tree.map(lambda b, a: b - a, self.evaluate(t1), self.evaluate(t0))
        span = self.t1 - self.t0
        theta = jnp.where(span == 0, 0.0, (t0 - self.t0) / jnp.where(span == 0, 1.0, span))

        def leaf(y0: Array, y1: Array, k: Array) -> Array:
            x = theta.astype(y0.dtype)
            flat = multiply(jnp.asarray(DENSE, k.dtype), k.reshape(len(k), -1))
            h1, h2, h3 = flat.reshape(3, *y0.shape)
            y: Array = (1 - x) * y0 + x * (y1 + (1 - x) * (h1 + x * (h2 + x * h3)))
            return y

        return jax.tree.map(leaf, self.y0, self.y1, self.k)


class Rodas5P(diffrax.AbstractAdaptiveSolver[None]):
    """Linearly implicit, order 5 with an embedded method of order 4, L-stable, eight stages.

    For stiff and for differential-algebraic systems of index one. A step costs one derivative of
    the vector field, one factorisation and eight evaluations; there is no iteration to fail.
    For all terms of diffrax whose control is time: `ODETerm`, a `MultiTerm` of such, and what
    `BacksolveAdjoint` makes of them. For equations of motion (a `MotionTerm`) it uses that q' = v:
    only W = I/(hγ) − ∂a/∂v − hγ ∂a/∂q is factored, half as large as the Jacobian.

    Raises ValueError, naming the term, for controls other than time.
    """

    term_structure: ClassVar = diffrax.AbstractTerm
    interpolation_cls: ClassVar[Callable[..., RodasInterpolation]] = RodasInterpolation

    def order(self, terms: PyTree) -> int:
        del terms
        return 5

    def init(self, terms: PyTree, t0: Any, t1: Any, y0: PyTree, args: PyTree) -> None:
        return None

    def func(self, terms: PyTree, t0: Any, y0: PyTree, args: PyTree) -> PyTree:
        return terms.vf(t0, y0, args)

    def step(
        self,
        terms: PyTree,
        t0: Any,
        t1: Any,
        y0: PyTree,
        args: PyTree,
        solver_state: None,
        made_jump: Any,
    ) -> tuple[PyTree, PyTree, dict[str, PyTree], None, diffrax.RESULTS]:
        del solver_state, made_jump
        y1, error, dense = _step(terms, t0, t1, y0, args)
        return y1, error, dense, None, diffrax.RESULTS.successful  # type: ignore[return-value]


@eqx.filter_jit
def _step(
    terms: PyTree, t0: Any, t1: Any, y0: PyTree, args: PyTree
) -> tuple[PyTree, PyTree, dict[str, PyTree]]:
    # Jitted for its cache: diffrax traces a step several times, which takes seconds.
    start, unravel = ravel_pytree(y0)
    dtype = start.dtype
    control = _time_control(terms, t0, t1)
    h = jnp.asarray(jax.tree.leaves(control)[0], dtype)
    unit = jax.tree.map(jnp.ones_like, control)

    def rate(t: Any, y: Flat) -> Flat:
        # A sum of terms has no vector field, but its product with the control.
        return ravel_pytree(terms.vf_prod(t, unravel(y), args, unit))[0]

    point = _linearize(terms, rate, t0, t1, y0, h)
    first = point.solve(point.slope + SLOPES[0].astype(dtype) * point.drift)
    stages = jnp.zeros((8, start.size), dtype).at[0].set(first)

    def stage(carry: Any, row: Any) -> Any:
        stages, _ = carry
        i, a, c, time, slope = row
        y = start + multiply(a, stages)
        own = multiply(c, stages) / h + slope * point.drift
        k = point.solve(rate(t0 + time * (t1 - t0), y) + own)
        return (stages.at[i].set(k), y), None

    # Scanned: the vector field is compiled once, not eight times.
    rows = (jnp.arange(1, 8), *(jnp.asarray(x[1:], dtype) for x in (A, C, TIMES, SLOPES)))
    (stages, last), _ = jax.lax.scan(stage, (stages, start), rows)
    # The last stage is the difference of the solutions of orders five and four.
    error = unravel(stages[7])
    y1 = unravel(last + stages[7])
    dense = {"y0": y0, "y1": y1, "k": jax.vmap(unravel)(stages)}
    return y1, error, dense


def _time_control(terms: PyTree, t0: Any, t1: Any) -> PyTree:
    """The control over a step, each part of which is the length of the step; else ValueError."""
    waiting = [terms]
    while waiting:
        term = waiting.pop()
        parts = parts_of_term(term)
        waiting.extend(parts)
        shapes = [] if parts else [jnp.shape(x) for x in jax.tree.leaves(term.contr(t0, t1))]
        if isinstance(term, diffrax.ControlTerm) or (not parts and shapes != [()]):
            raise ValueError(
                f"Rodas5P: a {type(term).__name__} is driven by a control that is not time; make "
                "it an ODETerm (ControlTerm.to_ode() does), or use a solver of diffrax such as "
                "diffrax.Heun()."
            )
    return terms.contr(t0, t1)


def _linearize(
    terms: PyTree,
    rate: Callable[[Any, Flat], Flat],
    t0: Any,
    t1: Any,
    y0: PyTree,
    h: Float[Array, ""],
) -> _Linearized:
    inner, direction = unwrap_term(terms)
    if isinstance(inner, MotionTerm):
        return _linearize_motion(inner, t0 * direction, y0, h)
    start, _ = ravel_pytree(y0)
    t = jnp.asarray(t0, start.dtype)
    slope, drift = jax.jvp(lambda t: rate(t, start), (t,), (jnp.asarray(t1 - t0, t.dtype),))
    jacobian = jax.jacfwd(rate, argnums=1)(t, start)
    inverse = invert_any(jnp.eye(start.size, dtype=start.dtype) / (h * GAMMA) - jacobian)
    return _Linearized(slope, drift, lambda r: multiply(inverse, r))


def _linearize_motion(term: MotionTerm, t: Any, y: PyTree, h: Float[Array, ""]) -> _Linearized:
    _, v = y
    n, step = v.size, h * GAMMA
    point = term.linearize(t, y)
    stage = point.stages(step)

    def solve(r: Flat) -> Flat:
        rq, rv = r[:n], r[n:]
        # (1/(hγ) − J) k = r with q̇ = v eliminated: k_q = hγ (r_q + k_v), so that one system for
        # k_v is left, with M and C_q in the place of an inverse.
        kv = stage(rv, rq)
        return jnp.concatenate([step * (rq + kv), kv])

    slope = jnp.concatenate([v, point.acceleration])
    return _Linearized(slope, jnp.concatenate([jnp.zeros_like(v), h * point.by_time]), solve)
