"""What reduction saves and costs: errors and times of reduced models against the full model's best
method, at the same tolerance. Writes `reduction.txt` beside this file; for many at once, see
`batches.py`.
"""

import textwrap
from collections.abc import Iterator

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import record
from linkages import four_bar, slider_crank
from timing import least

import romjax as rj

REPEATS = 6
RTOL = 1e-8
EXPLICIT = (diffrax.Tsit5(), diffrax.Dopri8())
# Of reduced models, which keep no stiff part, Rodas5P never was the fastest.
SOLVERS = {"full": (rj.Rodas5P(), *EXPLICIT)}
PLAIN = {"adjoint": diffrax.ForwardMode(), "throw": False, "max_steps": 10_000}
SLOW = 2.0  # [s] what takes longer is measured once
USEFUL = 1e-3  # largest error of a model whose ratio is worth following


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


# Scene, end of the simulated time [s], ranks by formulation.
CASES = {
    "cart-pendulum": (
        rj.gallery.cart_pendulum,
        1.0,
        {"galerkin": (4, 5), "minimal": (3,), "projected": (5,)},
    ),
    "four-bar": (
        four_bar,
        2.0,
        {"galerkin": (5, 7), "minimal": (1,), "projected": (5,)},
    ),
    "slider crank": (
        lambda: slider_crank((0.3, 0.9), (1.5, 0.0), inertia=0.1),
        0.5,
        {"galerkin": (3,), "minimal": (1,), "projected": (3,)},
    ),
    "8 beams": (
        lambda: beams(8),
        1.0,
        {"galerkin": (40,), "minimal": (8, 16), "projected": (36,)},
    ),
}


def simulation(model, ts, solver):  # type: ignore[no-untyped-def]
    """A run under `jax.jit`, with the numbers of the model as arguments."""
    dynamic, static = eqx.partition(model, eqx.is_array)

    @jax.jit
    def run(dynamic):  # type: ignore[no-untyped-def]
        return rj.simulate(eqx.combine(dynamic, static), ts, rtol=RTOL, solver=solver, **PLAIN)

    return lambda: run(dynamic)


def compared(name: str) -> record.Section:
    """The models of one scene, each by its fastest method."""
    make, end, ranks = CASES[name]
    system, ts = rj.assemble(make()), jnp.linspace(0.0, end, 101)
    truth = rj.simulate(system, ts, rtol=1e-10, **PLAIN)
    models, refused = {("full", ""): system}, []
    for formulation, numbers in ranks.items():
        for rank in numbers:
            try:
                rom = rj.reduce(system, rj.pod(truth, rank=rank), formulation)
            except rj.ReductionError as refusal:
                refused.append(f"{formulation} r = {rank} is refused: {refusal}".rstrip("."))
                continue
            models[formulation, str(rank)] = rom
    labels = [(key, solver) for key in models for solver in SOLVERS.get(key[0], EXPLICIT)]
    calls = [simulation(models[key], ts, solver) for key, solver in labels]
    timed, ratios = least(calls, REPEATS, SLOW, name), {}
    rows = [["model", "r", "method", "steps", "ms", "error", "speed-up"]]
    for kind, rank in models:
        own = [one for (key, _), one in zip(labels, timed, strict=True) if key == (kind, rank)]
        good = [one for one in own if bool(one.result.success)]
        if not good:
            rows.append([kind, rank, "none", "", "", "failed"])
            continue
        best = min(good, key=lambda one: one.least)
        run, error = best.result, float(rj.compare(truth, best.result).error)
        steps = int(run.stats.num_steps)
        row = [kind, rank, run.solver_name, f"{steps}", f"{1e3 * best.least:.2f}", f"{error:.1e}"]
        if kind == "full":
            full = best.least
        else:
            row.append(f"{full / best.least:.1f}")
            if error < USEFUL:
                ratios[f"{name}: full / {kind} r = {rank}"] = full / best.least
        rows.append(row)
    text = textwrap.fill("; ".join([f"{name}, {end:g} s", *refused]) + ":", 88)
    return record.Section(text, rows, ratios)


def measure() -> Iterator[record.Section]:
    """A section for each scene."""
    yield record.Section(
        f"Relative tolerance {RTOL:g}; each model by its fastest method under jax.jit, least of\n"
        f"{REPEATS} interleaved runs; speed-up against the full model."
    )
    yield from map(compared, CASES)


if __name__ == "__main__":
    record.main(measure)
