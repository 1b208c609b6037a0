"""Every command that README, notebooks, docstrings and help texts name does what it says."""

import functools
import re
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from documents import DOCUMENTS, README, ROOT, commands, marked, options, spans, verbs

BENCHMARK = re.compile(r"python -m benchmarks(?: .*)?")
STATED = re.compile(r"\(([^()]*)\)$")  # the default, at the end of a help text

CI = "by .ci/run"
SET_UP = "as the first line of the tests, with less installed"
FILES = "by test_files.py"
TEST_CLI = "by test_run_cart_pendulum and test_tune in test_cli.py"
ROBOTS = "by test_robots.py"
RELEASE = "by test_release.py"
BY_HAND = "before a release"
PART = "a part of the line of the tests"

# How each command is executed: as it stands, with names filled in, or elsewhere.
COMMANDS = {
    "romjax scenes": "romjax scenes",
    "romjax run cart-pendulum": TEST_CLI,
    "romjax run FILE.py": "romjax run mine.py --end 0.5 --budget 2",
    "romjax new crank.toml": FILES,
    "romjax check FILE": FILES,
    "romjax check crank.toml": FILES,
    "romjax check arm.urdf": ROBOTS,
    "romjax run crank.toml": FILES,
    "romjax schema": FILES,
    "romjax tune NAME": TEST_CLI,
    "romjax tune chain": TEST_CLI,
    "romjax accuracy cart-pendulum --budget 60": "romjax accuracy mine.py --budget 10",
    "romjax accuracy cart-pendulum": "romjax accuracy mine.py --budget 10",
    "python -m romjax": "python -m romjax --help",
    "python3 -m venv .venv": CI,
    "pip install -q --no-compile .": SET_UP,
    'pip install -q --no-compile -e ".[test]"': CI,
    "python -m pytest -q": CI,
    "python -m pytest -q -m slow": CI,
    "python -m pytest -q -m exhaustive": BY_HAND,
    "python -m pytest -q -m instant": PART,
    "python docs/extensions/records.py": BY_HAND,
    "python tests/mutations.py": BY_HAND,
    'pip install -q --no-compile -e ".[dev]"': CI,
    "ruff format --check .": CI,
    "ruff check .": CI,
    "mypy": CI,
    "python -m sphinx -W docs build/site": CI,
    "pre-commit install": RELEASE,
}
ELSEWHERE = (BY_HAND, CI, FILES, PART, RELEASE, ROBOTS, SET_UP, TEST_CLI)
EXECUTED = sorted({line for line in COMMANDS.values() if line not in ELSEWHERE})

# "A mechanism of your own is a `Scene` of bodies, joints and effects connected by markers."
MINE = """
import romjax as rj

bar = rj.RigidBody("bar", mass=1.0, inertia=0.1, position=(0.5, 0.0))
hinge = rj.Revolute(bar.at((-0.5, 0.0)), rj.ground.at())
scene = rj.Scene([bar], [hinge], [rj.Gravity()])
"""


# Verbs by themselves, where they cannot be typed like that: the documents speak of them.
VERBS = {
    f"romjax {name}"
    for name, parser in verbs().items()
    if any(action.required for action in parser._actions)
}


@functools.cache
def said() -> dict[str, str]:
    """The documents' commands, and where they stand."""
    return {
        command.removeprefix(".venv/bin/"): place
        for place, text in DOCUMENTS.items()
        for command in commands(text)
        if command not in VERBS
    }


def benchmarks() -> list[str]:
    return [command for command in said() if BENCHMARK.fullmatch(command)]


def run(command: str, folder: Path) -> str:
    """What a command prints, in a folder that holds mine.py."""
    (folder / "mine.py").write_text(MINE)
    program, *arguments = shlex.split(command)
    here = {"python": sys.executable, "romjax": Path(sysconfig.get_path("scripts")) / "romjax"}
    done = subprocess.run(
        [here[program], *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.instant
def test_every_command_is_known():
    """Each command of the documents is a benchmark or in the table, and the table has no others."""
    others = {c: place for c, place in said().items() if c not in benchmarks()}
    assert {c: place for c, place in others.items() if c not in COMMANDS} == {}
    assert set(COMMANDS) - set(others) == set()


@pytest.mark.instant
def test_ci_runs_what_it_is_said_to():
    """All of it in `.ci/run`, but for the line of the tests, which it takes from the README."""
    script = (ROOT / ".ci" / "run").read_text()
    theirs = [part.removeprefix(".venv/bin/") for part in marked("tests").strip().split(" && ")]
    said = [command for command, by in COMMANDS.items() if by == CI and command not in theirs]
    assert len(said) >= 5
    assert [command for command in said if f".venv/bin/{command}\n" not in script] == []


@pytest.mark.instant
def test_verbs():
    """README names the verbs of `romjax --help`, all of them and no others."""
    found = [command.removeprefix(".venv/bin/") for command in commands(README)]
    assert {c.split()[1] for c in found if c.startswith("romjax ")} == set(verbs())


@pytest.mark.instant
def test_arguments():
    """Verb, options and values of each command are those that the parser knows."""
    parsers = verbs()
    for command in said():
        program, *arguments = shlex.split(command)
        if program == "romjax":
            parsers[arguments[0]].parse_args(arguments[1:])


@pytest.mark.instant
def test_options():
    """An option that is named by itself, such as `--out`, is one of some verb."""
    known = {name for parser in verbs().values() for name in options(parser)}
    named = [span for text in DOCUMENTS.values() for span in spans(text) if span.startswith("-")]
    assert [span for span in named if span.split()[0] not in known] == []


@pytest.mark.instant
@pytest.mark.parametrize("verb", verbs())
def test_defaults(verb):
    """A number in brackets at the end of an option's help is its default; words mean none."""
    assert "usage: romjax" in verbs()[verb].format_help()
    for name, action in options(verbs()[verb]).items():
        if action.nargs == 0:  # a flag
            continue
        stated = STATED.search(action.help)
        try:
            default = float(stated[1]) if stated else None
        except ValueError:
            default = None
        assert action.default == default, f"{verb} {name}: {action.help}"


@pytest.mark.slow
@pytest.mark.parametrize("command", EXECUTED)
def test_command(command, tmp_path):
    """It ends well, says something, and has filled the folder that the README promises.

    A mechanism of one's own compiles faster than the ready ones, which other tests run.
    """
    assert run(command, tmp_path).strip()
    program, _, *rest = command.split()
    if rest and program == "romjax":
        assert any((tmp_path / f"romjax-{Path(rest[0]).stem}").iterdir())


@pytest.mark.instant
def test_marked_lines():
    """`.ci/run` takes the README's line of tests as it stands, and runs the slow ones besides.

    The line that runs the main job sets up the same way, but for the tests' requirements; what it
    runs then is in test_cli.py.
    """
    script = (ROOT / ".ci" / "run").read_text()
    line = r"""sed -n '/<!-- tests -->/,+2p' README.md | tail -n 1"""
    assert f"command=$({line})" in script
    assert 'bash -c "$command"' in script
    taken = subprocess.run(["bash", "-c", line], cwd=ROOT, capture_output=True, text=True)
    assert taken.stdout == marked("tests")
    venv, install, tests = marked("tests").strip().split(" && ")
    assert f"{tests} -m slow" in script.splitlines()
    assert f"{tests} -m slow" in commands(README)
    assert marked("run").strip().split(" && ") == [
        venv,
        install.removesuffix('-e ".[test]"') + ".",
        ".venv/bin/romjax run cart-pendulum",
    ]
    assert '"romjax", "run", "cart-pendulum"' in (ROOT / "tests" / "test_cli.py").read_text()


@pytest.mark.instant
def test_benchmarks():
    """Those that are named are known to the command, which begins in the folder of the README.

    Executing one takes many minutes, so that is left to those who measure.
    """
    named = {tuple(shlex.split(command)[1:]) for command in benchmarks()}
    assert len(named) >= 3
    for arguments in named:
        # It lists what it knows and ends, once it has understood all that comes before.
        run = [sys.executable, "-W", "error", *arguments, "--list"]
        done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=True)
        assert "verification " in done.stdout
