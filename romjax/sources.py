"""The sources that a traced program may come from: rooms, and those that they import.

A room is a folder of the package, or a module beside these. Imports point one way, so that an edit
of pictures, files or studies leaves the programs of a simulation as they were.
"""

import functools
import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

_PACKAGE = Path(__file__).parent
# `from ..system.base import …`, on one line or in parentheses; no module imports its own package by
# its name. A parser of Python would take half a second for all of them.
_IMPORT = re.compile(r"^[ \t]*from (\.+)([\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def digest(modules: Iterable[str]) -> str:
    """A digest of all sources that these modules of romjax, by their full names, depend on."""
    return _digest_of(frozenset(module.split(".")[1] for module in modules if "." in module))


@functools.cache
def _digest_of(rooms: frozenset[str]) -> str:
    known = _rooms()
    reached, waiting = set[str](), list(rooms)
    while waiting:
        room = waiting.pop()
        if room not in reached:
            reached.add(room)
            waiting += known[room][1]
    return hashlib.sha256("".join(known[x][0] for x in sorted(reached)).encode()).hexdigest()


@functools.cache
def _rooms() -> dict[str, tuple[str, frozenset[str]]]:
    """Of each room a digest of its sources, and the rooms that it imports."""
    sources: dict[str, list[str]] = {}
    imported: dict[str, set[str]] = {}
    for file in sorted(_PACKAGE.rglob("*.py")):
        parts = file.relative_to(_PACKAGE).with_suffix("").parts
        text = file.read_text(encoding="utf-8")
        sources.setdefault(parts[0], []).append(f"{parts}\n{text}")
        imported.setdefault(parts[0], set()).update(_imports(parts, text))
    return {
        # What is imported from the package itself is a name of any of its rooms.
        room: (
            hashlib.sha256("".join(texts).encode()).hexdigest(),
            frozenset(x if x in sources else "__init__" for x in imported[room]),
        )
        for room, texts in sources.items()
    }


def _imports(parts: tuple[str, ...], text: str) -> set[str]:
    """The rooms that a module imports, by its place in the package and its text."""
    rooms = set()
    for dots, module, names in _IMPORT.findall(text):
        target = [*parts[: len(parts) - len(dots)], *module.split(".")]
        target = [part for part in target if part]
        rooms |= {target[0]} if target else set(re.findall(r"(\w+)(?: as \w+)?", names))
    return rooms
