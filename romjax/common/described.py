"""Descriptions of the arrays of a record, from which files of results are written and read."""

from typing import NamedTuple


class Described(NamedTuple):
    """One array of a record: the names of its `axes`, its `unit` and its `meaning` in words.

    An empty unit stands for none, or for several.
    """

    axes: tuple[str, ...]
    unit: str
    meaning: str
