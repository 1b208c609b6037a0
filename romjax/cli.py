"""The command line: the same verbs as the library."""

import argparse
import contextlib
import json
import os
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import diffrax
import jax
import numpy as np
from tabulate import tabulate

from . import command_results, plot
from .assembly.assemble import assemble
from .command_inputs import load, writable
from .command_parser import parser
from .common import writing
from .common.beside import beside
from .common.errors import InputError, SimulationError
from .files.begin import write_start
from .files.scene_file import scene_file
from .files.summary import describe_file
from .gallery.catalogue import EXAMPLES
from .pages import chapter, page, report
from .plot.png import png
from .study.accuracy.study import accuracy
from .study.fits.tune import tune_baumgarte
from .study.reduction import REFINEMENT, ReductionStudy, reduction_study
from .trials.reductions import reductions

T = TypeVar("T")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = parser().parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    status, failed = _told(lambda: _VERBS[options.verb](options))
    return failed if status is None else status


def _told(call: Callable[[], T]) -> tuple[T | None, int]:
    """Return the result of a call, and 0; None and an exit status if it fails, after saying why."""
    try:
        return call(), 0
    except (SimulationError, ValueError, OSError) as error:
        print(f"romjax: {error}", file=sys.stderr)
        return None, 2
    except KeyboardInterrupt:
        print("romjax: interrupted", file=sys.stderr)
        # Shells say so of a program that the signal 2 has ended: 128 and its number.
        return None, 130


def _scenes(options: argparse.Namespace) -> int:
    del options
    width = max(len(example.name) for example in EXAMPLES)
    print(f"{'scene':{width}}  freedoms")
    for example in EXAMPLES:
        print(f"{example.name:{width}}  {example.freedoms:8}  {example.title}")
    return 0


def _run(options: argparse.Namespace) -> int:
    example = load(options.scene)
    folder = writable(options.out or Path(f"romjax-{example.name}"))
    end, rate = _given(options.end, example.end), _given(options.rate, example.rate)
    if not (end > 0 and rate > 0 and end * rate >= 1 and options.budget > 0):
        raise InputError(
            f"run: end={end} s at rate={rate} Hz is no sample, or a budget of {options.budget:g} s "
            "no time; make them larger."
        )
    scene = example.make()
    system = assemble(scene)
    print(f"{example.name}: {example.title}")
    print(f"{system.n} coordinates, {system.m} constraints", flush=True)
    ranks = options.pod_rank, options.sod_rank, example.pod_rank, example.sod_rank
    asked = any(rank is not None for rank in ranks)
    of_chapter = bool(example.published_savings) or options.all or asked
    settings: dict[str, Any] = {
        "rtol": _given(options.rtol, example.rtol),
        "solver": example.solver,
        "budget": options.budget,
    }
    # The figures draw both over each other.
    ts = np.linspace(0.0, end, (REFINEMENT if of_chapter else 1) * round(end * rate) + 1)
    key = command_results.key_of(_run, scene, end, rate, settings, of_chapter and ranks)
    measured = None if options.again else command_results.load(key)
    studied, found, status = None, None, 0
    # Most of both studies is compiling, on one core each.
    with beside() if of_chapter else contextlib.nullcontext() as begin:
        if measured is None:
            studied = None if begin is None else begin(_of_chapter, options)
            result = reductions(scene, ts, progress=True, **settings)
        else:
            result, found, day = measured
            print(f"measured on {day} by the same command; --again measures anew")
        print(result.summary(options.all), flush=True)
        drawn = report.draw(result, scene, example, not options.no_animation, begin)
        if studied is not None:
            print(
                "POD and SOD, in the formulations of the chapter ...", file=sys.stderr, flush=True
            )
            found, status = _told(studied)
            if found is None:
                drawn = drawn._replace(filmed=None)  # that process may be no more
        if measured is None and status == 0:
            command_results.store(key, result, found)
        study, bases = found or (None, None)
        if study is not None:
            print(f"\n{chapter.summary(study, example)}")
        files = report.write(result, study, scene, example, folder, drawn, bases)
    print(f"\nWrote {files[0]}, a page with all of it, and beside it:")
    print(textwrap.fill(", ".join(file.name for file in files[1:]), 80))
    return status


def _of_chapter(options: argparse.Namespace) -> tuple[ReductionStudy, dict[str, bytes]]:
    """POD and SOD in all formulations of the chapter with pictures of the bases, in a process of
    its own.
    """
    jax.config.update("jax_enable_x64", True)
    example = load(options.scene)
    scene = example.make()
    study = reduction_study(
        assemble(scene),
        _given(options.end, example.end),
        _given(options.rate, example.rate),
        pod_rank=_given(options.pod_rank, example.pod_rank),
        sod_rank=_given(options.sod_rank, example.sod_rank),
        rtol=_given(options.rtol, example.rtol),
        solver=example.solver,
    )
    return study, report.of_bases(scene, study.bases)


def _accuracy(options: argparse.Namespace) -> int:
    example = load(options.scene)
    folder = writable(options.out or Path(f"romjax-{example.name}"))
    end, rate = _given(options.end, example.end), _given(options.rate, example.rate)
    if not (options.budget > 0 and end * rate >= 1):
        raise InputError(
            f"accuracy: a budget of {options.budget:g} s for {end:g} s at {rate:g} Hz; give time "
            "to spend, and at least one output."
        )
    ts = np.linspace(0.0, end, round(end * rate) + 1)
    result = accuracy(example.make(), ts, budget=options.budget, progress=True)
    title = f"What accuracy costs in time: {example.name}"
    files = page.write(result, title, folder)
    print(page.summary(result))
    print(f"\nWrote {', '.join(file.name for file in files)} to {folder}{os.sep}")
    return 0


def _tune(options: argparse.Namespace) -> int:
    example = load(options.scene)
    folder = writable(options.out or Path(f"romjax-{example.name}"))
    system = assemble(example.make())
    end = _given(options.end, example.end)
    result = tune_baumgarte(
        system,
        np.linspace(0.0, end, max(2, round(end * example.rate)) + 1),
        rtol=options.rtol,
        dt=options.dt,
        solver=diffrax.Tsit5(),
        steps=options.steps,
        progress=True,
    )
    rows = [
        [name, *(f"{float(x):.4g}" for x in (pair.alpha, pair.beta, loss, drift))]
        for name, pair, loss, drift in (
            ("start", result.start, result.loss[0], result.drift[0]),
            ("best", result.best, np.min(result.loss), result.drift[np.argmin(result.loss)]),
        )
    ]
    header = ["", "alpha [1/s]", "beta [1/s^2]", "loss", "largest |C|"]
    print(tabulate(rows, header, tablefmt="plain", disable_numparse=True))
    print(f"fastest rigid frequency: {result.frequency:.4g} rad/s")
    file = folder / "tuning.png"
    writing.write(file, png(plot.tuning(result), dpi=150))
    print(f"\nWrote {file}")
    return 0


def _new(options: argparse.Namespace) -> int:
    write_start(options.file, options.space)
    print(f"Wrote {options.file}. Next: romjax check {options.file}, romjax run {options.file}")
    return 0


def _check(options: argparse.Namespace) -> int:
    print(describe_file(scene_file(options.file)))
    return 0


def _schema(options: argparse.Namespace) -> int:
    from .files.schema import json_schema

    del options
    print(json.dumps(json_schema(), indent=1))
    return 0


def _given(option: Any, default: Any) -> Any:
    """Return the option as it was given, zero included, or else the default."""
    return default if option is None else option


_VERBS = {
    "scenes": _scenes,
    "run": _run,
    "accuracy": _accuracy,
    "tune": _tune,
    "new": _new,
    "check": _check,
    "schema": _schema,
}
