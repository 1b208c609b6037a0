"""Full runs of a box with their sensitivities, in memory or in a folder that processes share."""

import dataclasses
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import as_number, pick
from ...compiling.program import program
from ...integrate.adjoint import forward_mode
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ..sweeps.sweep import sweep
from .box import Box

Numbers = dict[str, Any]
# A run, what is seen of it, and the derivatives of q, v and that.
Seen = tuple[Trajectory, Array, tuple[Numbers, Numbers, Numbers]]


class FullRuns(eqx.Module):
    """The full runs of a `box` at some `times` [s], what they `see`, and the derivatives by each
    parameter, times half of its range: a function of the parameters.

    `settings`: of `simulate`.
    """

    box: Box = eqx.field(static=True)
    times: Float[Array, " k"]
    see: Callable[[Trajectory], Array] = eqx.field(static=True)
    settings: dict[str, Any]

    def __call__(self, point: Numbers) -> Seen:
        def motion(shares: Numbers) -> tuple[tuple[Array, Array, Array], tuple[Trajectory, Array]]:
            system = self.box.system_anywhere(moved(self.box, point, shares))
            run = simulate(system, self.times, throw=False, **self.settings)
            seen = self.see(run)
            return (run.q, run.v, seen), (run, seen)

        derivatives, (run, seen) = jax.jacfwd(motion, has_aux=True)(still(self.box))
        return run, seen, derivatives

    def at(self, point: dict[str, float], path: str | os.PathLike[str] | None = None) -> Seen:
        """The run at a point, from a folder `path` if it is there: one sweep of one lane for each
        run, of the same function of the box and the same `see`, which are not compared.

        Raises ValueError where the folder has another run in its place.
        """
        where = self.numbers(point)
        with forward_mode():
            if path is None:
                return _made(self, where)
            lane = {name: np.asarray(x)[None] for name, x in where.items()}
            found = sweep(self, lane, chunk=1, path=Path(path) / self.name(where)).values
        made: Seen = jax.tree.map(lambda x: pick(jnp.asarray(x), 0), found)
        return made

    def name(self, where: Numbers) -> str:
        """The folder of a run: of the same point, so that processes share it whatever led there,
        and of the same ranges, with which its derivatives are scaled.
        """
        ranges = self.box.ranges
        numbers = {name: (x, *dataclasses.astuple(ranges[name])) for name, x in where.items()}
        words = " ".join(f"{name} {[float(x) for x in numbers[name]]}" for name in sorted(numbers))
        return f"run-{hashlib.sha256(words.encode()).hexdigest()[:16]}"

    def numbers(self, point: dict[str, float]) -> Numbers:
        return {name: as_number(x, self.times.dtype) for name, x in point.items()}


@program
def _made(runs: FullRuns, point: Numbers) -> Seen:
    return runs(point)


def still(box: Box) -> Numbers:
    """Shares of the half range of each parameter that move nothing."""
    return {name: jnp.zeros(()) for name in box.ranges}


def moved(box: Box, point: Numbers, shares: Numbers) -> Numbers:
    """A point that is moved by shares of half the range of each parameter."""
    return {name: box.ranges[name].moved(point[name], x) for name, x in shares.items()}
