"""Hard cases by romjax and by the textbook: what comes of them, how exact, and at what cost.

The textbook solves the extended system [[M, C_qᵀ], [C_q, 0]] (a, λ) = (Q, γ) by LU, with
Baumgarte's stabilisation, under diffrax; romjax takes the same method, steps and tolerance. Errors
are in the energy norm against solutions of another kind: the motion of one crank angle, a closed
form, or, of the stiff case, a much tighter run that is projected. Writes `hard_cases.txt` beside
this file.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import record
from linkages import FOUR_BAR, four_bar, slider_crank
from timing import least

import romjax as rj
from romjax.system import dynamics

REPEATS = 15
SLOW = 2.0  # [s] what takes longer is measured once
RTOL = 1e-8  # of the cases without fixed steps, but for the stiff one
STIFF_RTOL = 1e-6
STEP = 0.01  # [s] of the cases that land on a singular position
TIGHT = 1e-12
WRONG = 1e-2  # error of a motion that is another one
GRAVITY = 9.81
KEEP = {"alpha": 20.0, "beta": 100.0}  # 10 rad/s, critically damped
MAX_STEPS = 20_000


class Case(NamedTuple):
    """A system, its times and its true places; who integrates it, by name."""

    system: rj.AbstractSystem
    ts: np.ndarray
    truth: np.ndarray
    methods: dict[str, Callable[[Any], Any]]  # functions of the start: places, how it ended


def romjax(system, ts, solver, keep=None, **settings):  # type: ignore[no-untyped-def]
    """A simulation as a function of the start."""

    def run(q0):  # type: ignore[no-untyped-def]
        found = rj.simulate(
            system,
            ts,
            q0=q0,
            solver=solver,
            stabilization=keep or rj.Baumgarte(**KEEP),
            adjoint=diffrax.ForwardMode(),
            throw=False,
            max_steps=MAX_STEPS,
            **settings,
        )
        return found.q, found.status

    return run


def textbook(system, ts, solver, rtol=None, dt=None):  # type: ignore[no-untyped-def]
    """The same by the extended system, in steps of `dt` or with the tolerance `rtol`."""
    n, zero, keep = system.n, jnp.zeros((system.m, system.m)), rj.Baumgarte(**KEEP)

    def rate(t, state, _):  # type: ignore[no-untyped-def]
        q, v = state
        rows = dynamics.jacobian(system, t, q)
        matrix = jnp.block([[system.mass(q), rows.T], [rows, zero]])
        right = jnp.concatenate([system.force(t, q, v), dynamics.gamma(system, t, q, v, keep)])
        return v, jnp.linalg.solve(matrix, right)[:n]

    control = diffrax.ConstantStepSize() if dt else diffrax.PIDController(rtol=rtol, atol=rtol)

    def run(q0):  # type: ignore[no-untyped-def]
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            solver,
            ts[0],
            ts[-1],
            dt,
            (q0, system.v0),
            saveat=diffrax.SaveAt(ts=ts),
            stepsize_controller=control,
            adjoint=diffrax.ForwardMode(),
            max_steps=MAX_STEPS,
            throw=False,
        )
        failed = found.result != diffrax.RESULTS.successful
        steps = found.result == diffrax.RESULTS.max_steps_reached
        kinds = rj.Status.SUCCESS, rj.Status.MAX_STEPS, rj.Status.SOLVER_FAILED
        status = jnp.where(steps, kinds[1], jnp.where(failed, kinds[2], kinds[0]))
        return found.ys[0], status

    return run


def on_one_angle(places, masses, start, speed, ts, gravity=0.0):  # type: ignore[no-untyped-def]
    """Places of a mechanism with one degree of freedom, all of them functions of an angle θ:
    ½ d(J θ̇²)/dθ + dV/dθ = 0, J(θ) = Σ m |dx/dθ|². No constraint is left to violate.
    """

    def inertia(angle):  # type: ignore[no-untyped-def]
        return jnp.sum(masses * jax.jacfwd(places)(angle) ** 2)

    def potential(angle):  # type: ignore[no-untyped-def]
        return gravity * jnp.sum(masses[1::3] * places(angle)[1::3])

    def rate(t, state, _):  # type: ignore[no-untyped-def]
        angle, speed = state
        pull = 0.5 * jax.grad(inertia)(angle) * speed**2 + jax.grad(potential)(angle)
        return speed, -pull / inertia(angle)

    found = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        diffrax.Dopri8(),
        ts[0],
        ts[-1],
        None,
        (jnp.asarray(start), jnp.asarray(speed)),
        saveat=diffrax.SaveAt(ts=ts),
        stepsize_controller=diffrax.PIDController(rtol=TIGHT, atol=TIGHT),
        max_steps=MAX_STEPS,
    )
    return jax.vmap(places)(found.ys[0])


def middle(start, end):  # type: ignore[no-untyped-def]
    """Coordinates of a bar between two points."""
    along = end - start
    return jnp.append((start + end) / 2, jnp.arctan2(along[1], along[0]))


def four_bar_places(angle):  # type: ignore[no-untyped-def]
    """Coordinates by the angle of the crank: the third joint is where two circles meet."""
    a, b, c, d = (np.array(point) for point in FOUR_BAR)
    crank, coupler, rocker = (np.linalg.norm(x) for x in (b - a, c - b, c - d))
    knee = crank * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    base = d - knee
    span = jnp.linalg.norm(base)
    along = (coupler**2 - rocker**2 + span**2) / (2 * span)
    up = jnp.sqrt(coupler**2 - along**2)
    top = knee + (along * base + up * jnp.stack([-base[1], base[0]])) / span
    return jnp.concatenate([middle(a, knee), middle(knee, top), middle(d, top)])


def falling(coupler: float = 1.0, twice: bool = False) -> Case:
    """The four-bar, which falls under gravity."""
    system = rj.assemble(four_bar(coupler=coupler, twice=twice))
    ts = jnp.linspace(0.0, 0.5, 51)
    masses = jnp.diag(system.mass(system.q0))
    start = np.arctan2(FOUR_BAR[1][1], FOUR_BAR[1][0])
    truth = on_one_angle(four_bar_places, masses, start, 0.0, ts, GRAVITY)
    solver = diffrax.Dopri8()
    methods = {
        "romjax": romjax(system, ts, solver, rtol=RTOL),
        "textbook": textbook(system, ts, solver, rtol=RTOL),
    }
    return Case(system, ts, truth, methods)


def in_steps(system, ts, truth) -> Case:  # type: ignore[no-untyped-def]
    """A case that meets singular positions, in fixed steps."""
    solver = diffrax.Dopri8()
    methods = {
        "romjax": romjax(system, ts, solver, dt=STEP),
        "romjax, projected": romjax(system, ts, solver, rj.Projection(), dt=STEP),
        "textbook": textbook(system, ts, solver, dt=STEP),
    }
    return Case(system, ts, truth, methods)


def change_points() -> Case:
    """A parallelogram that turns evenly; all bars are in line after each odd second, where the
    constraints lose rank and two motions meet.
    """
    w = np.pi / 2
    points, turning = ((0, 0), (0, 1), (2, 1), (2, 0)), ((-w, 0), (-w, 0))
    system = rj.assemble(four_bar(points, velocities=turning, gravity=False))
    ts = jnp.linspace(0.0, 8.0, 81)
    angle = np.pi / 2 + w * np.asarray(ts)
    x, y, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    crank, rocker = [x / 2, y / 2, angle], [2 + x / 2, y / 2, angle]
    return in_steps(system, ts, np.stack([*crank, 1 + x, y, zero, *rocker], axis=1))


def bifurcation() -> Case:
    """Crank and rod of one length, from where they are upright and the slider may go either way,
    or stay where it is while the rod turns with the crank.
    """
    system = rj.assemble(slider_crank((0, 1), (0, 0), 1.0, ((-1, 0), (-2, 0)), gravity=False))
    ts = jnp.linspace(0.0, 8.0, 81)

    def places(angle):  # type: ignore[no-untyped-def]
        x, y = jnp.cos(angle), jnp.sin(angle)
        none = jnp.zeros_like(angle)
        return jnp.stack([x / 2, y / 2, angle, 1.5 * x, y / 2, -angle, 2 * x, none, none])

    masses = jnp.diag(system.mass(system.q0))
    return in_steps(system, ts, on_one_angle(places, masses, np.pi / 2, 1.0, ts))


def stiff() -> Case:
    """The cart-pendulum with a mode of 100 kHz, which hardly moves."""
    system = rj.assemble(rj.gallery.cart_pendulum(f2=1e5))
    ts = jnp.linspace(0.0, 1.0, 101)
    truth = rj.simulate(system, ts, rtol=1e-10, solver=rj.Rodas5P(), stabilization=rj.Projection())
    methods = {
        "romjax, Rodas5P": romjax(system, ts, rj.Rodas5P(), rtol=STIFF_RTOL),
        "romjax, Kvaerno5": romjax(system, ts, diffrax.Kvaerno5(), rtol=STIFF_RTOL),
        "textbook, Kvaerno5": textbook(system, ts, diffrax.Kvaerno5(), rtol=STIFF_RTOL),
    }
    return Case(system, ts, truth.q, methods)


CASES: dict[str, Callable[[], Case]] = {
    "hinge made once": falling,
    "hinge made twice": lambda: falling(twice=True),
    "coupler of 1e-8 kg": lambda: falling(1e-8),
    "coupler of 1e8 kg": lambda: falling(1e8),
    "change points": change_points,
    "bifurcation": bifurcation,
    "mode of 100 kHz": stiff,
}


class Found(NamedTuple):
    """What came of one method."""

    ms: float
    error: float
    outcome: str
    drift: float


def run(name: str) -> dict[str, Found]:
    """What came of each method of one case."""
    system, ts, truth, methods = CASES[name]()
    programs = [jax.jit(method) for method in methods.values()]
    calls = [lambda program=program: program(system.q0) for program in programs]
    root = np.linalg.cholesky(np.asarray(system.mass(system.q0)))
    size = np.linalg.norm((truth - truth[0]) @ root)
    found = {}
    for method, timed in zip(methods, least(calls, REPEATS, SLOW, name), strict=True):
        q, status = (np.asarray(x) for x in timed.result)
        whole = bool(np.isfinite(q).all())
        error = float(np.linalg.norm((q - truth) @ root) / size)
        violation = jax.vmap(system.constraint)(ts, jnp.asarray(q))
        kind = rj.Status(int(status))
        if not whole and kind is rj.Status.SUCCESS:
            kind = rj.Status.NOT_FINITE
        outcome = kind.name.lower().replace("_", " ")
        if kind is rj.Status.SUCCESS:
            outcome = "ok" if error < WRONG else "another motion"
        drift = float(np.max(np.abs(violation)))
        found[method] = Found(1e3 * timed.least, error, outcome, drift)
    return found


def measure() -> Iterator[record.Section]:
    """One table of all cases."""
    rows = [["case", "method", "outcome", "error", "largest |C|", "ms"]]
    every, ratios = {}, {}
    for name in CASES:
        every[name] = found = run(name)
        for method, one in found.items():
            error = f"{one.error:.1e}" if np.isfinite(one.error) else "-"
            drift = f"{one.drift:.0e}" if np.isfinite(one.error) else "-"
            row = [name, method, one.outcome, error, drift, f"{one.ms:.2f}"]
            rows.append(row)
        own, *_, other = found
        if found[own].outcome == found[other].outcome == "ok":
            ratios[f"{name}: textbook / romjax"] = found[other].ms / found[own].ms
    once, twice = (every[f"hinge made {times}"]["romjax"] for times in ("once", "twice"))
    if twice.outcome == "ok":
        ratios["hinge made once / twice"] = once.ms / twice.ms
    solved = sum(any(one.outcome == "ok" for one in found.values()) for found in every.values())
    ratios["cases that romjax solves / all"] = solved / len(CASES)
    yield record.Section(
        f"Dopri8 unless named; relative tolerance {RTOL:g}, of the mode of 100 kHz\n"
        f"{STIFF_RTOL:g}; change points and the bifurcation in steps of {STEP:g} s. Baumgarte's\n"
        f"stabilisation with 10 rad/s unless projected. Least of {REPEATS} interleaved runs under\n"
        "jax.jit. A failed run takes as long as it took to fail.",
        rows,
        ratios,
    )


if __name__ == "__main__":
    record.main(measure)
