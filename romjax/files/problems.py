"""Mistakes in files, each with its line, table, key, cause and remedy."""

import dataclasses
import re
import tomllib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..common.checks import unknown_name
from ..common.errors import SceneFileError

Place = tuple[str | int, ...]  # keys from the top of the file

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_KEY = r"(?:[A-Za-z0-9_-]+|\"(?:[^\"\\]|\\.)*\"|'[^']*')"
_ASSIGNMENT = re.compile(rf"\s*({_KEY}(?:\s*\.\s*{_KEY})*)\s*=")
_HEADER = re.compile(rf"\s*(\[\[?)\s*({_KEY}(?:\s*\.\s*{_KEY})*)\s*\]\]?\s*(?:#.*)?$")
# More would hide the first ones.
_LISTED = 50
# A message shows so many characters of a value at most.
_SHOWN = 60


@dataclasses.dataclass
class Problems:
    """The mistakes of one file, in the order in which they are met."""

    path: Path
    text: str = ""
    mistakes: list[tuple[Place, str]] = dataclasses.field(default_factory=list)

    def add(self, place: Place, words: str) -> None:
        """A mistake at some key: cause and remedy."""
        if not self.full and (place, words) not in self.mistakes:
            self.mistakes.append((place, words))

    @property
    def full(self) -> bool:
        """Whether there are so many that nobody needs to look for more."""
        return len(self.mistakes) >= _LISTED

    def touch(self, place: Place) -> bool:
        """Whether there is a mistake at some key or within it."""
        return any(other[: len(place)] == place for other, _ in self.mistakes)

    def raise_any(self) -> None:
        """Raise a SceneFileError if there are mistakes."""
        if self.mistakes:
            raise SceneFileError("\n".join(self.lines()))

    def lines(self) -> list[str]:
        """Each mistake in words."""
        numbers = line_numbers(self.text)
        ordered = sorted(self.mistakes, key=lambda one: _line(numbers, one[0]))
        said = [self._say(_line(numbers, place), place, words) for place, words in ordered]
        return said + [f"{self.path}: and more; these come first."] * self.full

    def _say(self, line: int, place: Place, words: str) -> str:
        at = f"{self.path}:{line}" if line else str(self.path)
        where = written(place)
        return f"{at}: {where}: {words}" if where else f"{at}: {words}"


def unknown(what: str, name: Any, known: Sequence[str]) -> str:
    """Return the message that there is no `what` of a name, with the nearest one."""
    words = str(unknown_name("", what, name, known)).removeprefix(": ")
    return words[0].upper() + words[1:]


def shown(value: Any) -> str:
    """A value of a file in a message."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, bool):
        return str(value).lower()
    text = f"the text {value!r}" if isinstance(value, str) else f"{value}"
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "…"


def written(place: Place) -> str:
    """The table and the key of a place, as in "[bodies.rod] mass"."""
    depth = 2 if place[:1] in (("bodies",), ("joints",), ("effects",)) else 1
    if len(place) == 1:
        return _keys(place)
    table, key = place[:depth], place[depth:]
    return " ".join(filter(None, [f"[{_keys(table)}]" if table else "", _keys(key)]))


def owner_of(place: Place) -> str:
    """Return the words with which messages about the part at a place begin."""
    kind = {"bodies": "body", "joints": "joint", "effects": "effect"}.get(str(place[0]), "")
    return f"{kind} '{place[1]}': " if kind else ""


def _keys(place: Place) -> str:
    text = ""
    for key in place:
        if isinstance(key, int):
            text += f"[{key}]"
        else:
            text += ("." if text else "") + (key if _BARE.fullmatch(key) else repr(key))
    return text


def line_numbers(text: str) -> dict[Place, int]:
    """The lines, from 1, at which tables and keys begin, as far as one line at a time tells."""
    numbers: dict[Place, int] = {}
    counts = Counter[Place]()
    table: Place = ()
    for number, line in enumerate(text.splitlines(), 1):
        header, assignment = _HEADER.match(line), _ASSIGNMENT.match(line)
        place: Place = ()
        if header:
            table = _path(header[2])
            if header[1] == "[[":
                counts[table] += 1
                table = (*table, counts[table] - 1)
            place = table
        elif assignment:
            place = table + _path(assignment[1])
        for length in range(1, len(place) + 1):
            numbers.setdefault(place[:length], number)
    return numbers


def _path(key: str) -> Place:
    """The parts of a dotted key."""
    try:
        value, parts = tomllib.loads(f"{key} = 0"), list[str | int]()
    except (tomllib.TOMLDecodeError, RecursionError):
        return (key,)
    while isinstance(value, dict):
        ((name, value),) = value.items()
        parts.append(name)
    return tuple(parts)


def _line(numbers: dict[Place, int], place: Place) -> int:
    """The line of a key, or of the next table around it; 0 if none is known."""
    return next((numbers[place[:n]] for n in range(len(place), 0, -1) if place[:n] in numbers), 0)
