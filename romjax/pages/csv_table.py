"""Tables as comma-separated values."""

import csv
import io
import os
from collections.abc import Iterable, Sequence
from typing import Any

from ..common import writing
from ..common.plain import is_number

# What spreadsheets take for a formula, which they would evaluate.
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")


def write(
    path: str | os.PathLike[str], header: Sequence[str], rows: Iterable[Sequence[Any]]
) -> None:
    """Write a file with the `text` of a table."""
    writing.write(path, text(header, rows))


def text(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A line of names and one for each row; numbers have every digit.

    Texts that a spreadsheet would take for a formula begin with an apostrophe.
    """
    content = io.StringIO()
    writer = csv.writer(content, lineterminator="\n")
    writer.writerows([_cell(value) for value in row] for row in (header, *rows))
    return content.getvalue()


def _cell(value: Any) -> Any:
    is_formula = isinstance(value, str) and value.startswith(_FORMULA) and not is_number(value)
    return f"'{value}" if is_formula else value
