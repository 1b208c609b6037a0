"""Steps of an integration, kept or not, as `diffrax.diffeqsolve` takes them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..common import compat
from .cuts import AbstractPassage, AbstractWatch, Arrival, Cut, Watching

# A step that ends this close to the end of the run, in units in the last place, ends there: the
# dense output of the short step that was left would be nothing but rounding.
_NEAR_END = 100
# How far beside a corner a signal is evaluated, in units in the last place.
_BESIDE = 2


class Progress(NamedTuple):
    """The state of a run between two steps."""

    y: PyTree
    solver_state: PyTree
    watching: Watching | None  # of events, if there are any
    t: Float[Array, ""]
    next_t: Float[Array, ""]
    controller_state: PyTree
    result: diffrax.RESULTS
    steps: Int[Array, ""]
    accepted: Int[Array, ""]


class Trial(NamedTuple):
    """The result of one step of a method, with the event at its end if events are watched, and the
    sides on which laws were held in it if there is something that it must not pass.
    """

    y: PyTree
    solver_state: PyTree
    between: diffrax.AbstractLocalInterpolation
    arrival: Arrival | None
    error: PyTree
    result: diffrax.RESULTS
    sides: Any = None


class Steps(NamedTuple):
    """The rules by which steps are taken: method, step size control, and what ends steps.

    `attempt` computes a step by the function `trial`, which is that of the method unless another
    one takes its part, and `interpolation` makes dense output of its stages. What ends steps but
    for the errors in them, each None where nothing does:

    - `watch`: events. `passage`: what steps must not pass.
    - `longest`: how long a step from a time may be; `corners`: times at which steps end.
    """

    term: diffrax.AbstractTerm[Any, Any]
    solver: diffrax.AbstractSolver[Any]
    interpolation: Callable[..., diffrax.AbstractLocalInterpolation]
    controller: diffrax.AbstractStepSizeController[Any, Any]
    t0: Float[Array, ""]
    t1: Float[Array, ""]
    dt0: Float[Array, ""]
    max_steps: Int[Array, ""]
    watch: AbstractWatch | None
    passage: AbstractPassage | None
    longest: Callable[[Float[Array, ""]], Float[Array, ""]] | None
    corners: Float[Array, " k"] | None

    def start(self, y0: PyTree) -> Progress:
        """Return the progress before the first step."""
        t0, zero = self.t0, jnp.zeros((), int)
        order: Any = self.solver.error_order(self.term)
        first, controller_state = self.controller.init(
            self.term, t0, self.t1, y0, self.dt0, None, self.solver.func, order
        )
        next_t = self._limited(t0, jnp.asarray(first), jnp.ones((), bool))
        next_t = jax.lax.stop_gradient(next_t)
        return Progress(
            y=y0,
            solver_state=compat.state_of_method(self.solver, self.term, t0, next_t, y0, None),
            watching=None if self.watch is None else self.watch.start(t0, y0),
            t=t0,
            next_t=next_t,
            controller_state=jax.tree.map(jnp.asarray, controller_state),
            result=jax.tree.map(jnp.asarray, diffrax.RESULTS.successful),
            steps=zero,
            accepted=zero,
        )

    def unfinished(self, now: Progress) -> Bool[Array, ""]:
        """Whether another step follows."""
        going = diffrax.is_successful(now.result) & ~self.is_stopped(now)
        return (now.t < self.t1) & going & (now.steps < self.max_steps)

    def is_stopped(self, now: Progress) -> Bool[Array, ""]:
        """Whether an event has ended the run."""
        if self.watch is None or now.watching is None:
            return jnp.zeros((), bool)
        return self.watch.is_stopped(now.watching)

    def is_held(self, now: Progress) -> Bool[Array, ""]:
        """Whether a `Stop` has ended the run, so that later outputs repeat the state there."""
        return jnp.zeros((), bool) if now.watching is None else now.watching.stopped

    def trial(
        self, y: PyTree, solver_state: PyTree, watching: Watching | None, t0: Array, t1: Array
    ) -> Trial:
        """A step of the method from t0 to t1."""
        jumped: Any = False if watching is None else watching.jumped
        start, end, term, sides = t0, t1, self.term, None
        if self.passage is not None:
            term, sides, other = self.passage.held(term, t0, t1, y)
            jumped = jumped | other
        if self.corners is not None:
            # A signal that bends at a corner has two derivatives by the time of it, of which a step
            # needs the one on its own side: it begins and ends beside it, by rounding alone.
            aside = _BESIDE * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(t0), jnp.abs(t1))
            begins, ends = (jnp.any(self.corners == t) for t in (t0, t1))
            start, end = jnp.where(begins, t0 + aside, t0), jnp.where(ends, t1 - aside, t1)
            jumped = jumped | begins
        y1, error, dense, solver_state, result = self.solver.step(
            term, start, end, y, None, solver_state, made_jump=jumped
        )
        between = self.interpolation(t0=t0, t1=t1, **dense)
        arrival = None
        if self.watch is not None and watching is not None:
            arrival = self.watch.arrive(watching, t0, t1, y1)
            y1 = arrival.after
        return Trial(y1, solver_state, between, arrival, error, result, sides)

    def attempt(
        self, now: Progress, trial: Callable[[PyTree, PyTree, Any, Array, Array], Trial]
    ) -> tuple[Progress, Trial]:
        """One step, kept or not, and what was computed for it."""
        t0, t1, going = now.t, now.next_t, self.unfinished(now)
        order: Any = self.solver.error_order(self.term)
        tried = trial(now.y, now.solver_state, now.watching, t0, t1)
        # An infinite error rejects the step, which NaN would not.
        error = jax.tree.map(lambda x: jnp.where(jnp.isnan(x), jnp.inf, x), tried.error)
        keep, t, next_t, _, controller_state, controlled = self.controller.adapt_step_size(
            t0, t1, now.y, tried.y, None, error, order, now.controller_state
        )
        after = now._replace(
            t=jnp.minimum(t, self.t1), next_t=jnp.asarray(next_t), controller_state=controller_state
        )
        keep, after = self._without_passage(now, tried, jnp.asarray(keep) & going, after)
        keep, after = self._at_events(now, tried, keep, after)
        solved = diffrax.RESULTS.where(keep, tried.result, diffrax.RESULTS.successful)
        result = diffrax.RESULTS.where(diffrax.is_successful(solved), controlled, solved)
        # Lengths of steps are constants in derivatives, in both modes.
        planned = jnp.where(going, self._limited(after.t, after.next_t, keep), t1)
        return Progress(
            y=chosen(keep, tried.y, now.y),
            solver_state=chosen(keep, tried.solver_state, now.solver_state),
            watching=after.watching,
            t=jnp.where(going, after.t, t0),
            next_t=jax.lax.stop_gradient(planned),
            controller_state=jax.lax.stop_gradient(
                chosen(going, after.controller_state, now.controller_state)
            ),
            result=diffrax.RESULTS.where(going, result, now.result),
            steps=now.steps + jnp.where(going, 1, 0),
            accepted=now.accepted + jnp.where(keep, 1, 0),
        ), tried

    def _without_passage(
        self, now: Progress, tried: Trial, keep: Bool[Array, ""], after: Progress
    ) -> tuple[Bool[Array, ""], Progress]:
        """Whether a step is kept, and what follows, where it may pass through a contact."""
        if self.passage is None:
            return keep, after
        passes, end = self.passage.passed(now.t, now.next_t, tried.sides, tried.between)
        cut = keep & passes
        next_end = self.passage.next_end(after.t, tried.y, after.next_t, keep & ~cut)
        return keep & ~cut, after._replace(
            t=jnp.where(cut, now.t, after.t),
            next_t=jnp.where(cut, end, next_end),
            controller_state=chosen(cut, now.controller_state, after.controller_state),
        )

    def _at_events(
        self, now: Progress, tried: Trial, keep: Bool[Array, ""], after: Progress
    ) -> tuple[Bool[Array, ""], Progress]:
        """Whether a step is kept, and what follows, where events may cut it."""
        if self.watch is None or now.watching is None or tried.arrival is None:
            return keep, after
        arrival, planned = tried.arrival, now.watching.planned
        cut = self.watch.cut(now.watching, now.t, tried.between, arrival)
        is_cut, accepted = keep & cut.is_due, keep & ~cut.is_due & ~cut.lasting
        t = jnp.where(accepted & arrival.happens, arrival.t, after.t)
        # Beyond the event, the run goes on as if the step had not been cut.
        resumes = accepted & (planned > t)
        return accepted, after._replace(
            t=jnp.where(accepted | ~keep, t, now.t),
            next_t=jnp.where(is_cut, cut.at, jnp.where(resumes, planned, after.next_t)),
            controller_state=chosen(is_cut | resumes, now.controller_state, after.controller_state),
            watching=self.watch.follow(
                now.watching,
                accepted,
                Cut(is_cut, cut.at, keep & cut.lasting),
                now.y,
                now.next_t,
                arrival,
            ),
        )

    def without_transpose(self) -> "Steps":
        """The same for runs that nobody differentiates: stages in a loop without checkpoints."""
        if getattr(self.solver, "scan_kind", "none") is not None:
            return self
        stages, none = "lax", lambda x: x is None
        solver = eqx.tree_at(lambda s: s.scan_kind, self.solver, stages, is_leaf=none)
        return self._replace(solver=solver)

    def _limited(self, t: Array, next_t: Array, keep: Array) -> Array:
        # A step that would end beyond `t1`, or just before it, ends there; one after a rejection
        # goes half way only. The whole way would be the step that was just rejected.
        t1 = self._next_end(t)
        if self.longest is not None:
            next_t = jnp.minimum(next_t, t + self.longest(t))
        end = t1 - self._rounding(t1)
        return jnp.where(next_t > end, jnp.where(keep, t1, t + 0.5 * (t1 - t)), next_t)

    def _next_end(self, t: Array) -> Array:
        """The end of the run, or the next corner before it."""
        if self.corners is None:
            return self.t1
        later = jnp.where(self.corners > t + self._rounding(t), self.corners, jnp.inf)
        return jnp.minimum(jnp.min(later), self.t1)

    def _rounding(self, t: Array) -> Array:
        return _NEAR_END * jnp.finfo(t.dtype).eps * jnp.abs(t)


def chosen(condition: Bool[Array, ""], new: PyTree, old: PyTree) -> PyTree:
    """One of two pytrees."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
