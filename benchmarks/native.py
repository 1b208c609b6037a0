"""Compiled models: whole runs by native code against `simulate`, at the same steps and errors.

Times are those of a processor, so that other programs on the machine do not count; calls take
turns.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np
import record
from timing import Timed, least

import romjax as rj

TS = np.linspace(0.0, 1.0, 101)
REPEATS, CALLS = 15, 5
TIGHT = 1e-10


def cart(formulation: Any, rank: int) -> rj.AbstractSystem:
    """A model of the cart with a flexible pendulum."""
    system = rj.assemble(rj.gallery.cart_pendulum())
    truth = rj.simulate(system, TS, rtol=1e-8, audit=False)
    return rj.reduce(system, rj.pod(truth, rank=rank), formulation)


MODELS: dict[str, Callable[[], rj.AbstractSystem]] = {
    "cart, minimal r = 3": lambda: cart(rj.Minimal(), 3),
    "cart, galerkin r = 5": lambda: cart(rj.Galerkin(), 5),
    "cart, full": lambda: rj.assemble(rj.gallery.cart_pendulum()),
    "chain of 1": lambda: rj.assemble(rj.gallery.chain(1)),
    "chain of 8": lambda: rj.assemble(rj.gallery.chain(8)),
    "spinning top": lambda: rj.assemble(rj.gallery.spinning_top()),
}


def on_processor(call: Callable[[], Any]) -> Callable[[], Timed]:
    """A call that clocks itself by the time of the processor."""

    def clocked() -> Timed:
        start = time.process_time()
        for _ in range(CALLS):
            result = jax.block_until_ready(call())
        return Timed(result, (time.process_time() - start) / CALLS)

    return clocked


def error(run: rj.Trajectory, reference: rj.Trajectory) -> float:
    """The largest error of positions and velocities, relative to the largest of them."""
    one, other = (np.concatenate([np.asarray(x.q), np.asarray(x.v)]) for x in (run, reference))
    return float(np.max(np.abs(one - other)) / np.max(np.abs(other)))


def measure() -> Iterator[record.Section]:
    """One table for all models, at rtol = 1e-6."""
    rows = [
        ["model", "n", "operations", "steps", "error", "of simulate", "ms", "simulate", "first s"]
    ]
    ratios = {}
    for name, make in MODELS.items():
        system = make()
        start = time.perf_counter()
        model = rj.compile(system)
        run = model.simulate(TS)
        first = time.perf_counter() - start
        usual = rj.simulate(system, TS, audit=False)
        held = usual.stats.stabilization
        settings = {"solver": usual.solver, "stabilization": held, "audit": False}
        reference = rj.simulate(system, TS, rtol=TIGHT, **settings)
        calls = [lambda m=model: m.simulate(TS), lambda s=system: rj.simulate(s, TS, audit=False)]
        native, jitted = least([on_processor(call) for call in calls], REPEATS, name=name)
        errors = error(run, reference), error(usual, reference)
        most = max(model.operations.values())
        times = native.least, jitted.least
        rows.append(
            [name, system.n, most, int(run.stats.num_steps)]
            + [f"{x:.1e}" for x in errors]
            + [f"{1e3 * x:.3f}" for x in times]
            + [f"{first:.1f}"]
        )
        ratios[f"{name}: simulate / native"] = times[1] / times[0]
        ratios[f"{name}: 2 x error of simulate / native"] = 2 * errors[1] / errors[0]
    yield record.Section(
        "Runs of 1 s with 101 outputs at rtol = 1e-6, by the default method; times of a processor\n"
        "[ms], simulate without its audit; the first run with emission and the C compiler [s]:",
        rows,
        ratios,
    )


if __name__ == "__main__":
    record.main(measure)
