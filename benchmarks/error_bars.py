"""What `romjax.corrected` tells of the errors of reduced runs, against what they are.

Starts, and numbers of the mechanism, are drawn by a seed, and no snapshot is from them. The ratio
of both is one where the estimate is right. What the bar costs is counted in runs of the full and of
the reduced model, all at one tolerance, by the time of a processor. Writes `error_bars.txt` beside
this file.
"""

import dataclasses
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import record
from linkages import bending_four_bar
from reduced_scenes import CASES, Case
from timing import least
from tqdm import tqdm

import romjax as rj
from romjax.reduction.formulation.parse import as_formulation
from romjax.study.accuracy.model import capped
from romjax.study.errors.corrected import corrected_with
from romjax.study.errors.flow import Flows
from romjax.study.errors.richer import finer_of

RTOL = 1e-8
REPEATS, SLOW = 10, 2.0
HEADER = ["model", "error", "bar / error", "flow / error", "outputs", "forces", "refused"]
HEADER += ["full runs", "reduced runs"]
FLOWS = ("8 beams",)
# A start at which the linear equation of errors about the accelerations of the full system, and not
# of the model, grows without bound.
TRAP, TRAPPED = {"spin": 0.047, "tilt": 0.151}, ("8 beams", "minimal 8")
USABLE = 0.05  # beyond it the bar says that the run is not to be used
WITHIN = 2.0  # of estimates over true errors of outputs, and one over it
LEAST = 1e-6  # relative to the reach of an output; below it ratios mean nothing


class Judged(NamedTuple):
    """One run: its true error, its bar, that by the flow along the training, whether the bar says
    not to use it, and the ratios of its outputs that are large enough: the last body's place at the
    end, and its mean angle (in space its mean height); and that of the largest joint force.
    """

    error: float
    bar: float
    flow: float
    refused: bool
    outputs: tuple[float, ...]
    force: float


class Judging(NamedTuple):
    """A mechanism, the motions that no snapshot is from, and the models that are judged."""

    case: Case
    others: Sequence[dict[str, float]]
    models: tuple[tuple[str, int], ...]


def starts(count: int) -> list[dict[str, float]]:
    """Spins [rad/s] and tilts [rad], half as large, of sizes from 0.005 to 1."""
    lot, found = np.random.default_rng(7), []
    for _ in range(count):
        size, angle = np.exp(lot.uniform(np.log(0.005), 0.0)), lot.uniform(0, 2 * np.pi)
        found.append({"spin": size * np.cos(angle), "tilt": 0.5 * size * np.sin(angle)})
    return found


def drawn(seed: int, count: int, **ranges: tuple[float, float]) -> list[dict[str, float]]:
    """Numbers for a scene, each between two."""
    lot, (low, high) = np.random.default_rng(seed), zip(*ranges.values(), strict=True)
    return [dict(zip(ranges, lot.uniform(low, high), strict=True)) for _ in range(count)]


ARM = Case(rj.gallery.spatial_arm, 1.5, (), (), truth=(rj.Rodas5P(), 1e-10))
FOUR_BAR = Case(bending_four_bar, 1.0, (), ())
JUDGED = {
    "8 beams": Judging(
        CASES["8 beams"], starts(24), (("minimal", 8), ("minimal", 16), ("local", 8))
    ),
    "cart-pendulum": Judging(
        CASES["cart-pendulum"],
        drawn(11, 20, force=(5.0, 15.0), frequency=(8.0, 12.0), f1=(14.0, 18.0)),
        (("galerkin", 3), ("galerkin", 4), ("galerkin", 5), ("minimal", 3), ("cap", 40)),
    ),
    "32 segments": Judging(
        CASES["32 segments"],
        starts(20),
        (("minimal", 4), ("minimal", 6), ("hyper", 4), ("hyper", 6)),
    ),
    "arm in space": Judging(
        ARM,
        drawn(13, 20, load=(0.5, 2.5), EI=(600.0, 1400.0)),
        (("local", 1), ("local", 3), ("minimal", 5)),
    ),
    "driven four-bar": Judging(
        FOUR_BAR, drawn(17, 20, speed=(8.0, 12.0), EI=(5.0, 10.0)), (("local", 1), ("minimal", 1))
    ),
}


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


def largest_force(system: rj.AbstractSystem, run: rj.Trajectory) -> float:
    """The largest force of a joint [N]."""
    forces = rj.joint_forces(system, run).stacked
    return float(max(np.max(np.linalg.norm(np.asarray(x.force), axis=-1)) for x in forces))


def judged(
    full: rj.AbstractSystem, model: rj.AbstractSystem, truth: rj.Trajectory, flows: Flows | None
) -> Judged:
    """One run of a model, from its own start."""
    run = rj.simulate(model, truth.t, rtol=RTOL, audit=False, throw=False)
    corrected, richer = corrected_with(model, run)
    right, own, told = map(outputs, (truth, run, corrected))
    true, estimated = np.abs(right - own), np.abs(told - own)
    large = true > LEAST * max(1.0, float(np.max(np.abs(right))))
    pairs = (full, truth), (model, run), (richer, corrected)
    force, own_force, told_force = (largest_force(*pair) for pair in pairs)
    off = abs(force - own_force)
    by_force = abs(told_force - own_force) / off if off > LEAST * force else np.nan
    return Judged(
        float(rj.compare(truth, run).error),
        float(rj.compare(corrected, run).error),
        by_flow(flows, model, run),
        bool(corrected.flags & rj.Flag.ESTIMATE),
        tuple(float(x) for x in estimated[large] / true[large]),
        by_force,
    )


def share(ratios: Sequence[float]) -> float:
    """Of those that are near one; NaN where none is known."""
    known = np.array([x for x in ratios if np.isfinite(x)])
    near = (known <= WITHIN) & (known >= 1 / WITHIN)
    return float(np.mean(near)) if len(known) else np.nan


def percent(share: float) -> str:
    """In words; "-" where none is known."""
    return f"{share:.0%}" if np.isfinite(share) else "-"


def cost(full: rj.AbstractSystem, model: rj.AbstractSystem, ts: Any) -> tuple[float, float]:
    """What the bar of a run takes of a processor, in runs of the full and of the reduced model."""
    run = rj.simulate(model, ts, rtol=RTOL, audit=False)
    calls = [
        lambda: rj.corrected(model, run),
        lambda: rj.simulate(full, ts, rtol=RTOL, audit=False),
        lambda: rj.simulate(model, ts, rtol=RTOL, audit=False),
    ]
    bar, whole, own = least(calls, REPEATS, SLOW, "cost", clock=time.process_time)
    return bar.least / whole.least, bar.least / own.least


def by_residual(case: Case, rom: Any, ts: Any) -> float:
    """What the residual tells of the error, over the error, from the start that is a trap."""
    system = case.system(**TRAP)
    model = rom.with_full(system).starting_at(system.q0, system.v0)
    truth = rj.simulate(system, ts, solver=case.truth[0], rtol=case.truth[1], audit=False)
    run = rj.simulate(model, ts, rtol=RTOL, audit=False)
    corrected = rj.corrected(model, run, by="residual")
    return float(rj.compare(corrected, run).error) / float(rj.compare(truth, run).error)


def section(name: str, judging: Judging) -> record.Section:
    """The table of one mechanism, and the ratios that have floors."""
    case, others, models = judging
    ts = jnp.linspace(0.0, case.end, 101)
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
        pairs = list(zip(systems, made, truths, strict=True))
        found = [judged(*pair, flows) for pair in tqdm(pairs, leave=False)]
        error = np.array([x.error for x in found])
        ratio = np.array([x.bar for x in found]) / error
        flow = np.array([x.flow for x in found]) / error
        usable = [one for one in found if one.error <= USABLE]
        near = share([x for one in usable for x in one.outputs])
        forces = share([one.force for one in usable])
        taken = cost(systems[0], made[0], ts)
        model = f"{kind} {rank}"
        rows.append(
            [
                model,
                f"{np.min(error):.0e} to {np.max(error):.0e}",
                f"{np.min(ratio):.3f} to {np.max(ratio):.3f}",
                "-" if flows is None else f"{np.min(flow):.2f} to {np.max(flow):.2f}",
                percent(near),
                percent(forces),
                f"{sum(x.refused for x in found)} of {np.sum(error > USABLE)}",
                *(f"{x:.2f}" for x in taken),
            ]
        )
        ratios[f"{name}, {model}: least ratio"] = float(np.min(ratio))
        ratios[f"{name}, {model}: 1 / largest"] = float(1 / np.max(ratio))
        shares = {"outputs": near, "joint forces": forces}
        ratios |= {
            f"{name}, {model}: {what} within {WITHIN:g} times": x
            for what, x in shares.items()
            if np.isfinite(x)
        }
        if (name, model) == TRAPPED:
            ratios[f"{name}, {model}: 1 / by the residual"] = 1 / by_residual(case, rom, ts)
        if flows is not None:
            ratios[f"{name}, {model}: flow, least ratio"] = float(np.min(flow))
            ratios[f"{name}, {model}: flow, 1 / largest"] = float(1 / np.max(flow))
    return record.Section(
        f"{name}: {len(others)} motions that no snapshot is from; bars over true errors, by a\n"
        "richer run and by the flow along the training run, the shares of outputs and of\n"
        f"largest joint forces within {WITHIN:g} times, how many runs are refused of those that\n"
        "err by more than 5 %, and what the bar of a richer run costs:",
        rows,
        ratios,
    )


def kept(resume: Path | None) -> dict[str, record.Section]:
    """What a run before has measured, by the names of mechanisms."""
    lines = resume.read_text().splitlines() if resume and resume.exists() else []
    found = [json.loads(line) for line in lines]
    return {one.pop("case"): record.Section(**one) for one in found}


def measure(
    cases: Sequence[str] = tuple(JUDGED), resume: Path | None = None
) -> Iterator[record.Section]:
    """One table for each mechanism."""
    before = kept(resume)
    for name in cases:
        found = before.get(name) or section(name, JUDGED[name])
        if resume and name not in before:
            parts = {"text": found.text, "rows": found.rows, "ratios": found.ratios}
            with resume.open("a") as file:
                file.write(json.dumps({"case": name, **parts}) + "\n")
        yield found


CHOICES = {
    "cases": {"nargs": "+", "choices": tuple(JUDGED), "default": tuple(JUDGED)},
    "resume": {
        "type": Path,
        "metavar": "FILE",
        "help": "file of JSON lines to which each mechanism is added as soon as it is measured; "
        "those that are in it are not measured again",
    },
}

if __name__ == "__main__":
    record.main(measure, choices=CHOICES)
