"""Many cart-pendulums at once: trajectories per second, full and reduced, with their errors; on one
core, then by the number of lanes and of devices. Writes `batches.txt` beside this file.

Where JAX finds a GPU, it is measured instead, up to a million lanes.
"""

import functools
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from tabulate import tabulate
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
PRECISION = {
    ("full", 8, "Kvaerno5"): (1e-6, 1e-7, 1e-8),
    FULL: (1e-5, 1e-6, 1e-7, 1e-8),
    GALERKIN: (1e-6, 1e-7, 1e-8),
    MINIMAL: (1e-6, 1e-7, 1e-8),
}
RATE = 1e-6  # relative tolerance of the other tables
COUNTS = {"cpu": (1, 16, 256, 2048), "gpu": (1, 16, 256, 4096, 65_536, 1_000_000)}


def system(force: Any) -> rj.system.base.AbstractSystem:
    """The chapter's cart-pendulum with another force [N]."""
    return rj.assemble(rj.gallery.cart_pendulum(force=force))


def lane(model: Model) -> Callable[[Any, Any], rj.Trajectory]:
    """A function of the tolerance and the force [N]. Reduced models share a basis, from the run
    with the largest force, and a structure.
    """
    kind, rank, method = model
    solver = getattr(rj, method, None) or getattr(diffrax, method)
    ts = jnp.linspace(0.0, 1.0, 101)
    if kind != "full":
        basis = rj.pod(rj.simulate(system(15.0), ts, rtol=1e-10, **PLAIN), rank=rank)
        rom = rj.reduce(system(10.0), basis, kind)
        fixed = {"constraints": rom.m} if kind == "galerkin" else {"chart": rom.chart}

    def run(rtol: Any, force: Any) -> rj.Trajectory:
        mechanism = system(force)
        if kind != "full":
            mechanism = rj.reduce(mechanism, basis, kind, **fixed)
        return rj.simulate(mechanism, ts, rtol=rtol, solver=solver(), **PLAIN)

    return run


def forces(lanes: int) -> np.ndarray:
    """Amplitudes [N] of all lanes."""
    return np.linspace(5.0, 15.0, lanes)


def precision() -> list[list[Any]]:
    """Error and rate of each model at each tolerance."""
    amplitudes, some = jnp.asarray(forces(LANES)), slice(None, None, LANES // CHECKED)
    reference = jax.vmap(functools.partial(lane(FULL), 1e-11))(amplitudes[some])
    cases, calls = [], []
    for model, tolerances in PRECISION.items():
        batch = jax.jit(jax.vmap(lane(model), (None, 0)))
        cases += [(model, rtol) for rtol in tolerances]
        calls += [functools.partial(batch, rtol, amplitudes) for rtol in tolerances]
    times, rows = least(calls, REPEATS, SLOW), []
    for (model, rtol), call, taken in zip(cases, calls, times, strict=True):
        found = call()
        error = jax.vmap(rj.compare)(reference, jax.tree.map(lambda x: x[some], found)).error
        steps = found.stats["num_steps"]
        row = [*model, f"{rtol:.0e}", f"{jnp.max(error):.1e}", f"{steps.min()}-{steps.max()}"]
        rows.append([*row, f"{LANES / taken:.0f}"])
    return rows


def rates(settings: list[tuple[int, int]]) -> list[list[Any]]:
    """Rates of sweeps, by lanes and lanes of a chunk."""
    rows = []
    for model in (FULL, GALERKIN, MINIMAL):
        run = functools.partial(lane(model), RATE)
        calls = [
            functools.partial(rj.sweep, run, forces(lanes), chunk=chunk)
            for lanes, chunk in settings
        ]
        times = least(calls, REPEATS, SLOW)
        found = [f"{lanes / taken:.0f}" for (lanes, _), taken in zip(settings, times, strict=True)]
        rows.append([*model, *found])
    return rows


def measure(what: str) -> Any:
    """One table, in a process of its own."""
    rj.speed_up_xla()
    jax.config.update("jax_enable_x64", True)
    device = jax.devices()[0]
    if what == "device":
        return [device.platform, device.device_kind, jax.device_count()]
    if what == "precision":
        return precision()
    if what == "lanes":
        own = LANES if device.platform == "cpu" else max(COUNTS["gpu"])
        return rates([(count, min(count, own)) for count in COUNTS[device.platform]])
    # An odd number of lanes stays on one device.
    return rates([(8 * (LANES - 1), LANES - 1), (8 * LANES, 2 * LANES)])


def child(what: str, cores: int = 1, devices: int = 1) -> Any:
    """`measure` where JAX sees so many cores and, of a CPU, devices."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    done = subprocess.run(
        [sys.executable, __file__, what],
        env={**os.environ, "XLA_FLAGS": flags},
        preexec_fn=lambda: os.sched_setaffinity(0, range(cores)),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Measure everything and write the tables."""
    kind, name, _ = child("device")
    own = ["model", "r", "method"]
    tables = {}
    if kind == "cpu":
        heading = f"Errors (the worst of {CHECKED} lanes) and rates, {LANES} lanes, one core"
        tables[heading] = [[*own, "rtol", "error", "steps", "per second"], *child("precision")]
    heading = (
        f"Rates by the number of lanes, rtol {RATE:g}, {'one core' if kind == 'cpu' else name}"
    )
    tables[heading] = [own + [f"{count}" for count in COUNTS[kind]], *child("lanes")]
    if kind == "cpu":
        heading = f"Rates on one and two host devices of two cores, rtol {RATE:g}"
        tables[heading] = [[*own, "one", "two"], *child("devices", cores=2, devices=2)]
    text = (
        "Cart-pendulums with forces of 5 to 15 N for 1 s, 101 outputs: trajectories per second.\n"
        f"Least of {REPEATS} interleaved runs. jax {jax.__version__}, {os.cpu_count()} cores, "
        f"{platform.machine()}, {name}.\n"
    )
    for heading, rows in tables.items():
        text += f"\n{heading}:\n\n"
        text += tabulate(rows, headers="firstrow", tablefmt="plain", disable_numparse=True) + "\n"
    Path(__file__).with_suffix(".txt").write_text(text)
    print(text)


if __name__ == "__main__":
    if sys.argv[1:]:
        print(json.dumps(measure(sys.argv[1])))
    else:
        main()
