"""The command line: what a newcomer types and sees."""

import contextlib
import csv
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
import types
from typing import NamedTuple

import jax
import numpy as np
import pytest
from PIL import Image
from processes import START

import romjax
from romjax import cli
from romjax.cli import main
from romjax.command_inputs import writable
from romjax.common.beside import beside
from romjax.gallery import EXAMPLES

WIDTH = 80  # columns of a terminal
# A scene with a class of the user's own.
OWN = """
import romjax as rj


class Pull(rj.AbstractSignal):
    def __call__(self, t):
        return 1.0 + t


mass = rj.RigidBody("mass", 1.0, 1.0)
scene = rj.Scene([mass], [], [rj.Force(mass.at(), (1.0, 0.0), Pull())])
"""


@pytest.mark.instant
def test_scenes_lists_every_example(capsys):
    assert main(["scenes"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:]] == [example.name for example in EXAMPLES]
    assert max(map(len, lines)) <= WIDTH


@pytest.mark.instant
@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["scenes", "--help"]])
def test_help(arguments, capsys):
    with pytest.raises(SystemExit) as exit_:
        main(arguments)
    assert exit_.value.code == 0
    assert "usage: romjax" in capsys.readouterr().out


@pytest.mark.instant
def test_version(capsys):
    with pytest.raises(SystemExit) as exit_:
        main(["--version"])
    assert exit_.value.code == 0
    assert capsys.readouterr().out == f"romjax {romjax.__version__}\n"


@pytest.mark.instant
def test_unknown_scene_names_the_nearest(capsys):
    assert main(["run", "cart-pendulem"]) == 2
    assert "did you mean 'cart-pendulum'?" in capsys.readouterr().err


@pytest.mark.instant
def test_parts_of_files_that_killed_commands_left_are_deleted(tmp_path):
    """Those of days before, since others may be written to right now; nothing of the user's."""
    names = [".romjax-0a1b.part.gif", ".romjax-2c3d.part.html", ".romjax-notes", "part.gif"]
    for number, name in enumerate(names):
        file = tmp_path / name
        file.touch()
        if number != 1:
            os.utime(file, (0, 0))
    assert writable(tmp_path) == tmp_path
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(names[1:])


@pytest.mark.instant
def test_unwritable_folder_is_refused_before_any_work(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["run", "cart-pendulum", "--out", str(tmp_path / "file" / "out")]) == 2
    assert "choose another with --out" in capsys.readouterr().err


@pytest.mark.instant
@pytest.mark.parametrize(
    ("text", "message"), [(None, "There is no file"), ("scene = 1", "defines no `scene`")]
)
def test_bad_scene_file(tmp_path, capsys, text, message):
    path = tmp_path / "mine.py"
    if text:
        path.write_text(text)
    assert main(["run", str(path), "--out", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.instant
@pytest.mark.parametrize("option", [["--rate", "-1"], ["--rate", "0"], ["--end", "0"]])
def test_no_sample(tmp_path, capsys, option):
    assert main(["run", "chain", "--out", str(tmp_path), *option]) == 2
    assert "no sample" in capsys.readouterr().err


@pytest.mark.slow
def test_run_cart_pendulum(tmp_path):
    """The main job: a page with all of it, figures, animation and trajectories."""
    result = subprocess.run(
        [
            *(sys.executable, "-m", "romjax", "run", "cart-pendulum"),
            *("--budget", "15", "--out", str(tmp_path), "--again"),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = result.stdout.splitlines()
    assert max(len(line) for line in lines if str(tmp_path) not in line) <= WIDTH
    # What pays, with the first models as soon as they were tried.
    assert any(line.startswith("Take ") for line in lines)
    assert "times as fast, error" in result.stderr
    # The chapter's models.
    table = [line for line in lines if line.startswith(("POD ", "SOD ")) and " of " not in line]
    assert len([line for line in table if line.split()[2].isdigit()]) == 6
    assert "At rest: angle of cart." in " ".join(result.stdout.split())
    assert "12 %" in result.stdout
    assert "30 %" in result.stdout
    for name in ("reductions", "singular_values", "responses", "errors", "modes_pod", "modes_sod"):
        with Image.open(tmp_path / f"{name}.png") as picture:
            assert min(picture.size) > 300
    with Image.open(tmp_path / "animation.gif") as picture:
        assert picture.n_frames > 10
    assert f"Wrote {tmp_path / 'report.html'}, a page with all of it, and beside it:" in lines
    page = (tmp_path / "report.html").read_text("utf-8")
    assert page.count("<img") == 6
    assert page.count("<iframe") == 2
    # The full model and one that pays at least, the chapter's seven, and ranks at two rates.
    assert page.count("<tr") >= 1 + 2 + 1 + 7 + 1 + 2
    with open(tmp_path / "trajectory_full.csv", newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0][:2] == ["t", "cart.x"]
    assert np.array(rows[1:], float).shape == (301, 1 + 8 + 8 + 4)
    # The same command shows the same, and says so.
    (tmp_path / "report.html").unlink()
    again = subprocess.run(
        result.args[:-1], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert again.pop(2).startswith("measured on ")
    assert again == lines
    assert (tmp_path / "report.html").read_text("utf-8").count("<img") == 6


class Told(NamedTuple):
    """The result of a study, as far as the command asks it."""

    number: int
    skipped: dict[str, str]

    def summary(self, every):
        return f"study {self.number}"


@pytest.mark.instant
def test_the_same_command_measures_once(tmp_path, capsys, monkeypatch):
    """Unless it is told to; whatever changes the answer is another question, as are scenes with a
    class of the user's own, and what Ctrl-C has ended is no answer.
    """
    numbers, skipped = iter(range(100)), {}

    def shown(*arguments):
        assert main(["run", *arguments, "--out", str(tmp_path)]) == 0
        first, second, *_ = capsys.readouterr().out.splitlines()[2:]
        if first.startswith("measured on "):
            assert first.endswith(" by the same command; --again measures anew")
            return int(second.split()[1]), True
        assert second == ""
        return int(first.split()[1]), False

    monkeypatch.setenv("ROMJAX_CACHE_DIR", str(tmp_path / "caches"))
    monkeypatch.setattr(cli, "assemble", lambda scene: types.SimpleNamespace(n=1, m=0))
    monkeypatch.setattr(cli, "reductions", lambda *_, **__: Told(next(numbers), skipped))
    monkeypatch.setattr(cli.report, "draw", lambda *_: None)
    monkeypatch.setattr(cli.report, "write", lambda *_: [tmp_path / "report.html"])
    assert [shown("chain"), shown("chain")] == [(0, False), (0, True)]
    assert shown("chain", "--again") == (1, False)
    assert shown("chain", "--no-animation") == (1, True)
    assert shown("chain", "--budget", "3") == (2, False)
    assert shown("four-bar") == (3, False)
    (tmp_path / "own.py").write_text(OWN)
    assert shown(str(tmp_path / "own.py")) == (4, False)
    assert shown(str(tmp_path / "own.py")) == (5, False)
    skipped["the rest"] = "interrupted"
    assert shown("jansen") == (6, False)
    assert shown("jansen") == (7, False)


@pytest.mark.slow
def test_tune(tmp_path, capsys):
    """Parameters before and after, and the figure of the search."""
    arguments = ["tune", "chain", "--end", "0.2", "--steps", "3", "--out", str(tmp_path)]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert "fastest rigid frequency" in text
    assert [line.split()[0] for line in text.splitlines()[1:3]] == ["start", "best"]
    with Image.open(tmp_path / "tuning.png") as picture:
        assert picture.width > 1000


def test_work_on_another_core():
    """Gives what functions return, whatever Ctrl-C does; what fails meanwhile ends them."""
    others = {*multiprocessing.active_children()}
    with beside() as begin_there:
        result = begin_there(math.hypot, 3.0, 4.0)
        (child,) = {*multiprocessing.active_children()} - others
        os.kill(child.pid, signal.SIGINT)
        assert (result(), begin_there(os.getpid)()) == (5.0, child.pid)
    begin = time.monotonic()

    def fails():
        with beside() as begin_there:
            begin_there(time.sleep, 1000.0)
            raise KeyError("meanwhile")

    with pytest.raises(KeyError, match="meanwhile"):
        fails()
    with beside() as begin_there:
        begin_there(time.sleep, 1000.0)
    assert time.monotonic() - begin < 500.0
    with beside() as begin_there:
        result = begin_there(os._exit, 3)
        for wait in (result, lambda: begin_there(os.getpid)):
            with pytest.raises(ChildProcessError, match="if memory is short"):
                wait()


ORPHANED = """
import math, time
from romjax.common.beside import beside

with beside() as begin:
    print(begin(math.hypot, 3.0, 4.0)(), flush=True)
    begin(time.sleep, 1000.0)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
def test_work_on_another_core_ends_with_a_process_that_is_killed():
    """It would keep the output of a command open, and write to its folder later."""
    command = [sys.executable, "-c", START + ORPHANED]
    # Reads up to the end, which comes when no process can write any more.
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=100)
    assert (done.returncode, done.stdout) == (-signal.SIGKILL, "5.0\n")


@pytest.mark.instant
def test_work_is_not_beside_that_of_a_gpu(monkeypatch):
    """Two processes of JAX do not share its memory."""
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    with beside() as begin:
        assert begin(os.getpid)() == os.getpid()


@pytest.mark.parametrize(
    ("fault", "status", "words"),
    [(ChildProcessError("ended"), 2, "ended"), (KeyboardInterrupt(), 130, "interrupted")],
)
def test_what_is_measured_is_kept_without_the_study(
    fault, status, words, tmp_path, capsys, monkeypatch
):
    """As where its process dies, or Ctrl-C ends the wait for it."""

    @contextlib.contextmanager
    def beside():
        def result():
            raise fault

        yield lambda *_: result

    def write(result, study, *rest):
        assert (result, study, rest[-2:]) == (measured, None, (drawn._replace(filmed=None), None))
        return [tmp_path / "report.html"]

    measured = types.SimpleNamespace(summary=lambda every: "what pays")
    monkeypatch.setattr(cli, "beside", beside)
    monkeypatch.setattr(cli, "reductions", lambda *_, **__: measured)
    drawn = cli.report.Drawn({}, None, lambda: None)
    monkeypatch.setattr(cli.report, "draw", lambda *_: drawn)
    monkeypatch.setattr(cli.report, "write", write)
    assert main(["run", "cart-pendulum", "--out", str(tmp_path), "--again"]) == status
    told = capsys.readouterr()
    assert "what pays" in told.out
    assert "Wrote" in told.out
    waiting, why = told.err.splitlines()
    assert waiting.startswith("POD and SOD")
    assert why == f"romjax: {words}"
