"""What reduction saves and costs: errors and times of reduced models against the full model's best
solver, at the same tolerance, alone and in a batch. Writes `reduction.txt` beside this file.
"""

import os
import time
from pathlib import Path

# Small loops as one compiled kernel each; see work_precision.py.
FLAG = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1048576"
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {FLAG}".strip()

import diffrax  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from tabulate import tabulate  # noqa: E402
from tqdm import tqdm  # noqa: E402

import romjax as rj  # noqa: E402

REPEATS = 7
RTOL = 1e-8
BATCH = 256
PLAIN = {"adjoint": diffrax.ForwardMode(), "throw": False}


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
        0.7,
        {"galerkin": (3, 5), "minimal": (1,), "projected": (5,)},
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


def least(functions):  # type: ignore[no-untyped-def]
    """The least of interleaved times of each [s], and the last results."""
    times = [[] for _ in functions]
    for _ in range(REPEATS):
        for function, taken in zip(functions, times, strict=True):
            start = time.perf_counter()
            jax.block_until_ready(function().q)
            taken.append(time.perf_counter() - start)
    return [min(taken[1:]) for taken in times]


def measure(name: str) -> list[list[str]]:
    """The rows of one scene."""
    make, end, ranks = CASES[name]
    system, ts = rj.assemble(make()), jnp.linspace(0.0, end, 101)
    truth = rj.simulate(system, ts, rtol=1e-10, **PLAIN)
    models = {("full", solver): (system, solver) for solver in ("Rodas5P", "Dopri8")}
    for formulation, numbers in ranks.items():
        for rank in numbers:
            try:
                rom = rj.reduce(system, rj.pod(truth, rank=rank), formulation)
            except rj.ReductionError as refusal:
                print(f"{name}: {refusal}")
                continue
            models[formulation, str(rank)] = rom, "Dopri8"
    solvers = {"Rodas5P": rj.Rodas5P(), "Dopri8": diffrax.Dopri8()}
    calls = [
        lambda s=s, solver=solver: rj.simulate(s, ts, rtol=RTOL, solver=solvers[solver], **PLAIN)
        for s, solver in models.values()
    ]
    times = least(calls)
    best, rows = min(times[:2]), []
    for (kind, which), taken, call in zip(models, times, calls, strict=True):
        run = call()
        error = float(rj.compare(truth, run).error) if bool(run.success) else np.nan
        steps = int(run.stats["num_steps"])
        ratio = f"{best / taken:.1f}" if kind != "full" else ""
        rows.append([name, kind, which, f"{steps}", f"{1e3 * taken:.2f}", f"{error:.1e}", ratio])
    return rows


def batch() -> list[list[str]]:
    """256 cart-pendulums with forces of 5 to 15 N at once, full and reduced."""
    ts = jnp.linspace(0.0, 1.0, 101)

    def system(force):  # type: ignore[no-untyped-def]
        return rj.assemble(rj.gallery.cart_pendulum(force=force))

    truth = rj.simulate(system(15.0), ts, rtol=1e-10, **PLAIN)
    fixed = {}
    for formulation, rank in (("galerkin", 5), ("minimal", 3)):
        basis = rj.pod(truth, rank=rank)
        rom = rj.reduce(system(10.0), basis, formulation)
        kept = {"constraints": rom.m} if formulation == "galerkin" else {"chart": rom.chart}
        fixed[formulation] = basis, kept

    def run(kind, force):  # type: ignore[no-untyped-def]
        if kind == "full":
            return rj.simulate(system(force), ts, rtol=RTOL, solver=rj.Rodas5P(), **PLAIN)
        basis, kept = fixed[kind]
        rom = rj.reduce(system(force), basis, kind, **kept)
        return rj.simulate(rom, ts, rtol=RTOL, solver=diffrax.Dopri8(), **PLAIN)

    forces = jnp.linspace(5.0, 15.0, BATCH)
    calls = []
    for kind in ("full", *fixed):
        call = jax.jit(jax.vmap(lambda force, kind=kind: run(kind, force)))
        calls.append(lambda call=call: call(forces))
    times = least(calls)
    return [
        [
            f"cart-pendulum × {BATCH}",
            kind,
            "",
            "",
            f"{1e3 * taken:.1f}",
            "",
            f"{times[0] / taken:.1f}",
        ]
        for kind, taken in zip(("full", *fixed), times, strict=True)
    ]


def main() -> None:
    """Measure all scenes and write the table."""
    jax.config.update("jax_enable_x64", True)
    rows = [row for name in tqdm(CASES) for row in measure(name)] + batch()
    header = ["scene", "model", "r", "steps", "ms", "error", "speed-up"]
    table = tabulate([header, *rows], headers="firstrow", tablefmt="plain", disable_numparse=True)
    text = (
        f"Relative tolerance {RTOL:g}; least of {REPEATS - 1} interleaved runs; speed-up against "
        f"the faster of the full\nmodel's two solvers. jax {jax.__version__}, CPU.\n\n{table}\n"
    )
    Path(__file__).with_suffix(".txt").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
