"""Followers and watches that close over nothing: the numbers of functions of users become their
own, so that they are arguments of a march that is differentiated.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from .cuts import AbstractWatch, Arrival, Cut, Watching
from .follower import AbstractFollower, Step
from .steps import Progress, Trial, chosen


class Closure(eqx.Module):
    """A function that closes over nothing: the numbers that it took are `constants`.

    Arguments are not compared with the examples, as closures of equinox do: on one of several
    devices an array that no lane changes is elsewhere than one that a step has made.
    """

    jaxpr: Any
    constants: list[Any]
    static: tuple[Any, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, function: Callable[..., Any], *examples: Any) -> "Closure":
        """The function of arrays like these; what else is in the examples stays as it is there."""
        closed, shapes, static = eqx.filter_make_jaxpr(function)(*examples)
        leaves, structure = jax.tree.flatten(static)
        return cls(closed.jaxpr, closed.consts, (jax.tree.structure(shapes), structure, *leaves))

    def __call__(self, *arguments: Any) -> Any:
        arrays = jax.tree.leaves(eqx.filter(arguments, eqx.is_array))
        of_arrays, structure, *leaves = self.static
        results = jax.core.eval_jaxpr(self.jaxpr, self.constants, *arrays)
        return eqx.combine(
            jax.tree.unflatten(of_arrays, results), jax.tree.unflatten(structure, leaves)
        )


class AbstractClosed(AbstractFollower):
    """A follower with a `function` in place of its `follow`."""

    follower: eqx.AbstractVar[AbstractFollower]

    def start(self, start: Progress) -> PyTree:
        return self.follower.start(start)

    def end(self, end: Progress, stopped: Array, seen: PyTree) -> PyTree:
        return self.follower.end(end, stopped, seen)


class Closed(AbstractClosed):
    """A follower whose derivatives in reverse mode nobody may ask for."""

    follower: AbstractFollower
    function: Callable[[Step, PyTree], PyTree]

    @classmethod
    def of(cls, follower: AbstractFollower, step: Step, seen: PyTree) -> AbstractFollower:
        """The follower itself, if it calls no functions of users."""
        if not follower.calls_users:
            return follower
        return cls(follower, Closure.of(follower.follow, step, seen))

    def follow(self, step: Step, seen: PyTree) -> PyTree:
        return self.function(step._replace(seen={}), seen)


class Transposable(AbstractClosed):
    """A follower that reverse mode passes through.

    - `function`: of the times and states at both ends of an accepted step, of the motion between
      them, and of what was seen before.
    """

    follower: AbstractFollower
    function: Callable[[Array, PyTree, Array, PyTree, Any, PyTree], PyTree]

    @classmethod
    def of(cls, follower: AbstractFollower, step: Step, seen: PyTree) -> "Transposable":
        """The follower, for steps and findings of these shapes."""

        def function(t0: Array, y0: PyTree, t1: Array, y1: PyTree, between: Any, seen: Any) -> Any:
            none: Any = None
            # Reverse mode visits accepted steps alone.
            zero, one = jnp.zeros((), int), jnp.ones((), int)
            before = Progress(y0, none, none, t0, none, none, none, zero, zero)
            after = before._replace(y=y1, t=t1, steps=one, accepted=one)
            tried = Trial(y1, none, between, none, none, none)
            return follower.follow(Step(before, after, tried, {}), seen)

        ends = step.before.t, step.before.y, step.after.t, step.after.y
        return cls(follower, Closure.of(function, *ends, step.tried.between, seen))

    def follow(self, step: Step, seen: PyTree) -> PyTree:
        before, after, between = step.before, step.after, step.tried.between
        # The same function as in reverse mode, so that both see the same step.
        new = self.function(before.t, before.y, after.t, after.y, between, seen)
        return chosen(step.kept, new, seen)


class ClosedWatch(AbstractWatch):
    """A watch whose `function` finds the cuts. How long steps are is not differentiated."""

    watch: AbstractWatch
    function: Callable[[Watching, Array, Any, Arrival], Cut]

    @classmethod
    def of(cls, watch: AbstractWatch | None, step: Step) -> AbstractWatch | None:
        """The watch for steps of this shape."""
        if watch is None:
            return None
        before, tried = step.before, step.tried
        by = before.watching, before.t, tried.between, tried.arrival
        return cls(watch, Closure.of(watch.cut, *by))

    def start(self, t: Float[Array, ""], y: Any) -> Watching:
        return self.watch.start(t, y)

    def arrive(self, watching: Watching, t0: Array, t1: Array, y: Any) -> Arrival:
        return self.watch.arrive(watching, t0, t1, y)

    def cut(self, watching: Watching, t0: Array, between: Any, arrival: Arrival) -> Cut:
        return self.function(watching, t0, between, arrival)

    def follow(
        self, watching: Watching, keep: Array, cut: Cut, y0: Any, end: Array, arrival: Arrival
    ) -> Watching:
        return self.watch.follow(watching, keep, cut, y0, end, arrival)

    def is_stopped(self, watching: Watching) -> Bool[Array, ""]:
        return self.watch.is_stopped(watching)
