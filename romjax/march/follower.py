"""Followers of the steps of a march, which see what happens on its way."""

import abc
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, PyTree

from .steps import Progress, Trial


class Step(NamedTuple):
    """A step of a march, as its followers see it.

    - `before`, `after`: how far the run is. `tried`: what was computed for the step.
    - `seen`: what the followers, by their names, had seen before it; to the outputs, what the
      others have seen with it.
    """

    before: Progress
    after: Progress
    tried: Trial
    seen: Mapping[str, Any]

    @property
    def kept(self) -> Bool[Array, ""]:
        """Whether the step was accepted."""
        return self.after.accepted > self.before.accepted


class AbstractFollower(eqx.Module):
    """One that follows the steps of a march; what it has seen comes out at the end.

    That is a pytree of arrays whose shapes never change. Derivatives in forward mode pass through
    all of them; in reverse mode the rows of outputs, of events and of dense output have some.

    - `calls_users`: whether `follow` calls functions of users, which may close over numbers that
      are differentiated.
    """

    calls_users: ClassVar[bool] = False

    @property
    def is_transposed(self) -> bool:
        """Whether reverse mode passes through `follow`, which then looks at nothing but the states
        and times at both ends of a step, and at the motion between them.

        Elsewhere what was seen is a constant, whose derivatives are refused.
        """
        return False

    @abc.abstractmethod
    def start(self, start: Progress) -> PyTree:
        """Return what the follower has seen before the first step."""

    @abc.abstractmethod
    def follow(self, step: Step, seen: PyTree) -> PyTree:
        """Return `seen` with a step added; the step says whether it was accepted."""

    def end(self, end: Progress, stopped: Bool[Array, ""], seen: PyTree) -> PyTree:
        """Return `seen` after the last step; `stopped`: whether a `Stop` has ended it."""
        del end, stopped
        return seen
