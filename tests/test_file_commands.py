"""Scene files on the command line."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from documents import PAGES, blocks

import romjax as rj
from romjax import cli
from romjax.cli import main


@pytest.fixture
def new(tmp_path):
    """The file to begin with, and as what the page of scene files says to change."""
    path, changed = tmp_path / "new.toml", tmp_path / "changed.toml"
    assert main(["new", str(path)]) == 0
    text = path.read_text()
    (changes,) = blocks(PAGES["docs/howto/scene_files.md"], "toml")
    top, drive, slider, joints = re.split(r"^# .*\n", changes, flags=re.MULTILINE)
    lines = [line for part in (top, drive, slider, joints) for line in part.splitlines() if line]
    assert len(lines) == 10
    for before, after in (
        ('title = "two bars on a hinge"\n', top),
        ("[bodies.crank]\n", "[bodies.crank]\n" + drive),
        ("[joints]", slider + "[joints]"),
        ("bearing = {", joints + "bearing = {"),
    ):
        assert before in text
        text = text.replace(before, after, 1)
    changed.write_text(text)
    return path, changed


def test_new_and_schema(new, capsys):
    path, changed = new
    assert main(["new", str(path)]) == 2
    assert "is there already" in capsys.readouterr().err
    scene = rj.load_scene(path)
    assert (len(scene.bodies), len(scene.joints)) == (2, 2)
    file = rj.scene_file(changed)
    assert file.title == "slider crank"
    system = rj.assemble(file())
    assert (system.n, system.m) == (9, 8)
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["$defs"]["Beam"]["required"] == ["type", "mass", "length"]
    assert "angle_deg" in schema["$defs"]["RigidBody"]["properties"]


def test_new_in_space(tmp_path):
    """As it is, and with all that it offers in comments."""
    path = tmp_path / "arm.toml"
    assert main(["new", str(path), "--space"]) == 0
    scene = rj.load_scene(path)
    assert [type(body) for body in scene.bodies] == [rj.spatial.RigidBody, rj.spatial.Beam]
    assert [b.modes for b in scene.bodies] == [0, 0]
    path.write_text(re.sub(r"^# (?=\[|\w+ = )", "", path.read_text(), flags=re.MULTILINE))
    changed = rj.load_scene(path)
    assert (changed.bodies[1].bending, len(changed.effects)) == ((2, 2), 2)
    np.testing.assert_array_equal(changed.bodies[1].EI, [200.0, 200.0])
    np.testing.assert_array_equal(changed.bodies[1].damping, 4 * [0.01])


def test_check(tmp_path, capsys):
    path = tmp_path / "ball.toml"
    ball = '[bodies.ball]\ntype = "RigidBody"\nmass = 1\ninertia = 1\n'
    path.write_text(f'format = 1\ntitle = "a ball"\n{ball}[effects]\ng = {{ type = "Gravity" }}\n')
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    words = ("a ball", "1 RigidBody", "ball: 3 coordinates", "freedoms     3", "1 Gravity")
    for word in (*words, "no joint", "all joints hold", "Dopri8, since"):
        assert word in said


@pytest.mark.slow
def test_check_counts_no_lengths_of_quaternions(capsys):
    """A body on a ball joint turns about three axes; its joint coordinates are a quaternion."""
    path = Path(rj.__file__).parent / "gallery" / "files" / "spinning-top.toml"
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    assert "freedoms     3" in said
    assert 'formulation="joint", exact: 4 coordinates, 0 constraints' in said


@pytest.mark.slow
def test_check_counts_no_states_of_effects(tmp_path, capsys):
    ball = '[bodies.ball]\ntype = "RigidBody"\nmass = 1\ninertia = 1\n'
    pid = 'type = "PID"\na = "ball"\nb = "ground"\nproportional = 1.0\nintegral = 1.0\n'
    pid += 'target = { type = "Constant", value = 0.0 }\n'
    path = tmp_path / "ball.toml"
    path.write_text(f"format = 1\n{ball}[effects.pid]\n{pid}")
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    assert "coordinates  4" in said
    assert "freedoms     3" in said


@pytest.mark.slow
def test_check_says_what_a_file_is(new, capsys):
    for path, wanted in zip(
        new,
        (
            ("freedoms     2", "no joint", "Dopri8, since the outputs can show"),
            ("slider crank", "1 RigidBody", "freedoms     1", "all joints hold"),
        ),
        strict=True,
    ):
        assert main(["check", str(path)]) == 0
        said = capsys.readouterr().out
        for words in wanted:
            assert words in said


@pytest.mark.slow
def test_redundant_joints_are_named(crank, capsys):
    """A loop that is held twice."""
    text = 'again = { type = "PointOnLine", a = "slider", b = "ground" }\n\n[effects.gravity]'
    crank.write_text(crank.read_text().replace("\n[effects.gravity]", text))
    assert main(["check", str(crank)]) == 0
    said = capsys.readouterr().out
    assert "redundant    again (1 of its constraints)" in said
    assert "freedoms     2, 1 of them modes" in said


def test_a_file_runs(crank, tmp_path, monkeypatch):
    """By the study of every scene, with the settings of the file; test_cli writes its pictures."""

    class EnoughError(Exception):
        pass

    def study(scene, ts, **settings):
        system = rj.assemble(scene)
        assert (system.n, system.m, ts[-1], len(ts)) == (10, 8, 0.1, 11)
        assert settings.keys() >= {"rtol", "solver", "budget"}
        raise EnoughError

    monkeypatch.setattr(cli, "reductions", study)
    with pytest.raises(EnoughError):
        main(["run", str(crank), "--out", str(tmp_path / "out"), "--no-animation", "--again"])
