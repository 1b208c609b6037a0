"""All comparisons side by side: run each, compare its ratios with their floors, write summary.txt.

Each comparison runs in a process of its own and writes NAME.txt, and NAME.json for the site; those
that are named run alone: `python -m benchmarks verification`. The ratios of all, the versions and
the machine go to summary.txt, those of comparisons that are not run as their records have them.
Needs the extra `bench`; MuJoCo and Exudyn are left out where they are not installed. All take about
two and a half hours on two cores with nothing else to do, most of it for `trust`; Ctrl-C keeps what
has been measured.

The exit status is 1 if a ratio is below its floor in floors.toml, if one that has a floor was not
measured, or if a comparison did not run to its end; 130 after Ctrl-C; otherwise 0.
"""

import argparse
import ast
import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # `python -m` puts the folder above there

import record  # noqa: E402
import texts  # noqa: E402

# In the order of the table; each a file beside this one.
COMPARISONS = (
    "first_call",
    "work_precision",
    "reduction",
    "segments",
    "far_bending",
    "batches",
    "native",
    "gradients",
    "hard_cases",
    "effects",
    "scaling",
    "implicit",
    "spatial",
    "joint",
    "accuracy",
    "gallery",
    "error_bars",
    "coverage",
    "verification",
    "trust",
)
PATIENCE = 60.0  # [s] for a comparison to write what it has after Ctrl-C


def listed(folder: Path, names: Sequence[str]) -> str:
    """The comparisons, each with the beginning of its docstring."""
    rows = []
    for name in names:
        text = ast.get_docstring(ast.parse((folder / f"{name}.py").read_text())) or ""
        rows.append([name, " ".join(re.split(r"[:;.](?:\s|$)", text)[0].split())])
    return record.table(rows)


def stop(process: subprocess.Popen) -> None:
    """Let a comparison and its children write what they have, and end."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGINT)
    try:
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def run(script: Path, out: Path) -> tuple[dict[str, Any], bool]:
    """Ratios, words of absent ones and the failure of a comparison; and whether to go on."""
    going = True
    with tempfile.TemporaryDirectory() as folder:
        ratios = Path(folder) / "ratios.json"
        # A group of its own: Ctrl-C comes here, and goes on to it once.
        process = subprocess.Popen(
            [sys.executable, script, "--out", out, "--ratios", ratios],
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            process.wait()
        except KeyboardInterrupt:
            stop(process)
            going = False
        if ratios.exists():
            return json.loads(ratios.read_text()), going
    why = f"it ended with status {process.returncode}" if going else "interrupted"
    return {"ratios": {}, "absent": [], "failure": why}, going


def recorded(folder: Path, name: str) -> tuple[dict[str, Any], str]:
    """What `run` gives, from the record of a comparison, and when that was measured."""
    made = texts.latest(folder, name)
    known = {key: one["value"] for key, one in made["ratios"].items()}
    ratios = {key: value for key, value in known.items() if value is not None}
    return {"ratios": ratios, "absent": made.get("absent", []), "failure": ""}, made["made"]


def summary(
    found: Mapping[str, dict[str, Any]],
    floors: Mapping[str, Mapping[str, float]],
    older: str,
    left: str,
) -> tuple[str, bool]:
    """The table of all ratios, and whether all is well; which ones are `older`, and are `left`."""
    judged = [
        verdict
        for name, one in found.items()
        for verdict in record.judge(name, one["ratios"], floors.get(name, {}), one["absent"])
    ]
    failures = {name: one["failure"] for name, one in found.items() if one["failure"]}
    wrong = record.fallen(judged, failures)
    parts = [record.machine(), record.MEANING, record.verdicts(judged)]
    for words in (older and f"From their records: {older}.", left and f"Not run: {left}."):
        parts += [textwrap.fill(words, 80)] if words else []
    return "\n\n".join([*parts, wrong or "All floors hold."]) + "\n", not wrong


def main(
    arguments: Sequence[str] | None = None,
    folder: Path = HERE,
    names: Sequence[str] = COMPARISONS,
    floors: Mapping[str, Mapping[str, float]] | None = None,
) -> int:
    """The command; a test gives comparisons and floors of its own. Returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        epilog=f"comparisons:\n{listed(folder, names)}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="run these (all of them)")
    parser.add_argument("--summary", action="store_true", help="run none, gather their records")
    parser.add_argument("--list", action="store_true", help="list the comparisons and end")
    parser.add_argument(
        "--out", type=Path, default=folder, metavar="DIR", help="folder of the tables (%(default)s)"
    )
    options = parser.parse_args(arguments)
    # Without a name, argparse of Python 3.11 looks for an empty list in `choices`.
    if unknown := ", ".join(name for name in options.names if name not in names):
        parser.error(f"no comparison is named {unknown}; those that are: {', '.join(names)}")
    if options.summary and options.names:
        parser.error("--summary runs nothing: leave out the names, or --summary")
    if options.list:
        print(listed(folder, names))
        return 0
    chosen = () if options.summary else options.names or names
    floors = record.floors() if floors is None else floors
    found: dict[str, dict[str, Any]] = {}
    going = True
    for name in (name for name in names if name in chosen):
        print(f"{name} ...", file=sys.stderr, flush=True)
        start = time.perf_counter()
        found[name], going = run(folder / f"{name}.py", options.out)
        taken, one = time.perf_counter() - start, found[name]
        end = f"FAILED: {one['failure']}" if one["failure"] else f"{len(one['ratios'])} ratios"
        print(f"{name}: {taken:.0f} s, {end}", file=sys.stderr, flush=True)
        if not going:
            break
    older = {}
    for name in names:
        with contextlib.suppress(FileNotFoundError):
            if name not in found:
                found[name], older[name] = recorded(options.out, name)
    dates = ", ".join(f"{name} of {made}" for name, made in older.items())
    left = ", ".join(name for name in names if name not in found)
    text, well = summary(
        {name: found[name] for name in names if name in found}, floors, dates, left
    )
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "summary.txt").write_text(text)
    print(text)
    return 130 if not going else 0 if well else 1


if __name__ == "__main__":
    # What is asked to end takes its comparison along.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(main())
