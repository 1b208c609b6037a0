"""Time against achieved error: romjax, diffrax's own solvers, SciPy, MuJoCo and Exudyn.

    python benchmarks/work_precision.py [--out DIR] [--repeats N] [--only NAME]

One run, interleaved: every method once per round, least and median over the rounds. Times are
second calls, with the first call (trace, compile, run) in a column of its own; errors are in the
energy norm at the output times against a run at a hundred times tighter tolerance or more, never
the tolerance asked for. romjax and diffrax are called as `jax.jit` of a simulation; SciPy takes the
same right-hand side, compiled by JAX, a call per evaluation. MuJoCo and Exudyn (extra `bench`)
take fixed steps and are compared at the end of one second; so are fixed steps of romjax.
"""

import argparse
import datetime
import importlib.util
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import peers
import scipy.integrate
from matplotlib.figure import Figure
from tabulate import tabulate
from tqdm import tqdm

import romjax as rj

RTOLS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
ERRORS = (1e-4, 1e-5, 1e-6, 1e-7)
STYLES = {
    "Rodas5P": ("#0072b2", "o-"),
    "Dopri8": ("#0072b2", "^--"),
    "Dopri8, fixed steps": ("#56b4e9", "^-"),
    "Tsit5": ("#009e73", "v-."),
    "Kvaerno5": ("#d55e00", "s-"),
    "SciPy BDF": ("#7f7f7f", "x--"),
    "SciPy LSODA": ("#7f7f7f", "+:"),
    "MuJoCo RK4": ("#000000", "d-"),
    "Exudyn": ("#cc79a7", "P-"),
}
OURS = {
    "Rodas5P",
    "Dopri8",
    "Dopri8, fixed steps",
    "Tsit5",
}  # romjax with its own and diffrax's methods


class Method(NamedTuple):
    """A function of a setting that returns places, steps and the time it took."""

    run: Callable[[float], tuple[np.ndarray, int, float]]
    settings: tuple[float, ...]


class Case(NamedTuple):
    """One scene, when it is looked at, and who simulates it."""

    name: str
    methods: dict[str, Method]
    truth: np.ndarray
    root: np.ndarray  # of the metric of errors
    size: float  # of the motion


class Row(NamedTuple):
    """One method at one setting."""

    case: str
    method: str
    setting: float
    error: float
    least_ms: float
    median_ms: float
    first_s: float  # first call of the method
    steps: int


def romjax_run(system, ts, solver, stabilization, **fixed):  # type: ignore[no-untyped-def]
    """A simulation under `jax.jit`, as a function of the tolerance or of the number of steps."""

    @jax.jit
    def simulate(q0, setting):  # type: ignore[no-untyped-def]
        numbers = {"dt": 1 / setting} if fixed else {"rtol": setting}
        found = rj.simulate(
            system,
            ts,
            q0=q0,
            solver=solver,
            stabilization=stabilization,
            adjoint=diffrax.ForwardMode(),
            throw=False,
            **numbers,
        )
        return found.q[1:], found.stats["num_steps"]

    def run(setting: float) -> tuple[np.ndarray, int, float]:
        arguments = system.q0, jnp.asarray(float(setting))
        start = time.perf_counter()
        q, steps = jax.block_until_ready(simulate(*arguments))
        return np.asarray(q), int(steps), time.perf_counter() - start

    return run


def scipy_run(system, ts, name, stabilization):  # type: ignore[no-untyped-def]
    n = system.n
    rate = jax.jit(
        lambda t, y: jnp.append(y[n:], system.acceleration(t, y[:n], y[n:], stabilization)[0])
    )
    start_state = np.concatenate([system.q0, system.v0])

    def run(rtol: float) -> tuple[np.ndarray, int, float]:
        start = time.perf_counter()
        found = scipy.integrate.solve_ivp(
            lambda t, y: np.asarray(rate(t, y)),
            (float(ts[0]), float(ts[-1])),
            start_state,
            method=name,
            t_eval=np.asarray(ts[1:]),
            rtol=rtol,
            atol=rtol,
        )
        return found.y[:n].T, found.nfev, time.perf_counter() - start

    return run


def case(
    name: str, scene: rj.Scene, outputs: int, stiff: bool, links: int = 0, mild: bool = True
) -> Case:
    """A case with all methods that suit it."""
    system, ts = rj.assemble(scene), jnp.linspace(0.0, 1.0, outputs + 1)
    omega = system.frequencies(ts[0], system.q0, system.v0).rigid
    # A chain drifts by less than its error in one second: bare, as the others are.
    keep = None if links else rj.Baumgarte.critical(omega)
    truth = rj.simulate(
        system,
        ts,
        rtol=1e-10 if stiff else 1e-11,
        solver=rj.Rodas5P() if stiff else diffrax.Dopri8(),
        stabilization=rj.Projection(),
        max_steps=1_000_000,
    )
    found = {}
    if links <= 8:
        found["Rodas5P"] = Method(romjax_run(system, ts, rj.Rodas5P(), keep), RTOLS)
        found["Kvaerno5"] = Method(romjax_run(system, ts, diffrax.Kvaerno5(), keep), RTOLS)
        # Stiffer cases take SciPy minutes a run.
        for method in ("BDF", "LSODA") if mild else ():
            found[f"SciPy {method}"] = Method(scipy_run(system, ts, method, keep), RTOLS[:3])
    if not stiff:
        for solver in (diffrax.Dopri8(), diffrax.Tsit5()):
            found[type(solver).__name__] = Method(romjax_run(system, ts, solver, keep), RTOLS)
    if links:
        few = {1: 2, 2: 6}.get(links, 8)
        steps = tuple(few * k // 2 for k in (2, 3, 4, 5, 6, 8))
        fixed = romjax_run(system, ts, diffrax.Dopri8(), keep, fixed=True)
        found["Dopri8, fixed steps"] = Method(fixed, steps)
        if importlib.util.find_spec("mujoco"):
            steps = (10, 20, 40, 80, 160, 320) if links < 32 else (40, 80, 160, 320)
            found["MuJoCo RK4"] = Method(peers.mujoco_chain(links), steps)
        if importlib.util.find_spec("exudyn"):
            steps = (60, 200, 700, 2500, 6000) if links < 128 else (100, 400, 1600)
            found["Exudyn"] = Method(peers.exudyn_chain(links), steps)
    root = np.linalg.cholesky(np.asarray(truth.metric))
    size = float(np.linalg.norm((truth.q[1:] - truth.q[0]) @ root))
    return Case(name, found, np.asarray(truth.q[1:]), root, size)


CASES: dict[str, Callable[[str], Case]] = {
    f"cart-pendulum, {f2:g} Hz": lambda name, f2=f2: case(
        name, rj.gallery.cart_pendulum(f2=f2), 100, True, mild=f2 <= 1e3
    )
    for f2 in (1e3, 1e4, 1e5)
} | {
    f"chain of {n}": lambda name, n=n: case(name, rj.gallery.chain(n), 1, False, n)
    for n in (1, 2, 8, 32, 128)
}


def measure(case: Case, repeats: int) -> list[Row]:
    """All methods at all settings of one case, in rounds."""
    results, times, first = {}, {}, {}
    for name, method in case.methods.items():
        start = time.perf_counter()
        method.run(method.settings[0])
        first[name] = time.perf_counter() - start
    for _ in tqdm(range(repeats), desc=case.name):
        for name, method in case.methods.items():
            for setting in method.settings:
                q, steps, taken = method.run(setting)
                results[name, setting] = q, steps
                times.setdefault((name, setting), []).append(taken)
    rows = []
    for (name, setting), taken in times.items():
        q, steps = results[name, setting]
        missed = (np.reshape(q, case.truth.shape) - case.truth) @ case.root
        error = float(np.linalg.norm(missed)) / case.size
        ms = 1e3 * np.array(taken)
        rows.append(
            Row(case.name, name, setting, error, ms.min(), np.median(ms), first[name], steps)
        )
    return rows


def at_error(rows: list[Row], error: float) -> float | None:
    """Least time [ms] at an error, along straight lines between neighbours in the logarithms."""
    points = sorted((row.error, row.least_ms) for row in rows if 0 < row.error < 1)
    if not points or error < points[0][0]:
        return None
    errors, least = np.log(points).T
    # Looser than the loosest run: that one, as it is.
    return float(np.exp(np.interp(np.log(error), errors, least)))


def at_equal_error(rows: list[Row]) -> list[list[object]]:
    """Times at the same errors: the best of romjax, and how many times longer others take."""
    lines = []
    for name in dict.fromkeys(row.case for row in rows):
        for error in ERRORS:
            found = {
                method: at_error([r for r in rows if (r.case, r.method) == (name, method)], error)
                for method in STYLES
            }
            ours = {m: found[m] for m in STYLES if m in OURS and found[m]}
            if ours:
                best = min(ours, key=ours.__getitem__)  # type: ignore[arg-type]
                others = [m for m in STYLES if m not in OURS]
                ratios = [found[m] / ours[best] if found[m] else None for m in others]  # type: ignore[operator]
                lines.append([name, error, best, ours[best], *ratios])
    return lines


def draw(rows: list[Row]) -> Figure:
    """The work–precision diagram, one panel per case."""
    names = list(dict.fromkeys(row.case for row in rows))
    columns = min(4, len(names))
    figure = Figure(figsize=(3.1 * columns, 3.0 * -(-len(names) // columns) + 0.7))
    shared = {}
    for k, name in enumerate(names):
        axes = figure.add_subplot(-(-len(names) // columns), columns, k + 1, title=name)
        for method, (colour, style) in STYLES.items():
            chosen = [r for r in rows if (r.case, r.method) == (name, method) and r.error < 1]
            points = sorted((r.error, r.least_ms) for r in chosen if r.error > 0)
            if points:
                (shared[method],) = axes.loglog(
                    *np.transpose(points), style, color=colour, markersize=4, linewidth=1.2
                )
        axes.set_xlim(1e-9, 1e-2)
        axes.invert_xaxis()
        axes.grid(alpha=0.3)
        axes.set_xlabel("error")
        if k % columns == 0:
            axes.set_ylabel("time [ms]")
    figure.legend(shared.values(), shared.keys(), loc="lower center", ncols=5, frameon=False)
    figure.tight_layout(rect=(0, 0.09, 1, 1))
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--only", default="", help="cases whose name contains this")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    rj.speed_up_xla()
    rows = []
    for name, make in CASES.items():
        if options.only in name:
            rows += measure(make(name), options.repeats)
    others = [m for m in STYLES if m not in OURS]
    header = ["case", "error", "best of romjax", "ms", *(f"{m} / ours" for m in others)]
    machine = f"{platform.machine()}, {os.cpu_count()} cores, jax {jax.__version__}"
    text = "\n\n".join(
        [
            f"{datetime.date.today()}, {machine}",
            tabulate(at_equal_error(rows), header, floatfmt=".2g", missingval="-"),
            tabulate(rows, Row._fields, floatfmt=".2e"),
        ]
    )
    print(text)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "work_precision.txt").write_text(text + "\n")
    draw(rows).savefig(options.out / "work_precision.png", dpi=110)


if __name__ == "__main__":
    main()
