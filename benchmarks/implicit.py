"""What a step of Rodas5P costs: with derivatives by parts, eliminated along the tree of bodies, and
with those of the whole residual and a dense matrix.
"""

import functools
from collections.abc import Callable, Iterator
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import record
from meshed_arm import meshed_arm
from reduced_scenes import beams
from timing import least

import romjax as rj
from romjax.compiling.program import Program
from romjax.integrate.term import MotionTerm
from romjax.system.dynamics import Linearization, linearize

# Of each scene: how it is made, steps of a run, and their length [s].
SCENES: dict[str, tuple[Callable[[], rj.Scene], int, float]] = {
    "8 rigid bars": (rj.gallery.chain, 200, 1e-4),
    "8 beams": (lambda: beams(8), 200, 1e-4),
    "32 beams": (lambda: beams(32), 50, 1e-4),
    "meshed arm": (meshed_arm, 10, 1e-5),
}
LANES = {"8 beams": 64}
REPEATS = 5


class Whole(MotionTerm):
    """A motion whose derivatives are those of the whole residual."""

    def linearize(self, t: Any, y: Any) -> Linearization:
        return linearize(self.system, jnp.asarray(t), *y, self.stabilization)


def steps(
    kind: type[MotionTerm], solver: Any, count: int, step: float
) -> Callable[[Any, Any, Any], Any]:
    """A compiled run in fixed steps, of a system from q and v."""

    def run(system: Any, q: Any, v: Any) -> Any:
        term = kind(system, rj.Baumgarte(10.0, 25.0) if system.m else None)

        def one(carry: Any, _: None) -> Any:
            t, y, state = carry
            y, _error, _dense, state, _ = solver.step(term, t, t + step, y, None, state, False)
            return (t + step, y, state), None

        start = solver.init(term, 0.0, step, (q, v), None)
        return jax.lax.scan(one, (jnp.zeros(()), (q, v), start), None, length=count)[0][1]

    return Program(run)


def measure() -> Iterator[record.Section]:
    """One table."""
    implicit, explicit = rj.Rodas5P(), diffrax.Dopri8()
    rows = [["scene", "n", "m", "Dopri8 us", "by parts us", "whole us", "first s", "first s"]]
    ratios = {}
    for name, (make, count, step) in SCENES.items():
        system = rj.assemble(make())
        kinds = ((MotionTerm, explicit), (MotionTerm, implicit), (Whole, implicit))
        programs = [steps(*kind, count, step) for kind in kinds]
        calls = [functools.partial(run, system, system.q0, system.v0) for run in programs]
        timed = least(calls, REPEATS, name=name)
        times = [1e6 * one.least / count for one in timed]
        cells = [*(f"{x:.1f}" for x in times), *(f"{one.first:.1f}" for one in timed[1:])]
        rows.append([name, f"{system.n}", f"{system.m}", *cells])
        ratios[f"{name}: whole / by parts"] = times[2] / times[1]
        ratios[f"{name}: Dopri8 / Rodas5P"] = times[0] / times[1]
    for name, lanes in LANES.items():
        make, count, step = SCENES[name]
        system = rj.assemble(make())
        shifts = 1e-6 * np.random.default_rng(0).normal(size=(lanes, 1))
        start = [x + shifts for x in (system.q0, system.v0)]
        programs = [
            Program(jax.vmap(steps(kind, implicit, count, step), in_axes=(None, 0, 0)))
            for kind in (MotionTerm, Whole)
        ]
        timed = least(
            [functools.partial(run, system, *start) for run in programs], REPEATS, name=name
        )
        times = [1e6 * one.least / count / lanes for one in timed]
        cells = ["-", *(f"{x:.1f}" for x in times), *(f"{one.first:.1f}" for one in timed)]
        rows.append([f"{name}, {lanes} lanes, a lane", f"{system.n}", f"{system.m}", *cells])
        ratios[f"{name}, {lanes} lanes: whole / by parts"] = times[1] / times[0]
    yield record.Section(
        "A step in a compiled run of fixed steps, least of "
        f"{REPEATS} interleaved runs: of Dopri8; of Rodas5P with\n"
        "derivatives by parts, as a system takes them where they pay, and of the whole residual;\n"
        "and the first calls of both.",
        rows,
        ratios,
    )


if __name__ == "__main__":
    record.main(measure)
