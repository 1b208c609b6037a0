"""Compiled runs of a model, their errors and their times."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from ...integrate.rodas5p import Rodas5P
from ...integrate.simulate import simulate
from ...integrate.trajectory import Status, Trajectory
from ..compare import compare
from .result import Model, Row

# What needs more steps than this is no way to simulate the scene.
MOST_STEPS = 50_000


@dataclasses.dataclass
class Way:
    """A model with a method, compiled; its runs by tolerance."""

    model: Model
    solver: str
    run: Callable[[float], Trajectory]
    compile: float  # [s]
    memory: int  # [B]
    stages: tuple[int, int]  # right-hand sides and factorisations of a step
    found: dict[float, tuple[float, int, str]]  # error, steps, failure
    times: dict[float, list[float]]  # [s]

    @classmethod
    def of(cls, model: Model, solver: diffrax.AbstractSolver, ts: Any) -> "Way":
        """Compiled for the output times `ts`."""

        def run(rtol):  # type: ignore[no-untyped-def]
            return simulate(
                model.system,
                ts,
                rtol=rtol,
                solver=solver,
                adjoint=diffrax.ForwardMode(),  # no gradient is asked for
                max_steps=MOST_STEPS,
                throw=False,
            )

        begin = time.perf_counter()
        program = jax.jit(run).lower(jnp.asarray(1e-6)).compile()
        took = time.perf_counter() - begin
        sizes = program.memory_analysis()
        memory = sizes.temp_size_in_bytes + sizes.output_size_in_bytes if sizes else 0
        name = type(solver).__name__
        return cls(
            model,
            name,
            lambda rtol: program(jnp.asarray(rtol)),
            took,
            memory,
            _stages(solver),
            {},
            {},
        )

    def look(self, rtol: float, reference: Trajectory) -> None:
        """One run, for its error."""
        motion = self.run(rtol)
        failure = "" if bool(motion.success) else Status(int(motion.status)).name
        error = np.nan if failure else float(compare(reference, motion).error)
        self.found[rtol] = error, int(motion.stats["num_steps"]), failure
        self.times[rtol] = []

    def clock(self, rtol: float) -> float:
        """The time of one run [s]."""
        begin = time.perf_counter()
        jax.block_until_ready(self.run(rtol))
        return time.perf_counter() - begin

    def rows(self) -> list[Row]:
        """What was found, without a front."""
        return [
            Row(
                self.model.name,
                self.model.formulation,
                self.model.rank,
                self.solver,
                rtol,
                error,
                min(self.times[rtol], default=np.nan),
                float(np.median(self.times[rtol])) if self.times[rtol] else np.nan,
                self.compile,
                self.model.offline,
                steps,
                steps * self.stages[0],
                steps * self.stages[1],
                self.memory,
                failure,
                False,
            )
            for rtol, (error, steps, failure) in self.found.items()
        ]


def _stages(solver: diffrax.AbstractSolver) -> tuple[int, int]:
    """Right-hand sides and factorisations of one step; zero where an iteration decides."""
    if isinstance(solver, Rodas5P):
        return 8, 1
    tableau = getattr(solver, "tableau", None)
    if isinstance(solver, diffrax.AbstractERK) and isinstance(tableau, diffrax.ButcherTableau):
        return tableau.num_stages - int(tableau.fsal), 0
    return 0, 0
