"""What is known of the ready scenes: the facts that tests hold, what they teach, what they take."""

import ast
import re
import tomllib
from pathlib import Path
from typing import NamedTuple

import records

HERE = Path(__file__).parent
TESTS = HERE.parents[1] / "tests"
# The beginning of a scene in the record of what its reductions pay, and its full model there.
SCENE = re.compile(r"^([a-z-]+), [\d.]+ s, commit \w+\.\n\n(.*?)\n\n", re.MULTILINE | re.DOTALL)
FULL = re.compile(r"^full +\d+ +(\S+).* (\S+)$", re.MULTILINE)


class Known(NamedTuple):
    """Of a scene.

    - `fact`: what a test proves of its run. `learn`, `page`: what it teaches, and where that goes
      on.
    """

    fact: str
    learn: str
    page: str


class Taken(NamedTuple):
    """Of a scene: seconds to its first answer, milliseconds of a run after it, and what a reduction
    pays, in a sentence or two.
    """

    first: str
    again: str
    pays: str


def known() -> dict[str, Known]:
    """By the names of the scenes."""
    lessons = tomllib.loads((HERE / "lessons.toml").read_text())
    shown = {}
    for name in ("gallery_facts", "gallery_facts_in_space"):
        for node in ast.parse((TESTS / f"{name}.py").read_text()).body:
            if isinstance(node, ast.FunctionDef):
                text = ast.get_docstring(node) or ""
                shown[node.name.replace("_", "-")] = " ".join(text.split())
    return {name: Known(shown[name], **lesson) for name, lesson in lessons.items()}


def taken() -> dict[str, Taken]:
    """By the names of the scenes that the record has; measured where the page says."""
    text = (records.RECORDS / "gallery.txt").read_text()
    found = {}
    for scene in SCENE.finditer(text):
        full = FULL.search(text, scene.end())
        if full:
            again, first = full.groups()
            found[scene[1]] = Taken(first, f"{float(again):g}", " ".join(scene[2].split()))
    return found
