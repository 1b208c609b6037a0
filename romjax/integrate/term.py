"""The equation of motion as a diffrax term that knows its second-order structure."""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..system.base import AbstractSystem
from ..system.dynamics import Linearization, LinearizationByParts, linearize_for_steps, solve
from ..system.stabilization import Baumgarte

State = tuple[Float[Array, " n"], Float[Array, " n"]]
ChartedState = tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, ""]]


class MotionTerm(diffrax.AbstractTerm[State, Any]):
    """(q, v)' = (v, a(t, q, v)) (chapter equation 39.4)."""

    system: AbstractSystem
    stabilization: Baumgarte | None

    def vf(self, t: Any, y: State, args: Any) -> State:
        del args
        q, v = y
        t = jnp.asarray(t, q.dtype)
        return v, solve(self.system, t, q, v, self.stabilization).acceleration

    def contr(self, t0: Any, t1: Any, **kwargs: Any) -> Any:
        return t1 - t0

    def prod(self, vf: State, control: Any) -> State:
        product: State = jax.tree.map(lambda f: control * f, vf)
        return product

    def linearize(self, t: Any, y: State) -> Linearization | LinearizationByParts:
        """The acceleration and its derivatives at one state."""
        q, v = y
        return linearize_for_steps(self.system, jnp.asarray(t, q.dtype), q, v, self.stabilization)


class ChartedMotionTerm(diffrax.AbstractTerm[ChartedState, Any]):
    """(q, v, chart)' = (v, a(t, q, v), 0): motion in one of several charts of a system.

    The number of the chart is part of the state, since it changes between steps, and constant
    within each. `PostStepSolver` takes it out before its own solver sees the state.
    """

    motion: MotionTerm
    post_step: Any  # a `PostStep`

    def in_chart(self, chart: Float[Array, ""]) -> MotionTerm:
        """The term of (q, v) in one chart."""
        system = self.post_step.in_chart(self.motion.system, chart)
        return MotionTerm(system, self.motion.stabilization)

    def vf(self, t: Any, y: ChartedState, args: Any) -> ChartedState:
        q, v, chart = y
        return *self.in_chart(chart).vf(t, (q, v), args), jnp.zeros_like(chart)

    def contr(self, t0: Any, t1: Any, **kwargs: Any) -> Any:
        return t1 - t0

    def prod(self, vf: ChartedState, control: Any) -> ChartedState:
        product: ChartedState = jax.tree.map(lambda f: control * f, vf)
        return product
