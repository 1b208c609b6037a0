"""The command that runs the benchmarks: what it reports and how it ends, of made-up comparisons."""

import importlib
import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "benchmarks"
SCRIPTS = sorted(path.stem for path in FOLDER.glob("[a-z]*.py"))

HEAD = """'What is made up: nothing is measured.'
import sys
sys.path.insert(0, {folder!r})
import record

def measure():
    yield record.Section("First:", [["a", "b"], ["1", "2"]], {{"one / two": 2.0}})
"""
TAIL = """
if __name__ == "__main__":
    record.main(measure, setup=lambda: None)
"""
# What a comparison does after its first section.
KINDS = {
    "steady": "",
    "raising": "    raise ValueError('no\\n  such solver')",
    "dying": "    import os; os._exit(3)",
    "waiting": "    import time; print('ready', file=sys.stderr, flush=True); time.sleep(100)",
    "absent": "    yield record.Section('', ratios={}, absent=['Other'])",
    "infinite": "    yield record.Section('', ratios={'two / three': float('inf')})",
}


@pytest.fixture
def scripts(tmp_path) -> Path:
    """A folder of made-up comparisons."""
    for name, more in KINDS.items():
        text = HEAD.format(folder=str(FOLDER)) + more + "\n" + TAIL
        (tmp_path / f"{name}.py").write_text(text)
    return tmp_path


@pytest.fixture
def command(monkeypatch):
    """The command as a module."""
    monkeypatch.syspath_prepend(FOLDER)
    spec = importlib.util.spec_from_file_location("benchmarks_command", FOLDER / "__main__.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    # Their names are plain words that others may want.
    for name in SCRIPTS:
        sys.modules.pop(name, None)


def test_a_comparison_by_itself_writes_the_summary(scripts):
    """Which would be older than its record; not where its record goes elsewhere."""
    said = "import pathlib, sys; pathlib.Path(__file__).with_name('said').write_text(sys.argv[1])"
    (scripts / "__main__.py").write_text(said)
    run = [sys.executable, scripts / "steady.py"]
    subprocess.run([*run, "--out", scripts / "other"], check=True, capture_output=True)
    assert not (scripts / "said").exists()
    subprocess.run(run, check=True, capture_output=True)
    assert (scripts / "said").read_text() == "--summary"


@pytest.mark.slow
def test_comparisons_can_be_imported(command, tmp_path):
    code = "import runpy, sys\nfor path in sys.argv[1:]:\n    runpy.run_path(path)"
    files = [FOLDER / f"{name}.py" for name in command.COMPARISONS]
    run = [sys.executable, "-W", "error", "-c", code, *files]
    path = os.environ | {"PYTHONPATH": os.pathsep.join([str(FOLDER), str(FOLDER.parent)])}
    subprocess.run(run, cwd=tmp_path, env=path, check=True)


def ran(command, scripts, names, floors, *arguments) -> tuple[int, str]:
    """Exit status and summary."""
    status = command.main([*arguments], scripts, names, floors)
    return status, (scripts / "summary.txt").read_text()


@pytest.mark.instant
def test_all_is_well(command, scripts, capsys):
    """The summary names machine, versions, ratio and floor; each comparison has its report."""
    status, summary = ran(command, scripts, ["steady"], {"steady": {"one / two": 2.0}})
    assert status == 0
    assert "All floors hold." in summary
    assert "romjax" in summary
    assert "GiB" in summary
    assert ["steady", "one", "/", "two", "2", "2", "yes"] in [
        x.split() for x in summary.split("\n")
    ]
    assert "one / two" in (scripts / "steady.txt").read_text()
    printed = capsys.readouterr()
    assert summary in printed.out
    assert "steady: " in printed.err


@pytest.mark.instant
def test_a_ratio_below_its_floor(command, scripts):
    status, summary = ran(command, scripts, ["steady"], {"steady": {"one / two": 2.1}})
    assert status == 1
    assert "steady: one / two is 2, floor 2.1" in summary


@pytest.mark.instant
@pytest.mark.parametrize("kind", ["steady", "infinite"])
def test_a_floor_without_its_ratio(command, scripts, kind):
    """Not measured, or not a number, is not good enough."""
    status, summary = ran(command, scripts, [kind], {kind: {"two / three": 1.0}})
    assert status == 1
    assert f"{kind}: two / three was not measured, floor 1" in summary


@pytest.mark.instant
def test_a_program_that_is_not_installed(command, scripts):
    """Excuses the ratios that name it, and no others."""
    floors = {"absent": {"Other / two": 1.0, "one / two": 1.0}}
    status, summary = ran(command, scripts, ["absent"], floors)
    assert status == 0
    assert "not installed" in summary
    status, summary = ran(command, scripts, ["absent"], {"absent": {"another": 1.0}})
    assert status == 1


@pytest.mark.instant
def test_a_comparison_that_fails(command, scripts):
    """What it measured before, and the others, are written all the same."""
    names = ["raising", "dying", "steady"]
    status, summary = ran(command, scripts, names, {"dying": {"one / two": 1.0}})
    assert status == 1
    assert "raising did not run to its end: ValueError: no such solver" in summary
    assert "dying did not run to its end: it ended with status 3" in summary
    assert "dying: one / two was not measured" in summary
    assert summary.count("one / two") == 4  # raising, dying twice, steady
    assert "ValueError" in (scripts / "raising.txt").read_text()
    assert "First:" in (scripts / "raising.txt").read_text()
    assert (scripts / "steady.txt").exists()


@pytest.mark.instant
def test_only_some(command, scripts, capsys):
    """Others are named as not run, and their floors not asked for; an unknown name is refused."""
    floors = {"raising": {"one / two": 9.0}}
    status, summary = ran(command, scripts, ["raising", "steady"], floors, "steady")
    assert status == 0
    assert "Not run: raising." in summary
    status, summary = ran(command, scripts, ["raising", "steady"], floors, "--summary")
    assert status == 0
    assert "From their records: steady of 2" in summary
    assert "one / two" in summary
    for wrong, said in {"nothing": "nothing", "steady --summary": "runs nothing"}.items():
        with pytest.raises(SystemExit):
            command.main(wrong.split(), scripts, ["steady"], {})
        assert said in capsys.readouterr().err
    assert command.main(["--list"], scripts, ["raising", "steady"], {}) == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line.split(maxsplit=1) for line in listed] == [
        [name, "What is made up"] for name in ("raising", "steady")
    ]


@pytest.mark.instant
def test_ctrl_c(scripts):
    """Ends in a moment and keeps what is measured, the interrupted comparison's part as well."""
    names = ["steady", "waiting", "raising"]
    program = (
        # As in a terminal: what a shell runs in the background ignores Ctrl-C.
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"import pathlib, runpy, sys; sys.path.insert(0, {str(FOLDER)!r})\n"
        f"main = runpy.run_path({str(FOLDER / '__main__.py')!r}, run_name='command')['main']\n"
        f"sys.exit(main([], pathlib.Path({str(scripts)!r}), {names}, {{}}))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        for line in process.stderr:
            if line == "ready\n":
                break
        start = time.perf_counter()
        os.kill(process.pid, signal.SIGINT)
        process.communicate(timeout=60)
    assert process.returncode == 130
    assert time.perf_counter() - start < 30
    summary = (scripts / "summary.txt").read_text()
    assert summary.count("one / two") == 2
    assert "waiting did not run to its end: interrupted" in summary
    assert "Not run: raising." in summary


@pytest.mark.instant
def test_floors_belong_to_comparisons(command):
    """Each to a known one, and a positive number; the table fits into 80 columns."""
    floors = command.record.floors()
    assert set(floors) <= set(command.COMPARISONS)
    names = [name for some in floors.values() for name in some]
    assert len(names) >= 20
    assert all(floor > 0 for some in floors.values() for floor in some.values())
    assert max(map(len, command.COMPARISONS)) <= 14
    found = [
        command.record.Verdict("c" * 14, "r " * 41, 0.0847, 0.123, "absent"),
        command.record.Verdict("c" * 14, "r" * command.record.WIDTH, 99999.0, 99999.0, "NO"),
    ]
    assert max(map(len, command.record.verdicts(found).splitlines())) <= 80


@pytest.mark.instant
def test_a_value_just_below_its_floor(command):
    """It does not look like it."""
    values = {(0.99959, 1.0): "0.9996", (0.98, 1.0): "0.98", (1.0, 1.0): "1", (2.0, None): "2"}
    for (value, floor), text in values.items():
        assert command.record.Verdict("c", "r", value, floor, "NO").shown == text


@pytest.mark.parametrize("name", SCRIPTS)
def test_scripts_can_be_imported(command, name):
    """Without measuring anything; a comparison has the one function that the command calls."""
    module = importlib.import_module(name)
    if name in command.COMPARISONS:
        assert callable(module.measure)
        assert module.__doc__
    assert len((FOLDER / f"{name}.py").read_text().splitlines()) <= 300
