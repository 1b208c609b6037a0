"""Followers of a run that users write: monitors."""

import abc
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ...common.checks import check_kind
from ...common.errors import InputError
from ...march.follower import AbstractFollower, Step
from ...march.steps import Progress, chosen
from ...system.base import AbstractSystem
from ...system.local import local_system
from ..post_step import PostStep


class Moment(NamedTuple):
    """A state of the mechanism.

    - `t` [s]: when. `q`, `v` (n,): physical coordinates and their rates.
    """

    t: Float[Array, ""]
    q: Float[Array, " n"]
    v: Float[Array, " n"]


class MonitoredStep(NamedTuple):
    """An accepted step of a run.

    - `system`: the mechanism in physical coordinates; of a reduced one, the full one.
    - `before`, `after`: its ends, the second one after what happens at an event there.
    - `at`: the motion within the step, a function of the time [s].
    """

    system: AbstractSystem
    before: Moment
    after: Moment
    at: Callable[[Float[Array, ""]], Moment]


class AbstractMonitor(eqx.Module):
    """Follows a run step by step, for a largest force, a first passage or a histogram.

    A subclass has two methods, traced with the run. What they return is a pytree of arrays, whose
    shapes and types stay as `start` has them. It is in `Trajectory.followed` at the end.
    It has derivatives in both modes, with the lengths of steps as constants. In reverse mode each
    step is transposed; where `follow` has what JAX does not transpose, as a `while_loop`, say
    `is_transposed = False` in the class: then derivatives of its findings are refused in that mode.
    """

    is_transposed: ClassVar[bool] = True

    @abc.abstractmethod
    def start(self, system: AbstractSystem, start: Moment) -> PyTree:
        """Return the findings before the first step."""

    @abc.abstractmethod
    def follow(self, step: MonitoredStep, seen: PyTree) -> PyTree:
        """The same with an accepted step, from what was `seen` before it."""


class MonitorFollower(AbstractFollower):
    """A monitor in a run of a system, whose states are those of the integration."""

    system: AbstractSystem
    post_step: PostStep | None
    monitor: AbstractMonitor

    calls_users: ClassVar[bool] = True

    @property
    def is_transposed(self) -> bool:
        return self.monitor.is_transposed

    def start(self, start: Progress) -> PyTree:
        moment = self._moment(start.t, start.y)
        return jax.tree.map(jnp.asarray, self.monitor.start(self.system.full, moment))

    def follow(self, step: Step, seen: PyTree) -> PyTree:
        before, after, between = step.before, step.after, step.tried.between
        monitored = MonitoredStep(
            system=self.system.full,
            before=self._moment(before.t, before.y),
            after=self._moment(after.t, after.y),
            at=lambda t: self._moment(t, between.evaluate(t)),
        )
        # Computed for steps that were rejected too, and then not taken: lanes of a batch differ in
        # which these are.
        new = _alike(self.monitor, self.monitor.follow(monitored, seen), seen)
        return chosen(step.kept, new, seen)

    def _moment(self, t: Float[Array, ""], y: Any) -> Moment:
        q, v = y[:2]
        system = local_system(self.system, self.post_step, y)
        if system.full is system:
            return Moment(t, q, v)
        state = system.state(t, q, v)
        return Moment(t, state.q, state.v)


def check_monitors(follow: Sequence[AbstractMonitor]) -> tuple[AbstractMonitor, ...]:
    """Return the monitors as a tuple; raise InputError for what is no monitor."""
    for index, monitor in enumerate(follow):
        remedy = "an object of a subclass of romjax.AbstractMonitor"
        check_kind("simulate", f"follow[{index}]", monitor, AbstractMonitor, remedy)
    return tuple(follow)


def _alike(monitor: AbstractMonitor, new: PyTree, old: PyTree) -> PyTree:
    """Return the new findings; raise InputError unless they have the shapes of the old ones."""
    new = jax.tree.map(jnp.asarray, new)
    shapes = [jax.tree.map(lambda x: f"{x.dtype}{list(x.shape)}", each) for each in (new, old)]
    if shapes[0] != shapes[1]:
        raise InputError(
            f"simulate: {type(monitor).__name__}.follow returns {shapes[0]}, and what was seen "
            f"before is {shapes[1]}; both must have the same structure, shapes and types."
        )
    return new
