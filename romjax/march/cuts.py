"""Events that end steps: who watches them, and what is known between steps and at their ends."""

import abc
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .scales import Scales


class Watching(NamedTuple):
    """The state of the watch for events between two steps.

    - `side` (events,): 1 above the level, −1 below it, 0 not told apart from it: at rest there.
    - `scales`: what is told apart. `last` (events,): when each happened.
    - `planned`: where the step would have ended that an event has cut.
    - `jumped`: whether the step before has ended at an event. `stopped`: whether the run ends
      there. `lasting`: whether a contact lasts. `number`: of events so far.
    """

    side: Float[Array, " events"]
    scales: Scales
    last: Float[Array, " events"]
    planned: Float[Array, ""]
    jumped: Bool[Array, ""]
    stopped: Bool[Array, ""]
    lasting: Bool[Array, ""]
    number: Int[Array, ""]


class Arrival(NamedTuple):
    """The end of a step, at an event if `hits` has one.

    - `t`, `before`, `after`: time and state there, before and after what happens there.
    - `impulse` (events,) [N s]; `work` of it [J]. `rates` (events,): of the gaps, after it.
    - `closed` (events,): which gaps have been closed in the impact, hit or not. `closing`: whether
      some still close after it.
    - `end`, `values`, `wait` (events,): where the step itself ended, the quantities there, and how
      long they would take to their levels.
    """

    t: Float[Array, ""]
    before: Any
    after: Any
    hits: Bool[Array, " events"]
    impulse: Float[Array, " events"]
    work: Float[Array, ""]
    rates: Float[Array, " events"]
    closed: Bool[Array, " events"]
    closing: Bool[Array, ""]
    end: Float[Array, ""]
    values: Float[Array, " events"]
    wait: Float[Array, " events"]

    @property
    def happens(self) -> Bool[Array, ""]:
        """Whether there is an event."""
        return jnp.any(self.hits)


class Cut(NamedTuple):
    """The end `at` which the first event within a step cuts it, if one `is_due`.

    - `lasting`: whether it cannot end so, since a contact lasts.
    """

    is_due: Bool[Array, ""]
    at: Float[Array, ""]
    lasting: Bool[Array, ""]


class AbstractWatch(eqx.Module):
    """One that knows where events lie in steps, and what happens there."""

    @abc.abstractmethod
    def start(self, t: Float[Array, ""], y: Any) -> Watching:
        """Return the state of the watch before the first step."""

    @abc.abstractmethod
    def arrive(
        self, watching: Watching, t0: Float[Array, ""], t1: Float[Array, ""], y: Any
    ) -> Arrival:
        """The end of a step from t0 to t1 in the state `y`, carried to the events in reach."""

    @abc.abstractmethod
    def cut(
        self,
        watching: Watching,
        t0: Float[Array, ""],
        between: diffrax.AbstractLocalInterpolation,
        arrival: Arrival,
    ) -> Cut:
        """The first event within a step, but for those at which it ends."""

    @abc.abstractmethod
    def follow(
        self,
        watching: Watching,
        keep: Bool[Array, ""],
        cut: Cut,
        y0: Any,
        end: Array,
        arrival: Arrival,
    ) -> Watching:
        """Return the state of the watch after a step from `y0` that should have ended at `end`."""

    @abc.abstractmethod
    def is_stopped(self, watching: Watching) -> Bool[Array, ""]:
        """Whether an event ends the run."""


class AbstractPassage(eqx.Module):
    """Places that steps must not pass, but end at: the surfaces of contacts."""

    @abc.abstractmethod
    def held(
        self, term: Any, t0: Float[Array, ""], t1: Float[Array, ""], y: Any
    ) -> tuple[Any, Any, Any]:
        """Return the term of a step from `y`, with laws that hold on the side on which it starts,
        these sides, and whether another law may have held in the step before.
        """

    @abc.abstractmethod
    def passed(
        self,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        sides: Any,
        between: diffrax.AbstractLocalInterpolation,
    ) -> tuple[Bool[Array, ""], Float[Array, ""]]:
        """Whether a step, its laws held on `sides`, passes something, and where it ends instead."""

    @abc.abstractmethod
    def next_end(
        self, t: Float[Array, ""], y: Any, planned: Float[Array, ""], keep: Bool[Array, ""]
    ) -> Float[Array, ""]:
        """Return the time at which the next step from `y` has to end, at most the `planned` one."""
