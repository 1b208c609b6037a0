"""A model with a method, compiled: its runs, their errors and their times."""

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...compiling.program import Program
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem
from ...system.structure import without_names
from ..timing import timed
from .model import Model
from .outcome import Outcome, outcome_of, work_of_a_step
from .row import SINGLE_RUN, Condition, Row

# A run that needs more steps than this counts as failed.
MOST_STEPS = 50_000
# [s] A run that takes longer is timed once.
SLOW = 2.0
# [s] A shorter run notices which caches the run before it has filled.
SHORT = 0.1
# The settings of lanes that run at once reach from one over this to this times the one in the
# middle, so that each takes steps of its own, as variants of a scene do.
_SPREAD = 1.2


@dataclasses.dataclass(eq=False)
class Configuration:
    """A model, a method and a condition; its runs by tolerance or, with `fixed`, by step."""

    model: Model
    solver: diffrax.AbstractSolver[Any]
    condition: Condition
    fixed: bool
    run: Callable[[float], Trajectory]
    compile_time: float  # [s]
    memory: int  # [B]
    outcomes: dict[float, Outcome] = dataclasses.field(default_factory=dict)
    times: dict[float, list[float]] = dataclasses.field(default_factory=dict)  # [s] of one lane

    @classmethod
    def compiled(
        cls,
        model: Model,
        solver: diffrax.AbstractSolver[Any],
        ts: Any,
        condition: Condition = SINGLE_RUN,
        fixed: bool = False,
    ) -> "Configuration":
        """Compile a configuration for the output times `ts`."""
        single, lanes = condition.precision == "f32", condition.lanes
        with jax.enable_x64(not single), warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Simulating in single precision")  # as asked for
            inputs = (without_names(model.system), ts)
            system, times = jax.tree.map(_single, inputs) if single else inputs
            spread = np.geomspace(1 / _SPREAD, _SPREAD, lanes) if lanes > 1 else np.ones(())
            spread = np.asarray(spread, times.dtype)
            compiled, compile_time = timed(
                lambda: _program.compiled(system, times, solver, fixed, spread)
            )
        sizes = compiled.memory_analysis()
        memory = sizes.temp_size_in_bytes + sizes.output_size_in_bytes if sizes else 0

        def run(setting: float) -> Trajectory:
            with jax.enable_x64(not single):
                # An array, also of one number: what is none would be compiled in.
                settings = np.asarray(spread * setting, spread.dtype)
                motion: Trajectory = _program(system, times, solver, fixed, settings)
            return motion

        return cls(model, solver, condition, fixed, run, compile_time, memory)

    @property
    def method(self) -> str:
        """The name of its solver."""
        return type(self.solver).__name__

    def evaluate(self, setting: float, reference: Trajectory) -> None:
        """Run once for the error, and for a first time."""
        motion, duration = timed(lambda: self.run(setting))
        outcome = outcome_of(motion, reference)
        once = outcome.failure or duration > SLOW
        least = duration / self.condition.lanes if once else self.time_run(setting)
        self.outcomes[setting], self.times[setting] = outcome, [least]

    def time_run(self, setting: float) -> float:
        """The time of a run [s]; of one lane, if several run at once.

        Of a short run the second of two, so that what ran before does not count.
        """
        _, duration = timed(lambda: self.run(setting))
        if duration <= SHORT:
            _, duration = timed(lambda: self.run(setting))
        return duration / self.condition.lanes

    def rows(self) -> list[Row]:
        """Return the measured rows, without a front."""
        evaluations, factorizations = work_of_a_step(self.solver)
        return [
            Row(
                model=self.model.name,
                formulation=self.model.formulation,
                rank=self.model.rank,
                solver=self.method,
                rtol=np.nan if self.fixed else setting,
                dt=setting if self.fixed else np.nan,
                precision=self.condition.precision,
                lanes=self.condition.lanes,
                error=outcome.error,
                least=min(self.times[setting]),
                median=float(np.median(self.times[setting])),
                compile=self.compile_time,
                offline=self.model.offline,
                steps=outcome.steps,
                evaluations=outcome.steps * evaluations,
                factorizations=outcome.steps * factorizations,
                memory=self.memory,
                failure=outcome.failure,
                pareto=False,
            )
            for setting, outcome in self.outcomes.items()
        ]


def _single(x: Any) -> Any:
    """Convert a floating-point array to single precision; other leaves stay as they are."""
    return jnp.asarray(x, jnp.float32) if eqx.is_inexact_array_like(x) else x


def _runs(
    system: AbstractSystem,
    times: Float[Array, " k"],
    solver: diffrax.AbstractSolver[Any],
    fixed: bool,
    settings: Float[Array | np.ndarray, "*lanes"],
) -> Trajectory:
    """A run for each of the `settings`, which are steps, or tolerances."""

    def one(setting: Any) -> Trajectory:
        return simulate(
            system,
            times,
            solver=solver,
            max_steps=MOST_STEPS,
            throw=False,
            **{"dt" if fixed else "rtol": setting},
        )

    runs: Trajectory = (jax.vmap(one) if jnp.ndim(settings) else one)(jnp.asarray(settings))
    return runs


_program = Program(_runs)
