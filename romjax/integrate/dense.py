"""Dense output: a run between its outputs."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Vector, as_array, concrete
from ..common.checks import check_finite, check_shape
from ..common.errors import InputError
from ..common.partition import Partitioned
from ..compiling.program import program
from ..march.interpolations import Interpolations
from ..reduction.system import has_charts
from ..system.base import AbstractSystem
from ..system.consistent import project
from ..system.stabilization import Baumgarte, Projection, Stabilization
from ..system.structure import without_names
from .chart_change import ChartChange
from .derived import LazyQuantities
from .outputs import Output, capacity, cut, output_at, padded
from .post_step import PostStep, ProjectState
from .ticks import Ticking, ticks


def post_step_of(system: AbstractSystem, projection: Projection | None) -> PostStep | None:
    """Return the object that changes the state after each step; None if nothing does."""
    post_step: PostStep | None = ChartChange.of(system) if has_charts(system) else None
    if projection is not None:
        post_step = ProjectState(projection.sweeps)
    return Ticking(post_step) if ticks(system) else post_step


def output_of(
    system: AbstractSystem, projection: Projection | None
) -> Callable[[Float[Array, ""], Any], Output]:
    """Return the function of a time and a state that gives the output to save."""
    post_step = post_step_of(system, projection)

    def output(t: Array, y: Any) -> Output:
        if projection is not None:
            # Between steps, dense output leaves the constraints by about 1e-6.
            q, v = y
            y = project(system, t, q, v, projection.sweeps)
        saved: Output = output_at(system, post_step, t, y)
        return saved

    return output


class DenseOutput(eqx.Module):
    """A run between its outputs, by the interpolation of its method.

    - `parts`: of the system, with its names. `stabilization`: that was used. `start`: when the run
      starts [s].
    """

    parts: Partitioned
    stabilization: Stabilization
    start: Float[Array, ""]
    interpolations: Interpolations

    def at(self, times: Vector) -> tuple[Float[Array, " k"], Output, LazyQuantities]:
        """The `times` as an array, the outputs there, and what follows from them.

        Raises InputError for times before the start or after the end of the run.
        """
        ts = as_array(times)
        check_shape("Trajectory.at", "times", ts, (None,))
        if not len(ts):
            raise InputError("Trajectory.at: times has no entries; give those that are asked for.")
        check_finite("Trajectory.at", "times", ts)
        if self.start.ndim:
            raise InputError(
                "Trajectory.at: this is a batch of runs; map over it, as in "
                "jax.vmap(lambda run: run.at(times))(runs)."
            )
        end = self.interpolations.ends[self.interpolations.number - 1]
        outside = (ts < self.start) | (ts > end)
        known = concrete(outside)
        if known is None:
            ts = eqx.error_if(ts, outside, "Trajectory.at: a time lies outside of the run.")
        elif np.any(known):
            raise InputError(
                f"Trajectory.at: times[{int(np.argmax(known))}] = "
                f"{float(ts[int(np.argmax(known))]):g} s lies outside of the run, from "
                f"{float(self.start):g} to {float(end):g} s."
            )
        system, count = without_names(self.parts.combine()), len(ts)
        projection = self.stabilization if isinstance(self.stabilization, Projection) else None
        # Rows up to the next power of two share a program, as outputs do.
        size = capacity(count, 2 * system.full.n, ts.dtype)
        rows = ts if size == count or known is None else padded(ts, size)
        outputs = cut(_evaluated(system, projection, self.interpolations, rows), count)
        own = outputs.in_system()
        used = self.stabilization if isinstance(self.stabilization, Baumgarte) else None
        return ts, outputs, LazyQuantities(self.parts, ts, own.q, own.v, own.chart, used)


@program
def _evaluated(
    system: AbstractSystem,
    projection: Projection | None,
    interpolations: Interpolations,
    ts: Float[Array | np.ndarray, " k"],
) -> Output:
    output = output_of(system, projection)

    def at(t: Array) -> Output:
        # The end of a step has the state of that step: the one before an impact.
        i = jnp.searchsorted(interpolations.ends, t)
        within = jax.tree.map(lambda x: x[i], interpolations.between)
        return output(t, within.evaluate(t))

    outputs: Output = jax.lax.map(at, jnp.asarray(ts))
    return outputs
