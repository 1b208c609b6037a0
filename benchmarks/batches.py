"""Many cart-pendulums at once: trajectories per second, full and reduced, with their errors; on one
core, then by the number of lanes and of devices. Writes `batches.txt` beside this file.

Where JAX finds a GPU, it is measured instead, up to a million lanes.
"""

import functools
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import record
from equal_error import at_error
from timing import least

import romjax as rj

LANES = 256
REPEATS = 5
SLOW = 4.0  # [s] what takes longer is measured once
CHECKED = 16  # lanes that are compared with the reference
PLAIN: dict[str, Any] = {"adjoint": diffrax.ForwardMode(), "throw": False, "max_steps": 20_000}

# Formulation, rank, method.
Model = tuple[str, int, str]
FULL, GALERKIN, MINIMAL = (
    ("full", 8, "Rodas5P"),
    ("galerkin", 5, "Dopri8"),
    ("minimal", 3, "Dopri8"),
)
KVAERNO5 = ("full", 8, "Kvaerno5")
PRECISION = {
    KVAERNO5: (1e-6, 1e-7),  # takes minutes at 1e-8
    FULL: (1e-5, 1e-6, 1e-7, 1e-8),
    GALERKIN: (1e-6, 1e-7, 1e-8),
    MINIMAL: (1e-6, 1e-7, 1e-8),
}
ERROR = 5e-6  # at which the models are compared
RATE = 1e-6  # relative tolerance of the other tables
# By which a user compiles a batch of so many lanes, with these tolerances.
COMPILED = {
    ("rj.jit", FULL, LANES): PRECISION[FULL][:2],
    ("jax.jit", FULL, LANES): (RATE,),
    ("jax.jit", KVAERNO5, LANES // 4): PRECISION[KVAERNO5],
}
COUNTS = {"cpu": (1, 16, 256, 2048), "gpu": (1, 16, 256, 4096, 65_536, 1_000_000)}


def system(force: Any) -> rj.system.base.AbstractSystem:
    """The chapter's cart-pendulum with another force [N]."""
    return rj.assemble(rj.gallery.cart_pendulum(force=force))


def lane(model: Model) -> Callable[[Any, Any], rj.Trajectory]:
    """A function of the tolerance and the force [N]. Reduced models share a basis, from the run
    with the largest force, and all that was decided.
    """
    kind, rank, method = model
    solver = getattr(rj, method, None) or getattr(diffrax, method)
    ts = jnp.linspace(0.0, 1.0, 101)
    if kind != "full":
        basis = rj.pod(rj.simulate(system(15.0), ts, rtol=1e-10, **PLAIN), rank=rank)
        rom = rj.reduce(system(10.0), basis, kind)

    def run(rtol: Any, force: Any) -> rj.Trajectory:
        mechanism = system(force)
        if kind != "full":
            mechanism = rom.with_full(mechanism)
        return rj.simulate(mechanism, ts, rtol=rtol, solver=solver(), **PLAIN)

    return run


def forces(lanes: int) -> np.ndarray:
    """Amplitudes [N] of all lanes."""
    return np.linspace(5.0, 15.0, lanes)


def precision() -> list[list[Any]]:
    """Model, tolerance, error, numbers of steps and rate of each model at each tolerance."""
    amplitudes, some = jnp.asarray(forces(LANES)), slice(None, None, LANES // CHECKED)
    reference = jax.vmap(functools.partial(lane(FULL), 1e-11))(amplitudes[some])
    cases, calls = [], []
    for model, tolerances in PRECISION.items():
        batch = jax.jit(jax.vmap(lane(model), (None, 0)))
        cases += [(model, rtol) for rtol in tolerances]
        calls += [functools.partial(batch, rtol, amplitudes) for rtol in tolerances]
    rows = []
    for (model, rtol), timed in zip(cases, least(calls, REPEATS, SLOW, "errors"), strict=True):
        found = timed.result
        error = jax.vmap(rj.compare)(reference, jax.tree.map(lambda x: x[some], found)).error
        steps = found.stats.num_steps
        row = [rtol, float(jnp.max(error)), f"{steps.min()}-{steps.max()}"]
        rows.append([list(model), *row, LANES / timed.least])
    return rows


def compiled() -> list[list[Any]]:
    """How, model, lanes, tolerance and rate [1/s of a processor], without flags for the process."""
    rows = []
    for (how, model, lanes), tolerances in COMPILED.items():
        batch = (rj.jit if how == "rj.jit" else jax.jit)(jax.vmap(lane(model), (None, 0)))
        for rtol in tolerances:
            taken = []
            for _ in range(3):
                start = time.process_time()
                jax.block_until_ready(batch(rtol, jnp.asarray(forces(lanes))))
                taken.append(time.process_time() - start)
                if taken[-1] > SLOW and len(taken) > 1:
                    break
            rows.append([how, list(model), lanes, rtol, lanes / min(taken[1:])])
    return rows


def rates(settings: list[tuple[int, int]]) -> list[list[Any]]:
    """Model and rates of its sweeps, by lanes and lanes of a chunk."""

    def sweep(run: Callable, lanes: int, chunk: int) -> None:
        jax.block_until_ready(rj.sweep(run, forces(lanes), chunk=chunk))  # too large to be kept

    rows = []
    for model in (FULL, GALERKIN, MINIMAL):
        run = functools.partial(lane(model), RATE)
        calls = [functools.partial(sweep, run, lanes, chunk) for lanes, chunk in settings]
        times = [one.least for one in least(calls, REPEATS, SLOW, model[0])]
        found = [lanes / taken for (lanes, _), taken in zip(settings, times, strict=True)]
        rows.append([list(model), *found])
    return rows


def of(what: str) -> Any:
    """One table, in a process of its own."""
    if what != "compiled":
        rj.speed_up_xla()
    jax.config.update("jax_enable_x64", True)
    device = jax.devices()[0]
    if what == "device":
        return [device.platform, device.device_kind]
    if what == "precision":
        return precision()
    if what == "compiled":
        return compiled()
    if what == "lanes":
        own = LANES if device.platform == "cpu" else max(COUNTS["gpu"])
        return rates([(count, min(count, own)) for count in COUNTS[device.platform]])
    # An odd number of lanes stays on one device.
    return rates([(8 * (LANES - 1), LANES - 1), (8 * LANES, 2 * LANES)])


def child(what: str, cores: int = 1, devices: int = 1) -> Any:
    """`of` where JAX sees so many cores and, of a CPU, devices."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    done = subprocess.run(
        [sys.executable, __file__, "--table", what],
        env={**os.environ, "XLA_FLAGS": flags},
        preexec_fn=lambda: os.sched_setaffinity(0, allowed),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


def plain(rows: list[list[Any]]) -> list[list[str]]:
    """Rates as whole numbers, beside their models."""
    return [[*map(str, model), *(f"{rate:.0f}" for rate in found)] for model, *found in rows]


def with_errors(rows: list[list[Any]]) -> tuple[list[list[str]], dict[str, float]]:
    """The table of errors and rates, and ratios at equal errors."""
    lines, points = [], {}
    for model, rtol, error, steps, rate in rows:
        lines.append([*map(str, model), f"{rtol:.0e}", f"{error:.1e}", steps, f"{rate:.0f}"])
        points.setdefault(tuple(model), []).append((error, 1 / rate))
    times = {model: at_error(found, ERROR) for model, found in points.items()}
    full, ratios = times[FULL], {}
    if full and times[KVAERNO5]:
        ratios[f"full: Kvaerno5 / Rodas5P at {ERROR:.0e}".replace("e-0", "e-")] = (
            times[KVAERNO5] / full
        )
    for kind, rank, method in (GALERKIN, MINIMAL):
        if full and times[kind, rank, method]:
            name = f"full / {kind} r = {rank} at {ERROR:.0e}".replace("e-0", "e-")
            ratios[name] = full / times[kind, rank, method]
    return lines, ratios


def by_compiler(rows: list[list[Any]], errors: list[list[Any]]) -> record.Section:
    """What `rj.jit` saves, of batches whose errors are known by model and tolerance."""
    known = {(tuple(model), rtol): error for model, rtol, error, *_ in errors}
    table = [["by", "model", "r", "method", "lanes", "rtol", "per second"]]
    points, found = {}, {}
    for how, model, lanes, rtol, rate in rows:
        table.append([how, *map(str, model), str(lanes), f"{rtol:.0e}", f"{rate:.3g}"])
        found[how, tuple(model), rtol] = rate
        points.setdefault((how, tuple(model)), []).append((known[tuple(model), rtol], 1 / rate))
    own, other = (at_error(points[key], ERROR) for key in (("rj.jit", FULL), ("jax.jit", KVAERNO5)))
    name = "full: rj.jit / jax.jit, per second"
    ratios = {name: found["rj.jit", FULL, RATE] / found["jax.jit", FULL, RATE]}
    if own and other:
        ratios["full: Kvaerno5, jax.jit / Rodas5P, rj.jit"] = other / own
    return record.Section(
        "By the function that a user compiles `jax.vmap(run)` with, without flags for the\n"
        f"process: per second of a processor; ratio of methods at an error of {ERROR:.0e}:",
        table,
        ratios,
    )


def measure() -> Iterator[record.Section]:
    """Errors and rates, rates by lanes, rates by devices; of a GPU, rates by lanes."""
    kind, name = child("device")
    yield record.Section(
        "Cart-pendulums with forces of 5 to 15 N for 1 s, 101 outputs: trajectories per second.\n"
        f"Least of {REPEATS} interleaved runs, on {name}.",
        absent=() if kind == "cpu" else ("full / ", "Kvaerno5", "devices"),
    )
    own = ["model", "r", "method"]
    if kind == "cpu":
        errors = child("precision")
        rows, ratios = with_errors(errors)
        yield record.Section(
            f"Errors (the worst of {CHECKED} lanes) and rates, {LANES} lanes, one core:",
            [[*own, "rtol", "error", "steps", "per second"], *rows],
            ratios,
        )
        yield by_compiler(child("compiled"), errors)
    found, counts = child("lanes"), COUNTS[kind]
    place = counts.index(LANES)
    yield record.Section(
        f"Rates by the number of lanes, rtol {RATE:g}, {'one core' if kind == 'cpu' else name}:",
        [[*own, *map(str, counts)], *plain(found)],
        {
            f"{model[0]}: {LANES} lanes / 1, per second": rate[place] / rate[0]
            for model, *rate in found
        },
    )
    if kind == "cpu":
        found = child("devices", cores=2, devices=2)
        yield record.Section(
            f"Rates on one and two host devices of two cores, rtol {RATE:g}:",
            [[*own, "one", "two"], *plain(found)],
            {f"{model[0]}: two devices / one, per second": two / one for model, one, two in found},
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--table"]:
        print(json.dumps(of(sys.argv[2])))
    else:
        # Its tables have processes and devices of their own.
        record.main(measure, setup=lambda: None)
