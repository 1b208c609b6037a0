"""Numbers and positions of nodes: from arrays, input decks of Abaqus and CalculiX, or bulk data."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...common.errors import InputError
from .cards import cards
from .entries import existing, text_of, wrong

_DECK = (".inp",)
_BULK = (".bdf", ".dat", ".nas", ".pch")


class Nodes(NamedTuple):
    """Nodes by rising number: `numbers` (nodes,) and `positions` (nodes, 3) [m]."""

    numbers: np.ndarray
    positions: np.ndarray


def nodes_of(given: Any) -> Nodes:
    """The nodes of an array, of a mapping from numbers to places, or in a file.

    Raises InputError for what has no nodes, with file, line and cure.
    """
    if isinstance(given, str | os.PathLike):
        return _read(Path(given))
    if isinstance(given, Mapping):
        return _sorted(list(given), list(given.values()))
    positions = np.asarray(given, float)
    if positions.ndim != 2:
        raise InputError(
            f"load_mesh: nodes has shape {positions.shape}, but it must be (nodes, 2) or (nodes, "
            "3), a mapping from numbers to places, or the name of a file."
        )
    return _sorted(list(range(1, len(positions) + 1)), list(positions))


def _read(path: Path) -> Nodes:
    existing(path, "give the input deck, or nodes as an array")
    if path.suffix.lower() in _BULK:
        rows = _grids(path)
    else:
        rows = _deck(path, inside=path.suffix.lower() not in _DECK)
    if not rows:
        raise wrong(path, 0, "has no nodes (*NODE, or GRID); give the file that has them")
    return _sorted([row[0] for row in rows], [row[1:] for row in rows])


def _deck(path: Path, inside: bool) -> list[tuple[float, ...]]:
    """The rows below *NODE; of a file without keywords, all."""
    rows, keyword, instances = [], "*NODE" if inside else "", 0
    for number, line in enumerate(text_of(path).splitlines(), 1):
        if not line.strip() or line.startswith("**"):
            continue
        if line.startswith("*"):
            keyword, _, options = line.strip().upper().partition(",")
            keyword = keyword.strip()
            if keyword == "*NODE" and "INPUT" in options:
                raise wrong(path, number, "the nodes are in another file; give that one")
            instances += keyword == "*INSTANCE"
            if instances > 1:
                raise wrong(path, number, "has several instances; write it without parts")
        elif keyword == "*INSTANCE":
            raise wrong(path, number, "the instance is moved; write the deck without parts")
        elif keyword == "*NODE":
            try:
                rows.append(tuple(float(x) for x in line.split(",") if x.strip()))
            except ValueError as error:
                raise wrong(path, number, f"{line.strip()!r} is no node; correct it") from error
            if not 3 <= len(rows[-1]) <= 4 or rows[-1][0] != round(rows[-1][0]):
                words = f"{line.strip()!r} is not a number, x, y and perhaps z; correct it"
                raise wrong(path, number, words)
    return rows


def _grids(path: Path) -> list[tuple[float, ...]]:
    rows = []
    for card in cards(path, "GRID"):
        for index in (1, 5):
            if card.integer(path, index, 0):
                raise wrong(
                    path,
                    card.lines[0],
                    f"GRID {card.field(0)} is in the coordinate system {card.field(index)}; write "
                    "nodes and displacements in the basic one",
                )
        positions = [card.real(path, index) if card.field(index) else 0.0 for index in (2, 3, 4)]
        rows.append((float(card.integer(path, 0)), *positions))
    return rows


def _sorted(numbers: list[Any], positions: list[Any]) -> Nodes:
    """Sort nodes by their numbers; raise InputError for a number that is there twice."""
    ids = np.array(numbers, np.int64)
    rows = np.zeros((len(ids), 3))
    for row, own in zip(rows, positions, strict=True):
        row[: len(own)] = own
    order = np.argsort(ids, kind="stable")
    ids, rows = ids[order], rows[order]
    twice = ids[1:] == ids[:-1]
    if np.any(twice):
        raise InputError(f"load_mesh: node {ids[np.argmax(twice)]} is there twice; remove one.")
    return Nodes(ids, rows)
