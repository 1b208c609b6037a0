"""Compiled runs of a model, their errors and their times."""

import dataclasses
import time
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...integrate.rodas5p import Rodas5P
from ...integrate.simulate import simulate
from ...integrate.trajectory import Status, Trajectory
from ..compare import compare
from .result import ALONE, Condition, Model, Row

# What needs more steps than this is no way to simulate the scene.
MOST_STEPS = 50_000
# [s] What takes longer is timed once.
SLOW = 2.0
# [s] A shorter run notices caches that another way's has used.
SHORT = 0.1
# The settings of lanes that run at once reach from one over this to this times the one in the
# middle, so that each takes steps of its own, as variants of a scene do.
_SPREAD = 1.2


class Found(NamedTuple):
    """What a run was like."""

    error: float  # of the worst lane; NaN where one failed
    history: np.ndarray  # (k,) of the first lane, at each output time
    steps: int
    failure: str


@dataclasses.dataclass(eq=False)
class Way:
    """A model with a method, compiled; its runs by tolerance or, with `fixed`, by step."""

    model: Model
    solver: diffrax.AbstractSolver
    condition: Condition
    fixed: bool
    run: Callable[[float], Trajectory]
    compile: float  # [s]
    memory: int  # [B]
    found: dict[float, Found] = dataclasses.field(default_factory=dict)
    times: dict[float, list[float]] = dataclasses.field(default_factory=dict)  # [s] of one lane

    @classmethod
    def of(
        cls,
        model: Model,
        solver: diffrax.AbstractSolver,
        ts: Any,
        condition: Condition = ALONE,
        fixed: bool = False,
    ) -> "Way":
        """Compiled for the output times `ts`."""
        single, lanes = condition.precision == "f32", condition.lanes
        with jax.enable_x64(not single), warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Simulating in single precision")  # as asked for
            system, times = (
                jax.tree.map(_single, (model.system, ts)) if single else (model.system, ts)
            )
            # Arguments, so that the compiler knows no more of their numbers than in other runs.
            numbers, rest = eqx.partition(system, eqx.is_array)

            def one(numbers, setting):  # type: ignore[no-untyped-def]
                return simulate(
                    eqx.combine(numbers, rest),
                    times,
                    solver=solver,
                    adjoint=diffrax.ForwardMode(),  # no gradient is asked for
                    max_steps=MOST_STEPS,
                    throw=False,
                    **{"dt" if fixed else "rtol": setting},
                )

            spread = np.geomspace(1 / _SPREAD, _SPREAD, lanes) if lanes > 1 else np.ones(())
            spread = np.asarray(spread, times.dtype)
            every = jax.vmap(one, (None, 0)) if lanes > 1 else one
            begin = time.perf_counter()
            program = jax.jit(every).lower(numbers, spread).compile()
            took = time.perf_counter() - begin
        sizes = program.memory_analysis()
        memory = sizes.temp_size_in_bytes + sizes.output_size_in_bytes if sizes else 0

        def run(setting: float) -> Trajectory:
            return program(numbers, jnp.asarray(spread * spread.dtype.type(setting)))

        return cls(model, solver, condition, fixed, run, took, memory)

    @property
    def method(self) -> str:
        """Its name."""
        return type(self.solver).__name__

    def look(self, setting: float, reference: Trajectory) -> None:
        """One run, for its error, and a time."""
        begin = time.perf_counter()
        motion = jax.block_until_ready(self.run(setting))
        took = time.perf_counter() - begin
        found = _found(motion, reference)
        once = found.failure or took > SLOW
        least = took / self.condition.lanes if once else self.clock(setting)
        self.found[setting], self.times[setting] = found, [least]

    def clock(self, setting: float) -> float:
        """The time of a run [s]; of one lane, if several run at once.

        Of a short run the second of two, so that what ran before does not count.
        """
        for _ in range(2):
            begin = time.perf_counter()
            jax.block_until_ready(self.run(setting))
            took = time.perf_counter() - begin
            if took > SHORT:
                break
        return took / self.condition.lanes

    def rows(self) -> list[Row]:
        """What was found, without a front."""
        evaluations, factorizations = _stages(self.solver)
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
                error=found.error,
                least=min(self.times[setting]),
                median=float(np.median(self.times[setting])),
                compile=self.compile,
                offline=self.model.offline,
                steps=found.steps,
                evaluations=found.steps * evaluations,
                factorizations=found.steps * factorizations,
                memory=self.memory,
                failure=found.failure,
                pareto=False,
            )
            for setting, found in self.found.items()
        ]


def _single(x: Any) -> Any:
    """Of floating-point arrays, those in single precision."""
    return jnp.asarray(x, jnp.float32) if eqx.is_inexact_array_like(x) else x


def _found(motion: Trajectory, reference: Trajectory) -> Found:
    """The errors of a motion, or of several at once."""
    wide = eqx.tree_at(lambda run: run.q, motion, jnp.asarray(motion.q, reference.q.dtype))
    status = np.ravel(motion.status)
    steps = round(float(np.mean(motion.stats.num_steps)))
    failed = status[status != Status.SUCCESS]
    if failed.size:
        blank = np.full(len(reference.t), np.nan)
        return Found(np.nan, blank, steps, Status(int(failed[0])).name)
    every = jax.vmap(compare, (None, 0)) if motion.q.ndim > reference.q.ndim else compare
    root = np.linalg.cholesky(reference.metric)
    first = np.reshape(motion.q, (-1, *reference.q.shape))[0]
    apart, reach = (
        np.linalg.norm(difference @ root, axis=1)
        for difference in (first - reference.q, reference.q - reference.q[:1])
    )
    error = float(np.max(every(reference, wide).error))
    return Found(error, apart / (np.max(reach) or 1.0), steps, "")


def _stages(solver: diffrax.AbstractSolver) -> tuple[int, int]:
    """Right-hand sides and factorisations of one step; zero where an iteration decides."""
    if isinstance(solver, Rodas5P):
        return 8, 1
    tableau = getattr(solver, "tableau", None)
    if isinstance(solver, diffrax.AbstractERK) and isinstance(tableau, diffrax.ButcherTableau):
        return tableau.num_stages - int(tableau.fsal), 0
    return 0, 0
