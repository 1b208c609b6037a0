"""Scene files on the command line."""

import json
import re

import pytest
from documents import PAGES, blocks

from romjax.cli import main


def test_new_check_and_schema(tmp_path, capsys):
    path = tmp_path / "new.toml"
    assert main(["new", str(path)]) == 0
    assert main(["new", str(path)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    for words in ("freedoms     2", "no joint", "Dopri8, since the outputs can show"):
        assert words in said

    # What the page of scene files says to change.
    text, crank = path.read_text(), path
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
    crank.write_text(text)
    assert main(["check", str(crank)]) == 0
    said = capsys.readouterr().out
    for words in ("slider crank", "1 RigidBody", "freedoms     1", "all joints hold"):
        assert words in said
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["$defs"]["Beam"]["required"] == ["type", "mass", "length"]
    assert "angle_deg" in schema["$defs"]["RigidBody"]["properties"]


@pytest.mark.slow
def test_redundant_joints_are_named(crank, capsys):
    """A loop that is held twice."""
    text = 'again = { type = "PointOnLine", a = "slider", b = "ground" }\n\n[effects.gravity]'
    crank.write_text(crank.read_text().replace("\n[effects.gravity]", text))
    assert main(["check", str(crank)]) == 0
    said = capsys.readouterr().out
    assert "redundant    again (1 of its constraints)" in said
    assert "freedoms     2, 1 of them modes" in said


@pytest.mark.slow
def test_a_file_runs(crank, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["run", str(crank), "--out", str(out), "--no-animation"]) == 0
    assert "slider crank" in capsys.readouterr().out
    assert (out / "trajectory_full.csv").exists()
