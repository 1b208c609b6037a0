"""The progress of a run, shown while it goes."""

from typing import Any

import diffrax
from jaxtyping import Array, Bool, Float

from .follower import AbstractFollower, Step
from .steps import Progress


class ProgressBar(AbstractFollower):
    """A meter of diffrax that shows how much of the time from `t0` to `t1` is done."""

    meter: diffrax.AbstractProgressMeter[Any]
    t0: Float[Array, ""]
    t1: Float[Array, ""]

    def start(self, start: Progress) -> Any:
        del start
        return self.meter.init()

    def follow(self, step: Step, seen: Any) -> Any:
        return self.meter.step(seen, (step.after.t - self.t0) / (self.t1 - self.t0))

    def end(self, end: Progress, stopped: Bool[Array, ""], seen: Any) -> Any:
        del end, stopped
        self.meter.close(seen)
        return seen
