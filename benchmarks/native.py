"""Compiled models against `simulate`, MuJoCo, elements of nodes, and within programs of JAX.

Times are those of a processor, so that other programs on the machine do not count, and calls take
turns; only of two cores the clock on the wall counts. `--rows` takes those whose table or name
has one of some words, and `--resume` a file to which each row is added as soon as it is measured.
"""

import json
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import native_inside
import native_models
import native_ways
import numpy as np
import peers
import record
from native_models import MODELS, TS, error, first_runs, on_processor
from timing import least

import romjax as rj

REPEATS = 12
RTOLS = (1e-4, 1e-6, 1e-8)
TIGHT = 1e-11
CHAINS = (1, 2, 8, 32, 64)
# Of MuJoCo, each a fifth more than the one before.
STEPS = [round(16 * 2 ** (k / 4)) for k in range(32)]
FIRST = 3.0  # [s] of a processor, from an empty cache, which is asked of models up to n = 24


class Row(NamedTuple):
    """Lines of a table, and their ratios."""

    lines: list[list[str]]
    ratios: dict[str, float]


class Table(NamedTuple):
    """A table of the record: what stands above it, its header, and its rows by name."""

    text: str
    header: list[str]
    rows: dict[str, Callable[[], Row]]


def run_of(name: str) -> Row:
    """Whole runs of a model at several tolerances, and their errors."""
    system = MODELS[name]()
    model = rj.compile(system)
    found = Row([], {})
    usual = rj.simulate(system, TS, audit=False)
    settings = {"solver": usual.solver, "stabilization": usual.stats.stabilization}
    truth = rj.simulate(system, TS, rtol=TIGHT, max_steps=None, audit=False, **settings)
    for rtol in RTOLS:
        calls = [
            lambda rtol=rtol: model.simulate(TS, rtol=rtol),
            lambda rtol=rtol: rj.simulate(system, TS, rtol=rtol, audit=False),
        ]
        one, other = least([on_processor(call) for call in calls], REPEATS, name=name)
        errors = [error(x.result, truth) for x in (one, other)]
        steps, most = int(one.result.stats.num_steps), max(model.operations.values())
        cells = [name, f"{rtol:.0e}", f"{system.n}", f"{most}", f"{steps}"]
        cells += [f"{x:.1e}" for x in errors]
        found.lines.append([*cells, *(f"{1e3 * x.least:.3f}" for x in (one, other))])
        at = f"{name} at {rtol:.0e}".replace("e-0", "e-")
        found.ratios[f"{at}: simulate / native"] = other.least / one.least
        found.ratios[f"{at}: 2 x error of simulate / native"] = 2 * errors[1] / errors[0]
    return found


def beside_mujoco(bars: int) -> Row:
    """A chain of bars, of which MuJoCo takes the fewest steps that err no more at the end."""
    system, ends = rj.assemble(rj.gallery.chain(bars)), TS[[0, -1]]
    model = rj.compile(system)
    usual = rj.simulate(system, ends, audit=False)
    settings = {"solver": usual.solver, "stabilization": usual.stats.stabilization}
    truth = np.asarray(rj.simulate(system, ends, rtol=TIGHT, audit=False, **settings).q[-1])

    def off(q: Any) -> float:
        return float(np.max(np.abs(np.asarray(q) - truth)))

    run = model.simulate(ends)
    other = peers.mujoco_chain(bars, time.process_time)
    steps = next(n for n in STEPS if off(other(n).result[0]) <= off(run.q[-1]))
    calls = [on_processor(lambda: model.simulate(ends)), lambda: other(steps)]
    # Of the call, the loops in C alone: MuJoCo's clock leaves out Python, too.
    calls.insert(1, on_processor(native_models.loops_of(model, ends)))
    whole, loops, theirs = least(calls, REPEATS, name=f"{bars} bars")
    errors = [off(run.q[-1]), off(theirs.result[0])]
    cells = [f"{bars}", f"{int(run.stats.num_steps)}", f"{steps}", *(f"{x:.1e}" for x in errors)]
    cells += [f"{1e3 * x.least:.3f}" for x in (loops, theirs, whole)]
    return Row([cells], {f"chain of {bars}: MuJoCo / native": theirs.least / loops.least})


def bent() -> Row:
    """A rod that bends far, by four shapes, and by 64 elements between nodes, which err as much."""
    few, many = (native_models.rod(native_models.ANGLE, count) for count in (4, 12))
    rod, nodes = rj.assemble(few), rj.assemble(native_models.nodes(native_models.ANGLE, 64))
    model = rj.compile(rod)
    fine = rj.simulate(rj.assemble(many), TS, rtol=1e-9, audit=False)
    truth = native_models.tip_of_rod(many, fine)
    calls = [
        lambda: model.simulate(TS),
        lambda: rj.simulate(rod, TS, audit=False),
        lambda: rj.simulate(nodes, TS, audit=False),
    ]
    timed = least([on_processor(call) for call in calls], REPEATS, 0.2, "a rod")
    names = ["4 shapes, compiled", "4 shapes, simulate", "64 elements, simulate"]
    tips = [native_models.tip_of_rod(few, x.result) for x in timed[:2]]
    tips.append(native_models.tip_of_nodes(timed[2].result))
    size = np.sqrt(np.mean(np.sum(truth**2, axis=1)))
    lines = []
    for name, one, tip in zip(names, timed, tips, strict=True):
        off = np.sqrt(np.mean(np.sum((tip - truth) ** 2, axis=1))) / size
        steps = int(one.result.stats.num_steps)
        lines.append([name, f"{one.result.q.shape[1]}", f"{steps}", f"{off:.1e}"])
        lines[-1].append(f"{1e3 * one.least:.3f}")
    return Row(lines, {"rod: 64 elements / 4 shapes": timed[2].least / timed[0].least})


def first_of(name: str) -> Row:
    """The first run of a model from an empty cache, and that of `simulate`."""
    native, usual = (first_runs(name, is_native) for is_native in (True, False))
    ratios = {
        f"{FIRST:g} s / first run of {name}": FIRST / native,
        f"first run of {name}: simulate / native": usual / native,
    }
    return Row([[name, f"{native:.2f}", f"{usual:.2f}"]], ratios)


TABLES = {
    "runs": Table(
        "Runs of 1 s with 101 outputs by the default method; error of positions and velocities,\n"
        "relative to the largest; times [ms], simulate without its audit:",
        ["model", "rtol", "n", "operations", "steps", "error", "of simulate", "ms", "simulate"],
        {name: lambda name=name: run_of(name) for name in MODELS},
    ),
    "mujoco": Table(
        "The last positions of chains after 1 s at rtol = 1e-6, and MuJoCo's RK4 in minimal\n"
        "coordinates in the fewest steps that err no more; loops in C and mj_step [ms], and the\n"
        "whole call of the compiled model:",
        ["bars", "steps", "MuJoCo", "error", "of MuJoCo", "ms", "MuJoCo's", "call"],
        {f"{n} bars": lambda n=n: beside_mujoco(n) for n in CHAINS},
    ),
    "rod": Table(
        "A pendulum that bends far, from a start of 0.5 rad, against 12 shapes; its tip, ms:",
        ["model", "n", "steps", "error", "ms"],
        {"rod": bent},
    ),
    "first": Table(
        "From an empty cache to the first run, with assembly, emission and the C compiler; a\n"
        "processor's time of a fresh process and the compiler [s]:",
        ["model", "compiled", "simulate"],
        {name: lambda name=name: first_of(name) for name in native_models.SMALL},
    ),
    "inside": Table(
        "The cart's minimal model of rank 3 within jit, and 256 starts of it under vmap [ms]; two\n"
        "cores by the clock on the wall:",
        ["what", "compiled", "compared with", "which is"],
        {name: lambda f=f: Row(*f()) for name, f in native_inside.INSIDE.items()},
    ),
    "ways": Table(
        "One second of the cart's minimal model of rank 3 with 101 outputs at rtol = 1e-6, in\n"
        "each way in which it leaves; a processor's time [ms], and the error of x of the cart:",
        ["way", "ms", "error"],
        {"ways": lambda: Row(*native_ways.ways())},
    ),
    "identified": Table(
        "Two parameters of the full cart by `fit`, and of a pendulum by NUTS of numpyro, the\n"
        "programs compiled before, and with all that is compiled and warmed up for it [s]:",
        ["what", "compiled", "simulate", "differ, in standard errors"],
        {name: lambda f=f: Row(*f()) for name, f in native_inside.IDENTIFIED.items()},
    ),
}


def kept(resume: Path | None) -> dict[tuple[str, str], Row]:
    """What a run before has measured, by table and row."""
    if resume is None or not resume.exists():
        return {}
    lines = map(json.loads, resume.read_text().splitlines())
    return {(x["table"], x["row"]): Row(x["lines"], x["ratios"]) for x in lines}


def measure(rows: list[str], resume: Path | None) -> Iterator[record.Section]:
    """One table after the other, of those rows that are asked for."""
    before, failures = kept(resume), []
    for table, (text, header, each) in TABLES.items():
        names = [name for name in each if not rows or any(x in f"{table} {name}" for x in rows)]
        found: dict[str, Row] = {}
        for name in names:
            try:
                found[name] = before.get((table, name)) or each[name]()
            except Exception as failure:  # the others are worth measuring
                traceback.print_exc()
                failures.append(f"{table} {name}: {failure}")
                continue
            if resume is not None and (table, name) not in before:
                with resume.open("a") as file:
                    line = {"table": table, "row": name, **found[name]._asdict()}
                    file.write(json.dumps(line) + "\n")
            print(table, *found[name], file=sys.stderr, flush=True)
            jax.clear_caches()
        lines = [line for row in found.values() for line in row.lines]
        ratios = {key: value for row in found.values() for key, value in row.ratios.items()}
        if lines:
            yield record.Section(text, [header, *lines], ratios, peers.missing())
    if failures:
        raise RuntimeError("; ".join(failures))


if __name__ == "__main__":
    record.main(
        measure,
        choices={
            "rows": {"nargs": "*", "default": [], "metavar": "WORD", "help": "these rows only"},
            "resume": {
                "type": Path,
                "metavar": "FILE",
                "help": "file of JSON lines to which each row is added as soon as it is measured; "
                "those that are in it are not measured again",
            },
        },
    )
