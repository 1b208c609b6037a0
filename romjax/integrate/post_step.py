"""A change of the state after each step: to the constraints, or to coordinates that suit it."""

import dataclasses
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..common import compat
from ..common.arrays import Time
from ..system.base import AbstractSystem
from ..system.consistent import project
from .between import interpolation_of
from .term import ChartedMotionTerm, MotionTerm

Chart = Float[Array, ""] | None


@runtime_checkable
class PostStep(Protocol):
    """The protocol of objects that change the state after each accepted step.

    A system that has several charts (coordinates that each hold in a part of its motion) numbers
    them. The number is a float, so that it can be part of the integrated state. Without charts it
    is None everywhere.
    """

    def start(self, system: AbstractSystem) -> Chart:
        """The chart in which the system's start is given."""

    def in_chart(self, system: AbstractSystem, chart: Chart) -> AbstractSystem:
        """The system in one chart."""

    def after_step(
        self,
        system: AbstractSystem,
        chart: Chart,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
    ) -> tuple[Chart, Float[Array, " n"], Float[Array, " n"]]:
        """The chart to go on in and the state (q, v) there, from that of `system` in a `chart`."""


class ProjectState(eqx.Module):
    """Moves the state after each step to the nearest with C = 0 and Ċ = 0 in the mass metric."""

    sweeps: int = eqx.field(static=True)

    def start(self, system: AbstractSystem) -> Chart:
        return None

    def in_chart(self, system: AbstractSystem, chart: Chart) -> AbstractSystem:
        return system

    def after_step(
        self,
        system: AbstractSystem,
        chart: Chart,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
    ) -> tuple[Chart, Float[Array, " n"], Float[Array, " n"]]:
        return None, *project(system, jnp.asarray(t, q.dtype), q, v, self.sweeps)


class PostStepInterpolation(diffrax.AbstractLocalInterpolation):
    """Dense output of a step in one chart, with the number of the chart."""

    t0: Any  # type: ignore[misc]
    t1: Any  # type: ignore[misc]
    motion: diffrax.AbstractLocalInterpolation
    chart: Float[Array, ""]

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> PyTree:
        # Within a step the motion is in the chart that it began in; a difference of two states has
        # no chart.
        chart = self.chart if t1 is None else jnp.zeros_like(self.chart)
        return *self.motion.evaluate(t0, t1, left), chart


@dataclasses.dataclass(frozen=True)
class _Interpolate:
    """The wrapped solver's interpolation, with a chart where the dense output has one."""

    wrapped: Callable[..., diffrax.AbstractLocalInterpolation]

    def __call__(self, *, t0: Any, t1: Any, **dense: Any) -> diffrax.AbstractLocalInterpolation:
        if "chart" not in dense:
            return self.wrapped(t0=t0, t1=t1, **dense)
        motion = self.wrapped(t0=t0, t1=t1, **dense["motion"])
        return PostStepInterpolation(t0, t1, motion, dense["chart"])


class PostStepSolver(diffrax.AbstractAdaptiveSolver[Any], diffrax.AbstractWrappedSolver[Any]):
    """Any diffrax solver, each step followed by the `after_step` of a `PostStep`.

    The state is (q, v), of a `MotionTerm`, or (q, v, chart), of a `ChartedMotionTerm`. The wrapped
    solver sees (q, v) in the chart of the step, and so does its dense output.

    The state after `after_step` is not the one at which a first-same-as-last method has evaluated
    the vector field, so the wrapped solver is told of a jump at every step.
    """

    solver: diffrax.AbstractSolver[Any]  # type: ignore[misc]
    post_step: PostStep

    @property
    def term_structure(self) -> Any:
        return self.solver.term_structure

    @property
    def interpolation_cls(self) -> Any:  # type: ignore[override]
        return _Interpolate(interpolation_of(self.solver))

    @property
    def term_compatible_contr_kwargs(self) -> Any:
        return compat.control_arguments(self.solver)

    @property
    def scan_kind(self) -> Any:
        return compat.scan_kind(self.solver)

    def order(self, terms: PyTree) -> int | None:
        return self.solver.order(terms)

    def error_order(self, terms: PyTree) -> Any:
        return self.solver.error_order(terms)

    def init(self, terms: PyTree, t0: Any, t1: Any, y0: PyTree, args: PyTree) -> Any:
        motion, _, y0, _ = _split(terms, y0)
        return compat.state_of_method(self.solver, motion, t0, t1, y0, args)

    def func(self, terms: PyTree, t0: Any, y0: PyTree, args: PyTree) -> PyTree:
        motion, _, y0, chart = _split(terms, y0)
        return _join(self.solver.func(motion, t0, y0, args), jax.tree.map(jnp.zeros_like, chart))

    def step(
        self,
        terms: PyTree,
        t0: Any,
        t1: Any,
        y0: PyTree,
        args: PyTree,
        solver_state: Any,
        made_jump: Any,
    ) -> Any:
        del made_jump
        motion, system, y0, chart = _split(terms, y0)
        # After the state was moved, slopes that methods keep from the step before are those of
        # another state: they are computed anew.
        y1, error, dense, state, result = self.solver.step(
            motion, t0, t1, y0, args, solver_state, made_jump=jnp.array(True)
        )
        _, direction = compat.unwrap_term(terms)
        time = jnp.asarray(t1 * direction, jax.tree.leaves(y1)[0].dtype)
        after, *y1 = self.post_step.after_step(system, chart, time, *y1)
        if chart is not None:
            dense = {"motion": dense, "chart": chart}
            # A chart is a number of its own kind, and has no error.
            error = None if error is None else _join(error, jnp.zeros_like(chart))
            after = jnp.asarray(after, chart.dtype)
        return _join(tuple(y1), after), error, dense, state, result


def _split(terms: PyTree, y: PyTree) -> tuple[Any, AbstractSystem, PyTree, Chart]:
    """The term and the system in the chart of a state, the state without it, and the chart."""
    term, direction = compat.unwrap_term(terms)
    if isinstance(term, MotionTerm):
        return terms, term.system, y, None
    if not isinstance(term, ChartedMotionTerm):
        raise ValueError(
            f"PostStepSolver: a {type(term).__name__} is no motion that could be projected or "
            "change its chart; use romjax.simulate."
        )
    q, v, chart = y
    motion = term.in_chart(chart)
    return compat.wrap_term(motion, direction), motion.system, (q, v), chart


def _join(y: PyTree, chart: Chart) -> PyTree:
    return y if chart is None else (*y, chart)
