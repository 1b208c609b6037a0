"""Time against achieved error: romjax's solvers, diffrax's and SciPy's, on the same equations.

    python benchmarks/work_precision.py [--out DIR] [--repeats N]

One run, interleaved: every method once per round, least and median over the rounds. Times are
second calls with compilation apart; errors are in the energy norm at the output times against a run
of another method at a hundred times tighter tolerance, never the tolerance asked for. SciPy
integrates the same right-hand side, compiled by JAX, one call per evaluation.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import scipy.integrate
from matplotlib.figure import Figure
from tabulate import tabulate
from tqdm import tqdm

import romjax as rj

RTOLS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
SOLVERS = {
    "Rodas5P": rj.Rodas5P(),
    "Kvaerno5": diffrax.Kvaerno5(),
    "Dopri8": diffrax.Dopri8(),
    "Tsit5": diffrax.Tsit5(),
}
STYLES = dict(zip((*SOLVERS, "BDF", "LSODA"), ("o-", "s--", "^:", "v-.", "x--", "+:"), strict=True))
STIFF = {"Rodas5P", "Kvaerno5", "BDF", "LSODA"}


class Case(NamedTuple):
    """One scene and how long it runs."""

    name: str
    scene: rj.Scene
    end: float
    stiff: bool  # whether explicit methods would take minutes


class Row(NamedTuple):
    """One method at one tolerance."""

    case: str
    method: str
    rtol: float
    error: float
    least: float  # [s]
    median: float  # [s]
    compile: float | None  # [s], once per method
    steps: int


def cases() -> list[Case]:
    """The chapter's pendulum, stiffer ones, and chains."""
    pendulums = [
        Case(f"cart f2={f2:g}", rj.gallery.cart_pendulum(f2=f2), 1.0, f2 > 1e3)
        for f2 in (1e3, 1e4, 1e5)
    ]
    return pendulums + [Case(f"chain {n}", rj.gallery.chain(n), 1.0, False) for n in (1, 2, 8)]


def methods(system: rj.AbstractSystem, ts: jnp.ndarray, stiff: bool) -> dict[str, Callable]:
    """Functions of the tolerance that return (q (k, n), steps)."""
    stabilization = rj.Baumgarte.critical(system.frequencies(ts[0], system.q0, system.v0).rigid)

    def ours(solver: diffrax.AbstractSolver) -> Callable:
        def run(rtol: float) -> tuple[np.ndarray, int]:
            found = rj.simulate(
                system, ts, solver=solver, rtol=rtol, stabilization=stabilization, throw=False
            )
            return np.asarray(found.q), int(found.stats["num_steps"])

        return run

    n = system.n
    rate = jax.jit(
        lambda t, y: jnp.append(y[n:], system.acceleration(t, y[:n], y[n:], stabilization)[0])
    )
    start = np.concatenate([system.q0, system.v0])

    def scipys(name: str) -> Callable:
        def run(rtol: float) -> tuple[np.ndarray, int]:
            found = scipy.integrate.solve_ivp(
                lambda t, y: np.asarray(rate(t, y)),
                (float(ts[0]), float(ts[-1])),
                start,
                method=name,
                t_eval=np.asarray(ts),
                rtol=rtol,
                atol=rtol,
            )
            return found.y[:n].T, found.nfev

        return run

    found = {name: ours(solver) for name, solver in SOLVERS.items()}
    found |= {name: scipys(name) for name in ("BDF", "LSODA")}
    return {name: run for name, run in found.items() if name in STIFF or not stiff}


def measure(case: Case, repeats: int, bar: tqdm) -> list[Row]:
    """All methods at all tolerances on one case."""
    system = rj.assemble(case.scene)
    ts = jnp.linspace(0.0, case.end, 101)
    reference = rj.simulate(
        system, ts, rtol=1e-11, solver=rj.Rodas5P() if case.stiff else diffrax.Dopri8()
    )
    root = np.linalg.cholesky(reference.metric)
    size = np.linalg.norm((reference.q - reference.q[0]) @ root)
    runs = methods(system, ts, case.stiff)
    first = {}
    for name, run in runs.items():
        start = time.perf_counter()
        run(RTOLS[0])
        first[name] = time.perf_counter() - start
    times: dict[tuple[str, float], list[float]] = {}
    results = {}
    for _ in range(repeats):
        for rtol in RTOLS:
            for name, run in runs.items():
                start = time.perf_counter()
                results[name, rtol] = run(rtol)
                times.setdefault((name, rtol), []).append(time.perf_counter() - start)
                bar.update()
    return [
        Row(
            case.name,
            name,
            rtol,
            float(np.linalg.norm((results[name, rtol][0] - reference.q) @ root) / size),
            min(taken),
            float(np.median(taken)),
            first[name] - min(times[name, RTOLS[0]]),
            results[name, rtol][1],
        )
        for (name, rtol), taken in times.items()
    ]


def at_error(rows: list[Row], error: float) -> float | None:
    """Time at an error, along the straight line between neighbours in the double logarithm."""
    points = sorted((row.error, row.least) for row in rows if 0 < row.error < np.inf)
    errors, least = np.log([e for e, _ in points]), np.log([t for _, t in points])
    if not points or not errors[0] <= np.log(error) <= errors[-1]:
        return None
    return float(np.exp(np.interp(np.log(error), errors, least)))


def draw(rows: list[Row]) -> Figure:
    """The work–precision diagram, one panel per case."""
    names = list(dict.fromkeys(row.case for row in rows))
    figure = Figure(figsize=(4 * 3, 3.2 * -(-len(names) // 3)), layout="constrained")
    for k, name in enumerate(names):
        axes = figure.add_subplot(-(-len(names) // 3), 3, k + 1, title=name)
        for method, style in STYLES.items():
            points = sorted(
                (r.error, r.least) for r in rows if (r.case, r.method) == (name, method)
            )
            if points:
                axes.loglog(*np.transpose(points), style, label=method)
        axes.set(xlabel="error", ylabel="time [s]")
        axes.grid(alpha=0.3)
    figure.axes[0].legend()
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("benchmarks"))
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rows = []
    total = sum(len(STIFF) if c.stiff else 6 for c in cases()) * len(RTOLS) * options.repeats
    with tqdm(total=total) as bar:
        for case in cases():
            bar.set_description(case.name)
            rows += measure(case, options.repeats, bar)
    table = tabulate(rows, Row._fields, floatfmt=".2e")
    ratios = []
    for case in dict.fromkeys(row.case for row in rows):
        for error in (1e-4, 1e-5, 1e-6):
            mine, theirs = (
                at_error([r for r in rows if (r.case, r.method) == (case, name)], error)
                for name in ("Rodas5P", "Kvaerno5")
            )
            if mine and theirs:
                ratios.append([case, error, 1e3 * mine, 1e3 * theirs, theirs / mine])
    header = ["case", "error", "Rodas5P ms", "Kvaerno5 ms", "ratio"]
    text = f"{table}\n\nAt equal error\n{tabulate(ratios, header, floatfmt='.3g')}\n"
    print(text)
    (options.out / "work_precision.txt").write_text(text)
    draw(rows).savefig(options.out / "work_precision.png", dpi=110)


if __name__ == "__main__":
    main()
