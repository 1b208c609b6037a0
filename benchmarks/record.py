"""What all comparisons share: sections of a report, ratios and their floors, what was measured on.

A comparison is a file with one function, `measure`, that yields sections as they are ready, so that
a failure keeps those before it; `record.main(measure)` runs it as a script.
"""

import argparse
import datetime
import functools
import importlib.metadata
import inspect
import json
import math
import os
import platform
import re
import signal
import subprocess
import sys
import textwrap
import tomllib
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tabulate import tabulate

HERE = Path(__file__).parent
FLOORS = HERE / "floors.toml"
PACKAGES = ("romjax", "jax", "jaxlib", "diffrax", "equinox", "numpy", "scipy", "mujoco", "exudyn")
WIDTH = 41  # of a ratio's name in the table, which then has 80 columns
MEANING = (
    "Ratios are of times, the first over the second, unless they name another thing;\n"
    "larger is better. A floor is what a ratio must reach."
)


class Section(NamedTuple):
    """A part of a report: text, a table with its header as the first row, and ratios by name.

    `absent`: words of ratios that cannot be measured here, such as a program that is not installed.
    `data`: more of what was measured, for the file of the record as JSON.
    `figure`: a matplotlib figure, saved beside the report.
    """

    text: str
    rows: Sequence[Sequence[Any]] = ()
    ratios: Mapping[str, float] = {}
    absent: Collection[str] = ()
    figure: Any = None
    data: Mapping[str, Any] = {}

    def __str__(self) -> str:
        return f"{self.text}\n\n{table(self.rows)}" if self.rows else self.text


class Verdict(NamedTuple):
    """A ratio and its floor; `holds` is yes, NO, absent, or - where there is no floor."""

    comparison: str
    ratio: str
    value: float | None
    floor: float | None
    holds: str

    def __str__(self) -> str:
        found = "was not measured" if self.value is None else f"is {self.shown}"
        floor = "" if self.floor is None else f", floor {short(self.floor)}"
        return f"{self.comparison}: {self.ratio} {found}{floor}"

    @property
    def shown(self) -> str:
        """The value in three digits, or in as many as tell it from its floor."""
        value, floor = self.value, self.floor
        if value is None or floor is None or value == floor or float(short(value)) != floor:
            return short(value)
        digits = (f"{value:.{count}g}" for count in range(4, 18))
        return next(text for text in digits if float(text) != floor)


def table(rows: Sequence[Sequence[Any]], **settings: Any) -> str:
    """Rows under their header, which is the first of them: tabulate widens columns for its own."""
    return tabulate(rows, tablefmt="plain", disable_numparse=True, **settings)


def short(value: float | None) -> str:
    """Three digits."""
    if value is None:
        return "-"
    return f"{value:.0f}" if 100 <= abs(value) < 1e5 else f"{value:.3g}"


def machine() -> str:
    """Date, versions and the computer, for the heading of a table."""
    versions = [f"Python {platform.python_version()}"]
    for name in PACKAGES:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            # What runs from its sources has a version, too.
            known = getattr(sys.modules.get(name), "__version__", "not installed")
            versions.append(f"{name} {known}")
    half = len(versions) // 2
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = (named or [platform.processor() or platform.machine()])[0]
    memory = ""
    if "SC_PHYS_PAGES" in getattr(os, "sysconf_names", ()):
        size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        memory = f", {size / 2**30:.0f} GiB"
    return (
        f"{datetime.date.today()}, {processor}, {os.cpu_count()} cores{memory},\n"
        f"{platform.system()} {platform.release()} {platform.machine()},\n"
        f"{', '.join(versions[:half])},\n{', '.join(versions[half:])}."
    )


def floors(path: Path = FLOORS) -> dict[str, dict[str, float]]:
    """The least value of each ratio that has one, by comparison."""
    return tomllib.loads(path.read_text())


def commit() -> str:
    """Of what is measured, with a plus where files have changed since; empty outside of git."""
    command = ["git", "-C", str(HERE), "describe", "--always", "--abbrev=12", "--dirty=+"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return found.stdout.strip()


def as_json(heading: str, at: str, sections: Sequence[Section], judged: Sequence[Verdict]) -> str:
    """A record for programs: `tables` of what the text shows, `ratios`, words of ratios that are
    `absent`, and `data`.
    """
    tables = [
        {"text": one.text, "columns": one.rows[0], "rows": one.rows[1:]}
        for one in sections
        if one.rows
    ]
    tables = [{**one, "rows": [[str(x) for x in row] for row in one["rows"]]} for one in tables]
    ratios = {one.ratio: {"value": one.value, "floor": one.floor} for one in judged}
    data = {name: value for one in sections for name, value in one.data.items()}
    absent = [word for one in sections for word in one.absent]
    found = {"made": heading[:10], "commit": at, "on": heading[12:], "tables": tables}
    found |= {"ratios": ratios} | ({"absent": absent} if absent else {})
    return written(found | ({"data": data} if data else {}))


def written(found: Mapping[str, Any]) -> str:
    """As JSON, with rows and numbers of one thing on one line."""
    text = json.dumps(found, indent=1, ensure_ascii=False)
    flat = re.compile(r"([\[{])\n\s+([^\[\]{}]*?)\n\s+([\]}])")
    return flat.sub(lambda m: m[1] + re.sub(r"\n\s+", " ", m[2]) + m[3], text) + "\n"


def judge(
    comparison: str,
    ratios: Mapping[str, float],
    least: Mapping[str, float],
    absent: Collection[str] = (),
) -> list[Verdict]:
    """All ratios and all floors of a comparison; a ratio that is not finite was not measured."""
    found = []
    for name in dict.fromkeys([*ratios, *least]):
        value, floor = ratios.get(name, math.nan), least.get(name)
        if math.isfinite(value):
            holds = "-" if floor is None else "yes" if value >= floor else "NO"
            found.append(Verdict(comparison, name, value, floor, holds))
        else:
            excused = any(word in name for word in absent)
            holds = "absent" if excused else "-" if floor is None else "NO"
            found.append(Verdict(comparison, name, None, floor, holds))
    return found


def verdicts(found: Sequence[Verdict]) -> str:
    """The table of ratios and floors, at most 80 columns wide."""
    rows = [["comparison", "ratio", "value", "floor", "holds"]]
    for one in found:
        name = "\n".join(textwrap.wrap(one.ratio, WIDTH))
        rows.append([one.comparison, name, one.shown, short(one.floor), one.holds])
    text = table(rows, colalign=("left", "left", "right", "right", "left"))
    if any(one.holds == "absent" for one in found):
        text += "\n\nabsent: not installed, or not on this machine"
    return text


def fallen(found: Sequence[Verdict], failures: Mapping[str, str]) -> str:
    """What is below its floor, was not measured or did not run; empty if nothing."""
    lines = [f"{name} did not run to its end: {why}" for name, why in failures.items()]
    lines += [str(one) for one in found if one.holds == "NO"]
    lines = [
        textwrap.fill(line, 80, initial_indent="  ", subsequent_indent="    ") for line in lines
    ]
    return "\n".join(["BELOW THE FLOOR OR NOT MEASURED:", *lines]) if lines else ""


def begin() -> None:
    """As `begin_as_users`, with XLA set up for `jax.jit` of small simulations, which most
    comparisons run.
    """
    import romjax as rj

    rj.speed_up_xla()
    begin_as_users()


def begin_as_users() -> None:
    """Double precision on a CPU; nothing is read from disk."""
    os.environ["ROMJAX_CACHE_DIR"] = ""
    import jax

    jax.config.update("jax_enable_x64", True)
    # A graphics processor would only wait for these few bodies.
    jax.config.update("jax_platforms", "cpu")


def collect(measure: Callable[[], Iterator[Section]]) -> tuple[list[Section], str]:
    """All sections, or those before a failure, and the failure in a line."""
    sections = []
    try:
        for section in measure():
            sections.append(section)
    except KeyboardInterrupt:
        return sections, "interrupted"
    except Exception as error:
        traceback.print_exc()
        return sections, " ".join(f"{type(error).__name__}: {error}".split())[:300]
    return sections, ""


def main(
    measure: Callable[..., Iterator[Section]],
    setup: Callable[[], None] = begin,
    choices: Mapping[str, Mapping[str, Any]] = {},
) -> None:
    """Run a comparison as a script: write its report as text and as JSON, and where it is run by
    itself the summary of all records anew; end with 1 if a floor does not hold.

    `choices`: settings of argparse for options of its own, by name, which `measure` takes.
    """
    script = Path(inspect.getfile(measure))
    parser = argparse.ArgumentParser(
        description=inspect.getdoc(inspect.getmodule(measure)),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    folder = {"type": Path, "default": script.parent, "metavar": "DIR"}
    parser.add_argument("--out", **folder, help=f"folder of {script.stem}.txt (%(default)s)")
    parser.add_argument(
        "--ratios", type=Path, metavar="FILE", help="file to write the ratios to, as JSON"
    )
    for name, settings in choices.items():
        parser.add_argument(f"--{name}", **settings)
    options = parser.parse_args()
    # Also where the command was started in the background, which ignores Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    setup()
    chosen = {name: getattr(options, name) for name in choices}
    at = commit()  # before hours in which files may change
    sections, failure = collect(functools.partial(measure, **chosen))
    ratios = {name: float(x) for section in sections for name, x in section.ratios.items()}
    absent = [word for section in sections for word in section.absent]
    if options.ratios:
        found = {"ratios": ratios, "absent": absent, "failure": failure}
        options.ratios.write_text(json.dumps(found))
    judged = judge(script.stem, ratios, floors().get(script.stem, {}), absent)
    wrong = fallen(judged, {script.stem: failure} if failure else {})
    heading = machine()
    parts = [heading, *map(str, sections)]
    if judged:
        parts += [MEANING, verdicts(judged)]
    text = "\n\n".join([*parts, wrong] if wrong else parts) + "\n"
    if sections:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / f"{script.stem}.txt").write_text(text)
        (options.out / f"{script.stem}.json").write_text(as_json(heading, at, sections, judged))
        for section in sections:
            if section.figure is not None:
                section.figure.savefig(options.out / f"{script.stem}.png", dpi=110)
    print(text)
    # By itself it makes the summary of all older than its record.
    command = script.parent / "__main__.py"
    if sections and not options.ratios and options.out == script.parent and command.exists():
        subprocess.run(
            [sys.executable, command, "--summary"], stdout=subprocess.DEVNULL, check=False
        )
    sys.exit(1 if wrong else 0)
