"""The sources that a traced program may come from: folders, and those that they import.

A module beside the folders of the package counts as one. Imports point one way, so that an edit of
pictures, files or studies leaves the programs of a simulation as they were.
"""

import functools
import hashlib
import re
from collections.abc import Iterable, Iterator, Set
from pathlib import Path

_PACKAGE = Path(__file__).parent.parent
# `from ..system.base import …`, on one line or in parentheses; no module imports its own package by
# its name. A parser of Python would take half a second for all of them.
_IMPORT = re.compile(r"^[ \t]*from (\.+)([\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)
_NAME = re.compile(r"(\w+)(?: as \w+)?")

# The names of a folder from the package on, or those of a module beside the folders.
Place = tuple[str, ...]

# Modules outside of the package that define the same wherever their sources, and those of romjax,
# are the same; by their names, digests of their sources. Those of the tests; of a user's modules
# nobody knows.
others: dict[str, str] = {}


def knows(module: str) -> bool:
    """Whether the sources of a module, by its full name, say what it defines."""
    return module.partition(".")[0] == "romjax" or module in others


def digest(modules: Iterable[str]) -> str:
    """A digest of all sources that these known modules, by their full names, depend on."""
    places = _sources().keys()
    names = sorted(module for module in modules if module in others)
    if names:
        parts = hashlib.sha256(_digest_of(frozenset(places)).encode())
        for name in names:
            parts.update(others[name].encode())
        return parts.hexdigest()
    own = [tuple(module.split(".")[1:]) for module in modules if "." in module]
    return _digest_of(frozenset(_place(part, places) for part in own))


@functools.cache
def _digest_of(places: frozenset[Place]) -> str:
    sources = _sources()
    reached, waiting = set[Place](), list(places)
    while waiting:
        place = waiting.pop()
        if place not in reached:
            reached.add(place)
            waiting += sources[place][1]
    return hashlib.sha256("".join(sources[x][0] for x in sorted(reached)).encode()).hexdigest()


def _place(target: Place, places: Set[Place]) -> Place:
    """Return the place that a module, or a name in it, belongs to: the longest path that is one."""
    paths = (target[:length] for length in range(len(target), 0, -1))
    # What is imported from the package itself is a name of any of its folders.
    return next((path for path in paths if path in places), ("__init__",))


@functools.cache
def _sources() -> dict[Place, tuple[str, frozenset[Place]]]:
    """Return for each place a digest of its sources, and the places that it imports."""
    texts: dict[Place, list[str]] = {}
    imported: dict[Place, set[Place]] = {}
    for file in sorted(_PACKAGE.rglob("*.py")):
        parts = file.relative_to(_PACKAGE).with_suffix("").parts
        text = file.read_text(encoding="utf-8")
        texts.setdefault(parts[:-1] or parts, []).append(f"{parts}\n{text}")
        imported.setdefault(parts[:-1] or parts, set()).update(_imports(parts, text))
    return {
        place: (
            hashlib.sha256("".join(own).encode()).hexdigest(),
            frozenset(_place(target, texts.keys()) for target in imported[place]),
        )
        for place, own in texts.items()
    }


def _imports(parts: Place, text: str) -> Iterator[Place]:
    """List the modules that a module imports, and their names, from its place and its text."""
    for dots, module, names in _IMPORT.findall(text):
        origin = parts[: len(parts) - len(dots)] + tuple(filter(None, module.split(".")))
        yield from ((*origin, name) for name in _NAME.findall(names))
