"""The loop over the steps of a run."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import diffrax
import jax
from equinox.internal import unvmap_any
from jaxtyping import Array, PyTree

from .follower import AbstractFollower, Step
from .outputs import Outputs
from .steps import Progress, Steps, Trial

# Keys of `seen`: the outputs, and the other followers that derivatives pass through.
OUTPUTS, EVENTS, DENSE = "outputs", "events", "dense"


class March(NamedTuple):
    """An integration from the first to the last output time, and those who follow it.

    The steps, their acceptance and the outputs are those of `diffrax.diffeqsolve`. What that brings
    beyond them (infinite intervals, say) takes half a second to trace and to compile, a fifth of
    the time to the first result of a small mechanism, and its events change no state.
    The largest number of steps is traced here, so that another one needs no other program.

    In a batch, lanes go on until the last one ends. One that has ended changes nothing any more:
    JAX would choose between all rows of old and new outputs at each step instead.

    - `trial`: computes a step; that of the `steps`, or one that takes its part.
    - `others`: followers by their names. What they see of a step is known to the `outputs`.
    """

    steps: Steps
    trial: Callable[[PyTree, PyTree, Any, Array, Array], Trial]
    outputs: Outputs
    others: Mapping[str, AbstractFollower]

    def before(self, start: Progress) -> dict[str, Any]:
        """Return what the followers have seen before the first step."""
        return {OUTPUTS: self.outputs.start(start)} | {
            name: follower.start(start) for name, follower in self.others.items()
        }

    def run(self, start: Progress, seen: dict[str, Any]) -> tuple[Progress, dict[str, Any]]:
        """Integrate from a start to the end, with what was `seen` before.

        Returns how far the run got, without its last state, since no output is there; and what each
        follower has seen.
        """

        def step(carry: tuple[Progress, dict[str, Any]]) -> tuple[Progress, dict[str, Any]]:
            before, seen = carry
            after, tried = self.steps.attempt(before, self.trial)
            made = Step(before, after, tried, seen)
            others = {name: f.follow(made, seen[name]) for name, f in self.others.items()}
            # Outputs come last, since numbers beside them are what the others have seen with this
            # step.
            outputs = self.outputs.follow(made._replace(seen=others), seen[OUTPUTS])
            return after, others | {OUTPUTS: outputs}

        end, seen = jax.lax.while_loop(
            lambda carry: unvmap_any(self.steps.unfinished(carry[0])), step, (start, seen)
        )
        stopped = self.steps.is_stopped(end)
        exhausted = ~((end.t >= self.steps.t1) | stopped) & diffrax.is_successful(end.result)
        result = diffrax.RESULTS.where(exhausted, diffrax.RESULTS.max_steps_reached, end.result)
        followers = {**self.others, OUTPUTS: self.outputs}
        held = self.steps.is_held(end)
        seen = {name: f.end(end, held, seen[name]) for name, f in followers.items()}
        none: Any = None
        end = end._replace(result=result, y=none, solver_state=none)
        return end, seen
