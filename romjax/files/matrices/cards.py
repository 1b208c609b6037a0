"""Entries of Nastran's bulk data, in small, large and free fields."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from .entries import text_of, wrong

# Before an exponent without its letter, as in 3.+5.
_EXPONENT = re.compile(r"(?<=[0-9.])(?=[+-])")


class Card(NamedTuple):
    """One entry: its `name`, its fields but the names of continuations, and their lines."""

    name: str
    fields: list[str]
    lines: list[int]

    def field(self, index: int) -> str:
        """A field; empty where the entry ends before it."""
        return self.fields[index] if index < len(self.fields) else ""

    def integer(self, path: Path, index: int, default: int | None = None) -> int:
        """A field as an integer; raises InputError if it is none."""
        text = self.field(index)
        if not text and default is not None:
            return default
        try:
            return int(text)
        except ValueError as error:
            raise self.wrong(path, index, "an integer") from error

    def real(self, path: Path, index: int) -> float:
        """A field as a number, also 1.0D+5 and 3.+5; raises InputError if it is none."""
        text = self.field(index).upper().replace("D", "E")
        try:
            return float(text if "E" in text else _EXPONENT.sub("E", text))
        except ValueError as error:
            raise self.wrong(path, index, "a number") from error

    def wrong(self, path: Path, index: int, what: str) -> Exception:
        line = self.lines[min(index, len(self.lines) - 1)]
        return wrong(
            path, line, f"{self.field(index)!r} in an entry {self.name} is not {what}; correct it"
        )


def cards(path: Path, *names: str) -> Iterator[Card]:
    """The entries of some names in a file; all others, and comments, are passed over."""
    card = None
    for number, line in enumerate(text_of(path).splitlines(), 1):
        line = line.partition("$")[0].expandtabs(8).rstrip()
        if not line:
            continue
        first, data = _fields(line)
        if first[:1] in ("", "*", "+"):
            if card is not None:
                card.fields.extend(data)
                card.lines.extend([number] * len(data))
            continue
        if card is not None:
            yield card
        name = first.rstrip("*").strip().upper()
        card = Card(name, data, [number] * len(data)) if name in names else None
    if card is not None:
        yield card


def _fields(line: str) -> tuple[str, list[str]]:
    """The first field of a line, and its other ones, four large or eight small."""
    if "," in line:
        first, *fields = (field.strip() for field in line.split(","))
        count = 4 if first.endswith("*") else 8
        return first, (fields + [""] * count)[:count]
    first = line[:8].strip()
    # Nastran has cards of ten columns of eight characters, or with an asterisk of four wide ones of
    # sixteen between the first and the last.
    count, width = (4, 16) if "*" in first else (8, 8)
    return first, [line[8 + i * width : 8 + (i + 1) * width].strip() for i in range(count)]
