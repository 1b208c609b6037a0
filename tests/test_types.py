"""What type checkers say of a user's lines: nothing where they are right, an error where not."""

import inspect
import re
import runpy
import tomllib
from pathlib import Path

import equinox as eqx
import pytest
from documents import README, ROOT, blocks
from mypy import api

import romjax as rj

PARTS = Path(__file__).parent / "typed_parts.py"
GALLERY = sorted((ROOT / "romjax" / "gallery").glob("*.py"))
# With the settings of the package, so that both read what mypy knows of JAX from one folder:
# strict, and as for an installed package, whose own lines are not judged.
USER = [f"--config-file={ROOT / 'pyproject.toml'}", f"--cache-dir={ROOT / '.mypy_cache'}"]
# Real mistakes, each on its line, and the code of the error that mypy must give for it.
MISTAKES = {
    'rj.RigidBody("cart", inertia=0.01)': "call-arg",
    'rj.RigidBody("cart", mass="heavy", inertia=0.01)': "arg-type",
    'rj.RigidBody("cart", mass=None, inertia=0.01)': "arg-type",
    'rj.RigidBody("cart", mass=(1.0, 2.0), inertia=0.01)': "arg-type",
    'rj.RigidBody("cart", mass=1.0, inertia=0.01, position="left")': "arg-type",
    'rj.RigidBody("cart", mass=1.0, inertia=0.01, colour=1.0)': "call-arg",
    'rj.RigidBody(1.0, mass=1.0, inertia="cart")': "arg-type",
    'rj.RigidBody("cart", mass=1.0, inertia=0.01, modes=2)': "call-arg",
    'rj.Beam("bar", 1.0, EI=2.0)': "call-arg",
    "rj.ground.at(None)": "arg-type",
    "rj.Spring(here, stiffness=100.0)": "call-arg",
    "rj.Spring(here, there)": "call-arg",
    "rj.Spring(here, there, 100.0, rest_length=[0.3])": "arg-type",
    "rj.Spring(rj.ground, there, 100.0)": "arg-type",
    'rj.Distance(here, there, "link")': "arg-type",
    "rj.Distance(here, there, 1.0, 2.0)": "arg-type",
    "rj.PointOnCurve(here, there, 1.0)": "arg-type",
    "rj.Force(here, direction=(1.0, 0.0), signal=10.0)": "arg-type",
    "rj.Contact(here, there, stiffness=1e5)": "call-arg",
    "rj.Sine(1.0)": "call-arg",
    "rj.Scene(joints=[])": "call-arg",
    "rj.Scene(bodies=[here])": "list-item",
    "rj.Scene(bodies=here)": "arg-type",
    "rj.Spring(here, there, 100.0).stiffness.value": "attr-defined",
    "rj.Spring(here, there, 100.0).rest_length + 1.0": "operator",
    "rj.assemble(here)": "arg-type",
    'rj.RigdBody("cart", mass=1.0, inertia=0.01)': "attr-defined",
}
BEGINNING = "import romjax as rj\n\nhere, there = rj.ground.at(), rj.ground.at()\n"


@pytest.fixture(scope="module")
def errors(tmp_path_factory) -> dict[str, list[tuple[int, str, str]]]:
    """Line, code and words of all errors, by the name of the file; one run of mypy for them all."""
    folder = tmp_path_factory.mktemp("types")
    files = {
        "readme.py": "\n".join(blocks(README, "python")),
        "mistakes.py": BEGINNING + "\n".join(MISTAKES),
    }
    for name, text in files.items():
        (folder / name).write_text(text)
    checked = [str(folder / name) for name in files] + [str(PARTS), *map(str, GALLERY)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MYPYPATH", str(ROOT))
        said, trouble, _ = api.run([*USER, *checked])
    assert trouble == ""
    found = re.findall(r"^(?:.*/)?(\w+\.py):(\d+): error: (.*)  \[([\w-]+)\]$", said, re.MULTILINE)
    assert len(found) == said.count(": error: "), said
    by_file: dict[str, list[tuple[int, str, str]]] = {}
    for name, line, words, code in found:
        by_file.setdefault(name, []).append((int(line), code, words))
    return by_file


@pytest.mark.slow
@pytest.mark.parametrize("name", ["readme.py", PARTS.name, *(path.name for path in GALLERY)])
def test_what_is_right_has_no_error(errors, name):
    assert errors.get(name, []) == []


@pytest.mark.slow
@pytest.mark.parametrize(("line", "code"), MISTAKES.items())
def test_what_is_wrong_has_its_error(errors, line, code):
    number = BEGINNING.count("\n") + 1 + list(MISTAKES).index(line)
    assert {found for at, found, _ in errors.get("mistakes.py", []) if at == number} == {code}


@pytest.mark.slow
def test_what_has_no_error_runs():
    runpy.run_path(str(PARTS))


@pytest.mark.instant
def test_every_part_is_checked():
    """All parts that romjax exports are among the lines that checkers accept."""
    text = PARTS.read_text()
    exported = [part for part in vars(rj).values() if inspect.isclass(part)]
    parts = [
        part.__name__
        for part in [*exported, *vars(rj.sections).values()]
        if inspect.isclass(part)
        and issubclass(part, eqx.Module)
        and part.__module__.startswith("romjax.scene")
        and not part.__name__.startswith("Abstract")
    ]
    assert len(parts) > 30
    # Markers are made by `at`.
    assert {name for name in parts if f".{name}(" not in text} == {"Marker"}


@pytest.mark.instant
def test_the_package_is_checked_with_no_code_switched_off():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]
    assert (settings["strict"], settings["follow_imports"]) == (True, "silent")
    assert not {"disable_error_code", "overrides", "ignore_errors", "exclude"} & settings.keys()
