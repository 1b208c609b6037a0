"""Planted faults as the measure of the tests: for each of `mutations.toml`, whether one sees it.

    python tests/mutations.py [NAME ...] [--slow] [--all] [--source FOLDER] [--timeout SECONDS]

The checkout is copied once. In the copy one fault after the other is planted, its tests run, and
the file is as it was again. A test that fails without the fault too has not seen it. Programs are
kept as in any run of the tests: in the folder ROMJAX_CACHE_DIR if that is set, else for one run.
"""

import argparse
import collections
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
PYTEST = ["-m", "pytest", "-x", "-q", "-n0", "-p", "no:cacheprovider", "--jaxtyping-packages="]
# What the summary says of a test; of a file that cannot be collected it names no test.
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+?::.+?)(?: - .*)?$", re.MULTILINE)
# What a test costs is another question; by itself it may cost more than among others.
FREE = "\n\nimport pytest\n\n\n@pytest.fixture(autouse=True)\ndef cheap():\n    pass\n"


class Mutation(NamedTuple):
    """A fault; the fields are those of `mutations.toml`."""

    name: str
    file: str
    kind: str
    old: str
    new: str
    tests: list[str]


def mutations() -> list[Mutation]:
    """All faults, in the order of their file."""
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    return [Mutation(**fields) for fields in tomllib.loads(text)["mutation"]]


def copy(source: Path, folder: Path) -> None:
    """What a checkout holds, but for what git ignores and for the test that faults have places."""
    command = ["git", "-C", str(source), "ls-files", "-coz", "--exclude-standard"]
    for name in subprocess.check_output(command, text=True).split("\0"):
        # Some files are new, others were deleted since the last commit.
        if (source / name).is_file() and name != "tests/test_mutations.py":
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source / name, folder / name)


def run(folder: Path, arguments: list[str], seconds: float) -> tuple[int | None, str]:
    """Python's exit status on a copy, None if it took too long, and all that it says."""
    # An installed package of the checkout comes later on the path. Compiled files are told from
    # outdated ones by size and whole seconds, which a fault may leave as they were.
    own = {
        "PYTHONPATH": str(folder),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONPYCACHEPREFIX": "",
    }
    kept = {"env": os.environ | own, "capture_output": True, "text": True}
    try:
        done = subprocess.run([sys.executable, *arguments], cwd=folder, timeout=seconds, **kept)
    except subprocess.TimeoutExpired:
        return None, ""
    return done.returncode, done.stdout + done.stderr


def judge(folder: Path, fault: Mutation, options: argparse.Namespace) -> str:
    """What becomes of a fault in a copy: killed, SURVIVED, timeout or error, and by what."""
    file, tests = folder / fault.file, [x for x in fault.tests if (folder / x).is_file()]
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    if text.count(fault.old) != 1 or not tests:
        return "error: it has no place there, or no tests"
    file.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
    marks = ["-m", "not exhaustive"] if options.slow else []
    status, said = run(folder, [*PYTEST, *marks, *([] if options.all else tests)], options.timeout)
    file.write_text(text, encoding="utf-8")
    if status in (None, 0):
        return "SURVIVED" if status == 0 else "timeout"
    failed = FAILED.search(said)
    if status != 1 or failed is None:
        return f"error: pytest ends with {status}, {' '.join(said.split())[-200:]}"
    status, _ = run(folder, [*PYTEST, *marks, failed[1]], options.timeout)
    return f"error: without it too, {failed[1]}" if status else f"killed by {failed[1]}"


def main() -> int:
    """A line for each fault, then the counts; 1 if any has survived or could not be judged."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="faults; all unless given")
    parser.add_argument("--slow", action="store_true", help="with tests that are marked slow")
    parser.add_argument("--all", action="store_true", help="all tests, not those of the list")
    parser.add_argument("--source", type=Path, default=ROOT, help="another checkout to measure")
    parser.add_argument("--timeout", type=float, default=300.0, help="of one run of tests [s]")
    options, faults = parser.parse_args(), {fault.name: fault for fault in mutations()}
    if unknown := set(options.names) - faults.keys():
        parser.error(f"there is no {', '.join(sorted(unknown))}")
    counts = collections.Counter[str]()
    with tempfile.TemporaryDirectory(prefix="romjax-mutations-") as name:
        folder = Path(name).resolve()
        copy(options.source, folder)
        with (folder / "tests" / "conftest.py").open("a") as settings:
            settings.write(FREE)
        _, where = run(folder, ["-c", "import romjax; print(romjax.__file__)"], 300.0)
        assert Path(where.strip()).parent == folder / "romjax", f"not on the copy: {where}"
        for one in options.names or faults:
            begin = time.perf_counter()
            verdict = judge(folder, faults[one], options)
            counts[verdict.split(maxsplit=1)[0].rstrip(":")] += 1
            print(f"{one}: {verdict} ({time.perf_counter() - begin:.0f} s)", flush=True)
    print(", ".join(f"{count} {kind}" for kind, count in counts.most_common()))
    return int(bool(counts["SURVIVED"] or counts["error"]))


if __name__ == "__main__":
    sys.exit(main())
