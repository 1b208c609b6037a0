"""What `romjax.corrected` tells of the errors of reduced runs, against what they are.

Starts, and numbers of the mechanism, are drawn by a seed, and no snapshot is from them. The ratio
of both is one where the estimate is right. What the bar costs is counted in runs of the full and of
the reduced model, all at one tolerance. Writes `error_bars.txt` beside this file.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import record
from reduced_scenes import CASES, Case
from timing import least
from tqdm import tqdm

import romjax as rj
from romjax.reduction.formulation.parse import as_formulation
from romjax.study.accuracy.model import capped
from romjax.study.flow import Flows
from romjax.study.richer import finer_of

RTOL = 1e-8
REPEATS, SLOW = 10, 2.0
HEADER = ["model", "error", "bar / error", "flow / error", "outputs", "refused"]
HEADER += ["full runs", "reduced runs"]
FLOWS = ("8 beams",)
USABLE = 0.05  # beyond it the bar says that the run is not to be used
WITHIN = 2.0  # of estimates over true errors of outputs, and one over it
LEAST = 1e-6  # relative to the reach of an output; below it ratios mean nothing
# By case: how many motions are unseen, and the models that are judged.
MODELS: dict[str, tuple[int, tuple[tuple[str, int], ...]]] = {
    "8 beams": (24, (("minimal", 8), ("minimal", 16), ("local", 8))),
    "cart-pendulum": (
        20,
        (("galerkin", 3), ("galerkin", 4), ("galerkin", 5), ("minimal", 3), ("cap", 40)),
    ),
    "32 segments": (20, (("minimal", 4), ("minimal", 6), ("hyper", 4), ("hyper", 6))),
}


class Judged(NamedTuple):
    """One run: its true error, its bar, that by the flow along the training, whether the bar says
    not to use it, and the ratios of its outputs that are large enough: the last body's place at the
    end, and its mean angle.
    """

    error: float
    bar: float
    flow: float
    refused: bool
    outputs: tuple[float, ...]


def starts(count: int) -> list[dict[str, float]]:
    """Spins [rad/s] and tilts [rad], half as large, of sizes from 0.005 to 1."""
    lot, found = np.random.default_rng(7), []
    for _ in range(count):
        size, angle = np.exp(lot.uniform(np.log(0.005), 0.0)), lot.uniform(0, 2 * np.pi)
        found.append({"spin": size * np.cos(angle), "tilt": 0.5 * size * np.sin(angle)})
    return found


def loads(count: int) -> list[dict[str, float]]:
    """Forces and frequencies of the cart, and the first mode of the pendulum."""
    lot, found = np.random.default_rng(11), []
    for _ in range(count):
        force, frequency, f1 = lot.uniform((5.0, 8.0, 14.0), (15.0, 12.0, 18.0))
        found.append({"force": force, "frequency": frequency, "f1": f1})
    return found


def outputs(run: rj.Trajectory) -> np.ndarray:
    """The place of the last body at the end, and its mean angle."""
    last = max(i for i, label in enumerate(run.labels) if label.endswith(".x"))
    q = np.asarray(run.q)
    return np.array([q[-1, last], q[-1, last + 1], np.mean(q[:, last + 2])])


def by_flow(flows: Flows | None, model: Any, run: rj.Trajectory) -> float:
    """The error of a run by the flow along the training run, which is no run of the model itself;
    NaN without one.
    """
    if flows is None:
        return np.nan
    change, _ = flows.error(model, run, model.full.q0, model.full.v0)
    return float(rj.compare(dataclasses.replace(run, q=run.q + change), run).error)


def judged(model: rj.AbstractSystem, truth: rj.Trajectory, flows: Flows | None) -> Judged:
    """One run of a model, from its own start."""
    run = rj.simulate(model, truth.t, rtol=RTOL, audit=False, throw=False)
    corrected = rj.corrected(model, run)
    right, own, told = map(outputs, (truth, run, corrected))
    true, estimated = np.abs(right - own), np.abs(told - own)
    large = true > LEAST * max(1.0, float(np.max(np.abs(right))))
    return Judged(
        float(rj.compare(truth, run).error),
        float(rj.compare(corrected, run).error),
        by_flow(flows, model, run),
        bool(corrected.flags & rj.Flag.ESTIMATE),
        tuple(float(x) for x in estimated[large] / true[large]),
    )


def cost(full: rj.AbstractSystem, model: rj.AbstractSystem, ts: Any) -> tuple[float, float]:
    """The time of the bar in runs of the full and of the reduced model."""
    run = rj.simulate(model, ts, rtol=RTOL, audit=False)
    calls = [
        lambda: rj.corrected(model, run),
        lambda: rj.simulate(full, ts, rtol=RTOL, audit=False),
        lambda: rj.simulate(model, ts, rtol=RTOL, audit=False),
    ]
    bar, whole, own = least(calls, REPEATS, SLOW, "cost")
    return bar.least / whole.least, bar.least / own.least


def section(name: str, case: Case) -> record.Section:
    """The table of one mechanism, and the ratios that have floors."""
    count, models = MODELS[name]
    ts = jnp.linspace(0.0, case.end, 101)
    others = loads(count) if name == "cart-pendulum" else starts(count)
    systems = [case.system(**numbers) for numbers in others]
    method = {"solver": case.truth[0], "rtol": case.truth[1], "audit": False}
    training = rj.simulate(case.system(), ts, **method)
    truths = [rj.simulate(one, ts, **method) for one in tqdm(systems, name, leave=False)]
    rows = [HEADER]
    ratios = {}
    for kind, rank in models:
        flows = None
        if kind == "cap":
            made = [capped(one, float(rank)) for one in systems]
        else:
            chosen = as_formulation(kind)
            basis = chosen.basis(training.system, training, rj.POD(rank))
            rom: Any = rj.reduce(training.system, basis, chosen)
            made = [rom.with_full(one).starting_at(one.q0, one.v0) for one in systems]
            if name in FLOWS and (finer := finer_of(rom)):
                flows = Flows.along(finer[0].model, [training.system], ts, RTOL)
        pairs = list(zip(made, truths, strict=True))
        found = [judged(*pair, flows) for pair in tqdm(pairs, leave=False)]
        error = np.array([x.error for x in found])
        ratio = np.array([x.bar for x in found]) / error
        flow = np.array([x.flow for x in found]) / error
        seen = np.array([x for one in found if one.error <= USABLE for x in one.outputs])
        near = np.mean((seen <= WITHIN) & (seen >= 1 / WITHIN)) if len(seen) else np.nan
        taken = cost(systems[0], made[0], ts)
        model = f"{kind} {rank}"
        rows.append(
            [
                model,
                f"{np.min(error):.0e} to {np.max(error):.0e}",
                f"{np.min(ratio):.3f} to {np.max(ratio):.3f}",
                "-" if flows is None else f"{np.min(flow):.2f} to {np.max(flow):.2f}",
                f"{near:.0%}",
                f"{sum(x.refused for x in found)} of {np.sum(error > USABLE)}",
                *(f"{x:.2f}" for x in taken),
            ]
        )
        ratios[f"{name}, {model}: least ratio"] = float(np.min(ratio))
        ratios[f"{name}, {model}: 1 / largest"] = float(1 / np.max(ratio))
        if flows is not None:
            ratios[f"{name}, {model}: flow, least ratio"] = float(np.min(flow))
            ratios[f"{name}, {model}: flow, 1 / largest"] = float(1 / np.max(flow))
    return record.Section(
        f"{name}: {count} motions that no snapshot is from; bars over true errors, by a\n"
        "richer run and by the flow along the training run, the share of outputs within\n"
        f"{WITHIN:g} times, how many runs are refused of those that err by more than 5 %, and\n"
        "what the bar of a richer run costs:",
        rows,
        ratios,
    )


def measure(cases: Sequence[str] = tuple(MODELS)) -> Iterator[record.Section]:
    """One table for each mechanism."""
    for name in cases:
        yield section(name, CASES[name])


CHOICES = {"cases": {"nargs": "+", "choices": tuple(MODELS), "default": tuple(MODELS)}}

if __name__ == "__main__":
    record.main(measure, choices=CHOICES)
