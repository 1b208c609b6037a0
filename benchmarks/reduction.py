"""What reduction saves and costs: errors and times of reduced models against the full model's best
solver, at the same tolerance. Writes `reduction.txt` beside this file; for many at once, see
`batches.py`.
"""

import os
import platform
from pathlib import Path

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from tabulate import tabulate
from timing import least
from tqdm import tqdm

import romjax as rj

REPEATS = 6
RTOL = 1e-8
SOLVERS = (rj.Rodas5P(), diffrax.Tsit5(), diffrax.Dopri8())
PLAIN = {"adjoint": diffrax.ForwardMode(), "throw": False, "max_steps": 10_000}
SLOW = 2.0  # [s] what takes longer is measured once


def beams(count: int) -> rj.Scene:
    """Beams of 1 m and 1 kg with three modes, hinged end to end, falling from the level."""
    bodies = [
        rj.Beam(f"beam{i}", mass=1.0, length=1.0, frequencies=[30.0, 80.0, 150.0], position=(i, 0))
        for i in np.arange(count) + 0.5
    ]
    ends = [(body.at((-0.5, 0.0)), body.at((0.5, 0.0))) for body in bodies]
    hinges = [rj.ground.at(), *(end for _, end in ends)]
    joints = [rj.Revolute(start, hinge) for (start, _), hinge in zip(ends, hinges, strict=False)]
    return rj.Scene(bodies, joints, [rj.Gravity()])


def bar(name: str, start, end) -> rj.RigidBody:  # type: ignore[no-untyped-def]
    """A uniform bar of 1 kg between two points."""
    start, along = np.asarray(start, float), np.subtract(end, start)
    length = float(np.hypot(*along))
    return rj.RigidBody(
        name,
        mass=1.0,
        inertia=length**2 / 12,
        position=start + along / 2,
        angle=float(np.arctan2(along[1], along[0])),
        extent=(length, 0.1),
    )


def closed(slider: bool) -> rj.Scene:
    """A four-bar, or a slider crank, that falls under gravity."""
    a, b, c, d = (0, 0), (0.3, 0.9), (1.8, 1.3), (2.0, 0)
    if slider:
        c = (1.5, 0)
    bars = [bar("crank", a, b), bar("coupler", b, c)]
    tip = bars[1].at(jnp.array([0.5, 0]) * bars[1].extent)
    if slider:
        last = rj.RigidBody("slider", mass=1.0, inertia=0.1, position=c)
        more = [rj.PointOnLine(last.at(), rj.ground.at()), rj.FixedAngle(last.at(), rj.ground.at())]
        more.append(rj.Revolute(tip, last.at()))
    else:
        last = bar("rocker", d, c)
        half = jnp.array([0.5, 0]) * last.extent
        more = [rj.Revolute(last.at(-half), rj.ground.at(d)), rj.Revolute(tip, last.at(half))]
    half = jnp.array([0.5, 0]) * bars[0].extent
    middle = jnp.array([0.5, 0]) * bars[1].extent
    joints = [
        rj.Revolute(bars[0].at(-half), rj.ground.at()),
        rj.Revolute(bars[0].at(half), bars[1].at(-middle)),
        *more,
    ]
    return rj.Scene([*bars, last], joints, [rj.Gravity()])


# Scene, end of the simulated time [s], ranks by formulation.
CASES = {
    "cart-pendulum": (
        rj.gallery.cart_pendulum,
        1.0,
        {"galerkin": (4, 5), "minimal": (3,), "projected": (5,)},
    ),
    "four-bar": (
        lambda: closed(False),
        2.0,
        {"galerkin": (5, 7), "minimal": (1,), "projected": (5,)},
    ),
    "slider crank": (
        lambda: closed(True),
        0.5,
        {"galerkin": (3,), "minimal": (1,), "projected": (3,)},
    ),
    "8 beams": (
        lambda: beams(8),
        1.0,
        {"galerkin": (36, 40), "minimal": (8, 16), "projected": (36,)},
    ),
}


def simulation(model, ts, solver):  # type: ignore[no-untyped-def]
    """A run under `jax.jit`, with the numbers of the model as arguments."""
    dynamic, static = eqx.partition(model, eqx.is_array)

    @jax.jit
    def run(dynamic):  # type: ignore[no-untyped-def]
        return rj.simulate(eqx.combine(dynamic, static), ts, rtol=RTOL, solver=solver, **PLAIN)

    return lambda: run(dynamic)


def measure(name: str) -> list[list[str]]:
    """The rows of one scene."""
    make, end, ranks = CASES[name]
    system, ts = rj.assemble(make()), jnp.linspace(0.0, end, 101)
    truth = rj.simulate(system, ts, rtol=1e-10, **PLAIN)
    models = {("full", ""): system}
    for formulation, numbers in ranks.items():
        for rank in numbers:
            try:
                rom = rj.reduce(system, rj.pod(truth, rank=rank), formulation)
            except rj.ReductionError as refusal:
                print(f"{name}: {refusal}")
                continue
            models[formulation, str(rank)] = rom
    calls = [simulation(model, ts, solver) for model in models.values() for solver in SOLVERS]
    times, rows = least(calls, REPEATS, SLOW), []
    for place, (kind, rank) in enumerate(models):
        own = range(place * len(SOLVERS), (place + 1) * len(SOLVERS))
        runs = {i: calls[i]() for i in own}
        good = [i for i in own if bool(runs[i].success)]
        if not good:
            rows.append([name, kind, rank, "none", "", "", "failed", ""])
            continue
        fastest = min(good, key=lambda i: times[i])
        run, best = runs[fastest], times[fastest]
        if kind == "full":
            full = best
        error, steps = float(rj.compare(truth, run).error), int(run.stats["num_steps"])
        ratio = f"{full / best:.1f}" if kind != "full" else ""
        row = [name, kind, rank, run.solver, f"{steps}", f"{1e3 * best:.2f}", f"{error:.1e}", ratio]
        rows.append(row)
    return rows


def main() -> None:
    """Measure all scenes and write the table."""
    rj.speed_up_xla()
    jax.config.update("jax_enable_x64", True)
    rows = [row for name in tqdm(CASES) for row in measure(name)]
    header = ["scene", "model", "r", "method", "steps", "ms", "error", "speed-up"]
    table = tabulate([header, *rows], headers="firstrow", tablefmt="plain", disable_numparse=True)
    text = (
        f"Relative tolerance {RTOL:g}; each model by its fastest method under jax.jit, least of "
        f"{REPEATS} interleaved runs;\nspeed-up against the full model. jax {jax.__version__}, "
        f"{os.cpu_count()} cores, {platform.machine()}.\n\n{table}\n"
    )
    Path(__file__).with_suffix(".txt").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
