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
    yield inside()
    yield fitted()


LANES = 256


def inside() -> record.Section:
    """Within programs of JAX: one run, and a batch, of which the times of all threads count."""
    rom = cart(rj.Minimal(), 3)
    model, usual = rj.compile(rom), rj.simulate(rom, TS, audit=False)
    settings = {"solver": usual.solver, "stabilization": usual.stats.stabilization}
    given = {"throw": False, **settings}
    outside = lambda: model.simulate(TS, **settings)  # noqa: E731
    alone = jax.jit(lambda q, v: model.simulate(TS, q0=q, v0=v, **given).q)
    batch = jax.jit(jax.vmap(lambda q, v: model.simulate(TS, q0=q, v0=v, **given).q))
    lanes = rj.jit(jax.vmap(lambda q, v: rj.simulate(rom, TS, q0=q, v0=v, audit=False, **given).q))
    rng = np.random.default_rng(0)
    starts = [
        np.asarray(x) + size * rng.normal(size=(LANES, rom.n))
        for x, size in ((rom.q0, 0.003), (rom.v0, 0.01))
    ]
    calls = [outside, lambda: alone(rom.q0, rom.v0)]
    called, jitted = least([on_processor(call) for call in calls], REPEATS, name="a run in jit")
    calls = [lambda: batch(*starts), lambda: lanes(*starts)]
    native, traced = least([on_processor(call) for call in calls], 3, name="a batch")
    rows = [["", "compiled, ms", "by ctypes, or by simulate, ms"]]
    for name, one, other in (("a run in jit", jitted, called), ("256 lanes", native, traced)):
        rows.append([name, f"{1e3 * one.least:.3f}", f"{1e3 * other.least:.3f}"])
    return record.Section(
        "The cart's minimal model of rank 3 within jit, and 256 starts of it under vmap:",
        rows,
        {
            "in jit: by ctypes / native": called.least / jitted.least,
            "256 lanes: simulate / native": traced.least / native.least,
        },
    )


def fitted() -> record.Section:
    """Stiffness and damping of the cart from noisy measurements of three coordinates."""

    def make(stiffness: Any, damping: Any) -> rj.AbstractSystem:
        return rj.assemble(rj.gallery.cart_pendulum(stiffness=stiffness, damping=damping))

    true, start = {"stiffness": 100.0, "damping": 0.1}, {"stiffness": 80.0, "damping": 0.2}
    model, held = rj.compile(make, true), rj.Baumgarte.critical(6.0)
    settings = {"solver": rj.Rodas5P(), "stabilization": held, "throw": False}
    seen = np.array([0, 5, 6])

    def native(p: Any) -> Any:
        return model.simulate(TS, parameters=p, **settings).q[:, seen]

    def usual(p: Any) -> Any:
        return rj.simulate(make(**p), TS, audit=False, **settings).q[:, seen]

    clean = np.asarray(native(true))
    noise = 0.01 * np.std(clean, axis=0)
    measured = clean + noise * np.random.default_rng(0).normal(size=clean.shape)
    calls = [lambda f=f: rj.fit(f, start, measured, noise=noise) for f in (native, usual)]
    for call in calls:
        call()
    one, other = least([on_processor(call) for call in calls], 3, name="fit")
    off = max(
        abs(one.result.parameters[key] - other.result.parameters[key])
        / other.result.standard_errors[key]
        for key in true
    )
    rows = [["", "compiled, s", "simulate, s", "differ, in standard errors"]]
    rows.append(["fit", f"{one.least:.3f}", f"{other.least:.3f}", f"{float(off):.1e}"])
    return record.Section(
        "Two parameters of the full cart by `fit`, the programs compiled before:",
        rows,
        {"fit: simulate / native": other.least / one.least},
    )


if __name__ == "__main__":
    record.main(measure)
