"""Compiled models within programs of JAX: a run, lanes, cores, `fit` and NUTS."""

import functools
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import diffrax
import jax
import numpy as np
from native_models import TS, cart, on_processor
from timing import least

import romjax as rj

Found = tuple[list[list[str]], dict[str, float]]
LANES, REPEATS = 256, 12
# Of the posterior of a pendulum that comes to rest.
RECORD = np.linspace(0.0, 5.0, 101)
CHAIN = {"num_warmup": 200, "num_samples": 1000}
TRUE = {"length": 0.8, "damping": 0.3}
NOISE = 0.05  # [rad]


def in_jit() -> Found:
    """One run, as a part of a program and by ctypes."""
    model, given = _minimal()
    system = model.system
    alone = jax.jit(lambda q, v: model.simulate(TS, q0=q, v0=v, throw=False, **given).q)
    calls = [lambda: alone(system.q0, system.v0), lambda: model.simulate(TS, **given)]
    inside, outside = least([on_processor(x) for x in calls], REPEATS, name="a run in jit")
    cells = ["a run in jit", *(f"{1e3 * x.least:.3f}" for x in (inside, outside)), "by ctypes"]
    return [cells], {"in jit: by ctypes / native": outside.least / inside.least}


def lanes() -> Found:
    """A batch, of which the times of all threads count."""
    model, given = _minimal()
    batch, starts = _batch(model, given), _starts(model.system)
    traced = rj.jit(
        jax.vmap(
            lambda q, v: (
                rj.simulate(model.system, TS, q0=q, v0=v, audit=False, throw=False, **given).q
            )
        )
    )
    calls = [lambda: batch(*starts), lambda: traced(*starts)]
    one, other = least([on_processor(x) for x in calls], 2, name="a batch")
    cells = [f"{LANES} lanes", *(f"{1e3 * x.least:.2f}" for x in (one, other)), "simulate"]
    return [cells], {f"{LANES} lanes: simulate / native": other.least / one.least}


def cores() -> Found:
    """A batch by one thread and by two; what other programs do counts, too. So, beside it, the
    processor's time of all threads over the largest of one: what free cores would reach.
    """
    model, given = _minimal()
    starts = _starts(model.system)
    everywhere = os.sched_getaffinity(0)
    calls: list[Callable[[], Any]] = []
    for count in (1, 2):
        # The number of threads is that of the processors when a program is traced.
        os.sched_setaffinity(0, sorted(everywhere)[:count])
        try:
            batch = _batch(model, given).lower(*starts).compile()
        finally:
            os.sched_setaffinity(0, everywhere)
        # One after the other: batches that wait for nothing would share the cores.
        calls.append(lambda batch=batch: [jax.block_until_ready(batch(*starts)) for _ in range(10)])
    shares = [_shared(call) for call in calls]
    one, two = least(calls, REPEATS, name="cores", clock=time.perf_counter)
    cells = ["two cores", *(f"{100 * x.least:.2f}" for x in (two, one)), "one core"]
    ratios = {
        f"{LANES} lanes: one core / two": one.least / two.least,
        f"{LANES} lanes: work of all threads / of the busiest": shares[1] / shares[0],
    }
    return [cells], ratios


def _shared(call: Callable[[], Any]) -> float:
    """The processor's time of all threads in a call over the largest of one of them, of those that
    live on: the others end with the call.
    """
    folder = Path("/proc/self/task")
    if not folder.exists():
        return float("nan")

    def each() -> dict[str, int]:
        return {x.name: int((x / "schedstat").read_text().split()[0]) for x in folder.iterdir()}

    before, start = each(), time.process_time()
    call()
    spent = time.process_time() - start
    return spent / max(1e-9 * (now - before.get(name, 0)) for name, now in each().items())


def _minimal() -> tuple[rj.CompiledModel, dict[str, Any]]:
    """A small model, and how it runs."""
    rom = cart(rj.Minimal(), 3)
    usual = rj.simulate(rom, TS, audit=False)
    held = {"solver": usual.solver, "stabilization": usual.stats.stabilization}
    return rj.compile(rom), held


def _batch(model: rj.CompiledModel, given: dict[str, Any]) -> Any:
    return jax.jit(jax.vmap(lambda q, v: model.simulate(TS, q0=q, v0=v, throw=False, **given).q))


def _starts(system: rj.AbstractSystem) -> list[np.ndarray]:
    """Starts near that of a system."""
    rng = np.random.default_rng(0)
    sizes = ((system.q0, 0.003), (system.v0, 0.01))
    return [np.asarray(x) + size * rng.normal(size=(LANES, system.n)) for x, size in sizes]


def fitted() -> Found:
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
    one, other = least([on_processor(call, 1) for call in calls], 2, name="fit")
    off = max(
        abs(one.result.parameters[key] - other.result.parameters[key])
        / other.result.standard_errors[key]
        for key in true
    )
    cells = ["fit", *(f"{x.least:.3f}" for x in (one, other)), f"{float(off):.1e}"]
    return [cells], {"fit: simulate / native": other.least / one.least}


def pendulum(length: Any, damping: Any) -> rj.AbstractSystem:
    """A rigid bar on a hinge with friction, from 1 rad."""
    bar = rj.RigidBody(
        "bar",
        1.0,
        length**2 / 12,
        position=(0.5 * length * np.sin(1.0), -0.5 * length * np.cos(1.0)),
        angle=1.0,
    )
    pin = bar.at((0.0, 0.5 * length)), rj.ground.at()
    hinge = rj.Revolute(*pin, name="hinge")
    return rj.assemble(rj.Scene([bar], [hinge], [rj.Gravity(), rj.TorsionDamper(*pin, damping)]))


def sampled() -> Found:
    """The posterior of length and damping of a pendulum: a thousand samples after the warm-up, and
    all that a user waits for, who starts with nothing compiled.
    """
    import numpyro

    model, held = rj.compile(pendulum, TRUE), rj.Baumgarte.critical(6.0)
    settings = {"solver": diffrax.Dopri8(), "stabilization": held, "throw": False}

    def native(p: Any) -> Any:
        return model.simulate(RECORD, parameters=p, **settings).q[:, 2]

    def usual(p: Any) -> Any:
        return rj.simulate(pendulum(**p), RECORD, audit=False, **settings).q[:, 2]

    measured = np.asarray(native(TRUE)) + NOISE * np.random.default_rng(3).normal(size=len(RECORD))
    spent: list[float] = []  # with all that the sampler does before and besides

    def chain(function: Callable[[Any], Any]) -> Callable[[], Any]:
        def posterior() -> None:
            length = numpyro.sample("length", numpyro.distributions.Normal(0.9, 0.2))
            damping = numpyro.sample("damping", numpyro.distributions.HalfNormal(0.5))
            p = {"length": length, "damping": damping}
            numpyro.factor("record", rj.log_likelihood(function, p, measured, NOISE))

        kernel = numpyro.infer.NUTS(
            posterior,
            forward_mode_differentiation=True,
            init_strategy=numpyro.infer.init_to_value(values=TRUE),
        )
        sampler = numpyro.infer.MCMC(kernel, progress_bar=False, **CHAIN)
        start = time.process_time()
        with rj.forward_mode():
            sampler.warmup(jax.random.key(0))
            sampler.run(jax.random.key(1))
        spent.append(time.process_time() - start)
        warm = sampler.post_warmup_state

        def step(state: Any, _: None) -> Any:
            state = kernel.sample(state, (), {})
            return state, kernel.postprocess_fn((), {})(state.z)

        # The sampler would compile its loop for each call of `run`.
        samples = jax.jit(lambda state: jax.lax.scan(step, state, length=CHAIN["num_samples"])[1])
        with rj.forward_mode():
            return functools.partial(samples.lower(warm).compile(), warm)

    calls = [on_processor(chain(f), 1) for f in (native, usual)]
    one, other = least(calls, 3, name="NUTS")
    means, others = ({k: np.mean(x.result[k]) for k in TRUE} for x in (one, other))
    off = max(abs(means[k] - others[k]) / float(np.std(other.result[k])) for k in TRUE)
    cells = ["NUTS", *(f"{x.least:.2f}" for x in (one, other)), f"{off:.1e}"]
    whole = ["NUTS, compiled and warmed up", *(f"{x:.2f}" for x in spent), "-"]
    ratios = {
        "NUTS: simulate / native": other.least / one.least,
        "NUTS, compiled and warmed up: simulate / native": spent[1] / spent[0],
    }
    return [cells, whole], ratios


INSIDE: dict[str, Callable[[], Found]] = {
    "a run in jit": in_jit,
    f"{LANES} lanes": lanes,
    "two cores": cores,
}
IDENTIFIED: dict[str, Callable[[], Found]] = {"fit": fitted, "NUTS": sampled}
