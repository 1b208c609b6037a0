"""The list of planted faults: each has its place in the package, and tests that should see it."""

import ast
import collections

import pytest
from mutations import ROOT, mutations

MUTATIONS = mutations()
COUNT = 62
KINDS = {"sign", "factor", "index", "term", "argument"}
# The folders of the package that compute, and the one that reads matrices.
ROOMS = {
    *("analysis", "assembly", "basis", "events", "integrate", "linalg", "march"),
    *("files", "measure", "reduction", "scene", "study", "system"),
    *("reduction/charts", "reduction/hyper", "reduction/local", "reduction/tables"),
}

pytestmark = pytest.mark.instant


def test_all_have_names_of_their_own():
    assert len(MUTATIONS) == COUNT
    assert len({one.name for one in MUTATIONS}) == COUNT


def room(file: str) -> str:
    """The folder that a file is in, by the longest of the names in `ROOMS`."""
    path = file.removeprefix("romjax/")
    return max((name for name in ROOMS if path.startswith(name + "/")), key=len, default=path)


def test_every_room_has_two():
    rooms = collections.Counter(room(one.file) for one in MUTATIONS)
    assert rooms.keys() == ROOMS
    assert min(rooms.values()) >= 2


@pytest.mark.parametrize("one", MUTATIONS, ids=lambda one: one.name)
def test_a_fault_has_its_place_and_its_tests(one):
    text = (ROOT / one.file).read_text(encoding="utf-8")
    assert text.count(one.old) == 1
    assert one.old != one.new
    planted = text.replace(one.old, one.new)
    assert ast.dump(ast.parse(planted)) != ast.dump(ast.parse(text))
    assert one.kind in KINDS
    assert 1 <= len(one.tests) <= 4
    assert all((ROOT / file).is_file() for file in one.tests)
