"""What reduction costs and gains: reduced models against the full one, each at its best method.

Errors are on the run that the model was trained with, and the largest one of ten that no snapshot
is from. Of each model the method is the fastest one that succeeds.
"""

import os
import textwrap
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax.numpy as jnp
import record
from reduced_scenes import CASES, Case
from timing import Timed, least

import romjax as rj
from romjax.reduction.formulation.parse import as_formulation

REPEATS = 6
RTOL = 1e-8
MAX_STEPS = 100_000
SLOW = 2.0  # [s] what takes longer is measured once
USEFUL = 1e-3  # largest error, held out too, of a model whose ratio is worth following


class Model(NamedTuple):
    """A model of the training, `of` other systems of the case, and how long it took to make [s]."""

    name: str
    rank: str
    system: Any
    of: Callable[[dict[str, float], rj.AbstractSystem], Any]
    made: float


def runs(ts: Any, solver: Any, rtol: float = RTOL) -> Callable[[Any], rj.Trajectory]:
    """A run of any model, as a user writes it."""
    return lambda model: rj.simulate(
        model, ts, rtol=rtol, solver=solver, throw=False, max_steps=MAX_STEPS
    )


def models(case: Case, training: rj.Trajectory) -> Iterator[Model | str]:
    """The models of a case, and why others are refused."""
    system = case.system()
    yield Model("full", "", system, lambda _, full: full, 0.0)
    for name, number in case.models:
        begin = time.perf_counter()
        if name == "cap":
            capped = case.system(number)
            taken = time.perf_counter() - begin
            of = lambda numbers, _, cap=number: case.system(cap, **numbers)  # noqa: E731
            yield Model("capped", f"{number} Hz", capped, of, taken)
            continue
        try:
            basis = as_formulation(name).basis(system, training, rj.POD(number))
            rom: Any = rj.reduce(system, basis, name)
        except rj.ReductionError as refusal:
            yield f"{name} r = {number} is refused: {refusal}".rstrip(".")
            continue
        taken = time.perf_counter() - begin
        of = lambda _, full, rom=rom: rom.with_full(full).starting_at(full.q0, full.v0)  # noqa: E731
        yield Model(name, str(number), rom, of, taken)


def compared(name: str) -> Iterator[record.Section]:
    """The models of one case: what they gain, then what they cost."""
    case = CASES[name]
    ts = jnp.linspace(0.0, case.end, 101)
    system = case.system()
    exact = runs(ts, *case.truth)
    truth = exact(system)
    others = [(numbers, case.system(**numbers)) for numbers in case.others]
    truths = [exact(full) for _, full in others]
    tried = list(models(case, truth))
    made = [one for one in tried if isinstance(one, Model)]
    configurations = [
        (model, runs(ts, solver))
        for model in made
        for solver in (case.full if model.name == "full" else case.reduced)
    ]
    calls = [lambda m=model, run=run: run(m.system) for model, run in configurations]
    timed = list(zip(configurations, least(calls, REPEATS, SLOW, name), strict=True))
    gains = [["model", "r", "method", "steps", "ms", "trained", "held out", "speed-up"]]
    costs = [["model", "r", "µs/step", "made s", "compiled s", "pays after runs"]]
    ratios, full = {}, float("nan")
    for model in made:
        good = [
            (one, run)
            for ((other, run), one) in timed
            if other is model and bool(one.result.success)
        ]
        if not good:
            gains.append([model.name, model.rank, "none", "", "", "failed"])
            continue
        best, run = min(good, key=lambda pair: pair[0].least)
        steps = int(best.result.stats.num_steps)
        error = float(rj.compare(truth, best.result).error)
        held = [
            float(rj.compare(right, run(model.of(numbers, other))).error)
            for (numbers, other), right in zip(others, truths, strict=True)
        ]
        row = [model.name, model.rank, best.result.solver_name, f"{steps}"]
        row += [f"{1e3 * best.least:.2f}", f"{error:.1e}", f"{max(held):.1e}"]
        if model.name == "full":
            full = best.least
        else:
            row.append(f"{full / best.least:.1f}")
            if max(error, *held) < USEFUL:
                words = f"r = {model.rank}" if model.rank.isdigit() else model.rank
                ratios[f"{name}: full / {model.name} {words}"] = full / best.least
        gains.append(row)
        costs.append([model.name, model.rank, *cost(model, best, steps, full)])
    refused = [one for one in tried if isinstance(one, str)]
    text = textwrap.fill("; ".join([f"{name}, {case.end:g} s", *refused]) + ":", 88)
    yield record.Section(text, gains, ratios)
    yield record.Section(f"{name}, what the models cost:", costs)


def cost(model: Model, best: Timed, steps: int, full: float) -> list[str]:
    """Time of a step, to reduce and to compile, and the runs after which both are paid for."""
    compiled = max(0.0, best.first - best.least)
    words = [f"{1e6 * best.least / steps:.1f}", f"{model.made:.1f}", f"{compiled:.1f}"]
    if best.least >= full:
        return [*words, "" if model.name == "full" else "never"]
    return [*words, f"{(model.made + compiled) / (full - best.least):.0f}"]


def measure() -> Iterator[record.Section]:
    """Sections for each case."""
    yield record.Section(
        f"Relative tolerance {RTOL:g}; each model by its fastest method, least of {REPEATS}\n"
        "interleaved runs; speed-up against the full model. Held out: the largest error of ten\n"
        "starts or sets of numbers that no snapshot is from. Compiled: of the first call, without\n"
        "a cache; 0 where the run that errors are measured by is by the same program."
    )
    for name in CASES:
        yield from compared(name)


if __name__ == "__main__":
    os.environ["ROMJAX_CACHE_DIR"] = ""  # so that compile times are those of a new structure
    record.main(measure)
