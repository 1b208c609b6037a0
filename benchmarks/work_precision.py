"""Time against achieved error: romjax, diffrax's own solvers, SciPy, MuJoCo and Exudyn.

Interleaved: every method once per round. Times are second calls, with the first call (trace,
compile, run) in a column of its own; errors are in the energy norm at the output times against a
run at a hundred times tighter tolerance or more, never the tolerance asked for. romjax and diffrax
are called as `jax.jit` of a simulation; SciPy takes the same right-hand side, compiled by JAX, a
call per evaluation. MuJoCo (RK4) and Exudyn take fixed steps and are compared at the end of one
second; so are fixed steps of romjax. Writes `work_precision.txt` and `.png` beside this file.
"""

import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import peers
import record
import scipy.integrate
from equal_error import STYLES, Row, at_equal_error, draw
from timing import least

import romjax as rj
from romjax.system.frequencies import frequencies

REPEATS = 7
SLOW = 1.0  # [s] what takes longer is measured once
RTOLS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
# On chains Kvaerno5 is three digits better than asked for.
LOOSE = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
ERRORS = (1e-4, 1e-5, 1e-6, 1e-7)
# romjax with its own and diffrax's explicit methods; what each of the others is measured at.
OURS = ("Rodas5P", "Dopri8", "Dopri8, fixed steps", "Tsit5")
OTHERS = {
    "Kvaerno5": (1e-4, 1e-6),
    "SciPy BDF": (1e-4,),
    "SciPy LSODA": (1e-4,),
    "MuJoCo": (1e-5, 1e-7),
    "Exudyn": (1e-6,),
}


class Method(NamedTuple):
    """A function of a setting that returns places and the number of steps."""

    run: Callable[[float], tuple[np.ndarray, int]]
    settings: tuple[float, ...]


class Case(NamedTuple):
    """One scene, when it is looked at, and who simulates it."""

    methods: dict[str, Method]
    truth: np.ndarray
    root: np.ndarray  # of the metric of errors
    size: float  # of the motion


def romjax_run(system, ts, solver, stabilization, **fixed):  # type: ignore[no-untyped-def]
    """A simulation under `jax.jit`, as a function of the tolerance or of the number of steps."""

    @jax.jit
    def simulate(q0, setting):  # type: ignore[no-untyped-def]
        chosen = {"dt": 1 / setting} if fixed else {"rtol": setting}
        found = rj.simulate(
            system,
            ts,
            q0=q0,
            solver=solver,
            stabilization=stabilization,
            adjoint=diffrax.ForwardMode(),
            throw=False,
            **chosen,
        )
        return found.q[1:], found.stats.num_steps

    # Made once: of the shortest runs it would be a third.
    numbers = functools.cache(lambda setting: jnp.asarray(float(setting)))
    return lambda setting: simulate(system.q0, numbers(setting))


def scipy_run(system, ts, name, stabilization):  # type: ignore[no-untyped-def]
    """SciPy's integration as a function of the tolerance."""
    n = system.n
    rate = jax.jit(
        lambda t, y: jnp.append(y[n:], system.acceleration(t, y[:n], y[n:], stabilization)[0])
    )
    start_state = np.concatenate([system.q0, system.v0])

    def run(rtol: float) -> tuple[np.ndarray, int]:
        found = scipy.integrate.solve_ivp(
            lambda t, y: np.asarray(rate(t, y)),
            (float(ts[0]), float(ts[-1])),
            start_state,
            method=name,
            t_eval=np.asarray(ts[1:]),
            rtol=rtol,
            atol=rtol,
        )
        return found.y[:n].T, found.nfev

    return run


def case(scene: rj.Scene, outputs: int, stiff: bool, links: int = 0, mild: bool = True) -> Case:
    """A case with all methods that suit it."""
    system, ts = rj.assemble(scene), jnp.linspace(0.0, 1.0, outputs + 1)
    omega = frequencies(system, ts[0], system.q0, system.v0).rigid
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
        found["Kvaerno5"] = Method(
            romjax_run(system, ts, diffrax.Kvaerno5(), keep), RTOLS if stiff else LOOSE
        )
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
        if "MuJoCo" not in peers.missing():
            steps = (10, 20, 40, 80, 160, 320) if links < 32 else (40, 80, 160, 320)
            found["MuJoCo"] = Method(peers.mujoco_chain(links), steps)
        if "Exudyn" not in peers.missing():
            steps = (60, 200, 700, 2500, 6000) if links < 128 else (100, 400, 1600)
            found["Exudyn"] = Method(peers.exudyn_chain(links), steps)
    root = np.linalg.cholesky(np.asarray(truth.metric))
    size = float(np.linalg.norm((truth.q[1:] - truth.q[0]) @ root))
    return Case(found, np.asarray(truth.q[1:]), root, size)


# By the frequency of the second mode, and by the number of bars.
CASES: dict[str, Callable[[], Case]] = {
    name: functools.partial(
        lambda f2: case(rj.gallery.cart_pendulum(f2=f2), 100, True, mild=f2 <= 1e3), f2
    )
    for name, f2 in (("cart-pendulum", 1e3), ("cart, 10 kHz", 1e4), ("cart, 100 kHz", 1e5))
} | {
    f"chain of {n}": functools.partial(lambda n: case(rj.gallery.chain(n), 1, False, n), n)
    for n in (1, 2, 8, 32, 128)
}


def runs(name: str) -> list[Row]:
    """All methods at all settings of one case."""
    found = CASES[name]()
    labels = [
        (method, setting) for method, one in found.methods.items() for setting in one.settings
    ]
    calls = [functools.partial(found.methods[method].run, setting) for method, setting in labels]
    rows, first = [], {}
    for (method, setting), timed in zip(labels, least(calls, REPEATS, SLOW, name), strict=True):
        q, steps = timed.result
        missed = (np.reshape(q, found.truth.shape) - found.truth) @ found.root
        with np.errstate(over="ignore"):  # of steps that are too long
            error = float(np.linalg.norm(missed)) / found.size
        # One program serves all settings: the first call of the first one compiles it.
        compiled = first.setdefault(method, timed.first)
        ms = 1e3 * timed.least, 1e3 * timed.median
        rows.append(Row(method, setting, error, *ms, compiled, int(steps)))
    return rows


def compared(name: str, rows: list[Row]) -> tuple[list[list[str]], dict[str, float]]:
    """The table of times at equal errors, and the ratios of those that are followed."""
    others = [other for other in OTHERS if any(row.method == other for row in rows)]
    lines = [["error", "best of romjax", "ms", *others]]
    ratios = {}
    for error in ERRORS:
        found = at_equal_error(rows, error)
        ours = {method: found[method] for method in OURS if method in found}
        if not ours:
            continue
        best = min(ours, key=ours.__getitem__)
        times = {other: found[other] / ours[best] for other in others if other in found}
        cells = (record.short(times.get(other)) for other in others)
        lines.append([f"{error:.0e}", best, f"{ours[best]:.2g}", *cells])
        for other, value in times.items():
            if error in OTHERS[other]:
                short = other.removeprefix("SciPy ")
                ratios[f"{name} at {error:.0e}: {short} / romjax".replace("e-0", "e-")] = value
    return lines, ratios


def measure() -> Iterator[record.Section]:
    """The sections of all cases, then the diagram."""
    cases: dict[str, list[Row]] = {}
    for name in CASES:
        rows = cases[name] = runs(name)
        lines, ratios = compared(name, rows)
        heading = f"{name}: times at equal errors, the best of romjax and others in units of it"
        yield record.Section(f"{heading}:", lines, ratios, peers.missing())
        cells = [
            [row.method, f"{row.setting:g}", *(f"{x:.2e}" for x in row[2:6]), f"{row.steps}"]
            for row in sorted(rows, key=lambda row: list(STYLES).index(row.method))
        ]
        yield record.Section(f"{name}: all runs:", [Row._fields, *cells])
    yield record.Section(
        f"Least and median of {REPEATS} rounds; what takes longer than {SLOW:g} s, once.",
        figure=draw(cases),
    )


if __name__ == "__main__":
    record.main(measure)
