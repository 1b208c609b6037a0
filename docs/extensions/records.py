"""Cells, ratios and floors of the records of benchmarks, by the words that they begin with.

`python docs/extensions/records.py` writes those of the README anew, which has no roles: each stands
between a comment that names it and an empty one.
"""

import datetime
import functools
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

RECORDS = Path(__file__).parents[2] / "benchmarks"
README = RECORDS.parent / "README.md"
NAMED = re.compile(r"<!-- ([^>]*;[^>]*) -->(.*?)<!-- -->", re.DOTALL)
# After the extensions, some of which have names that benchmarks have, too.
sys.path.append(str(RECORDS))

import texts  # noqa: E402


@functools.cache
def record(name: str) -> dict[str, Any]:
    """What a comparison measured last."""
    try:
        return texts.latest(RECORDS, name)
    except FileNotFoundError:
        raise ValueError(f"there is no record benchmarks/{name}.json") from None


def _one(kind: str, words: str, choices: Sequence[Any], names: Sequence[str]) -> Any:
    """The choice whose name is `words`, or the only one that begins with them."""
    exact = [x for x, name in zip(choices, names, strict=True) if name == words]
    found = exact or [x for x, name in zip(choices, names, strict=True) if name.startswith(words)]
    if len(found) != 1:
        raise ValueError(f"{len(found)} {kind}s begin with {words!r}: {', '.join(names)[:300]}")
    return found[0]


def _row(words: str, rows: Sequence[Sequence[str]]) -> Sequence[str]:
    """The one whose first cells are `words`, or the only one that begins with them."""
    names = [[" ".join(" ".join(row[: i + 1]).split()) for i in range(len(row))] for row in rows]
    exact = [row for row, cells in zip(rows, names, strict=True) if words in cells]
    return exact[0] if len(exact) == 1 else _one("row", words, rows, [x[-1] for x in names])


def _above(tables: Sequence[dict[str, Any]]) -> list[str]:
    """What stands above tables, without the backticks that would end a role."""
    return [" ".join(one["text"].replace("`", "").split()) for one in tables]


def figure(path: str) -> str:
    """The number that a role names, as the record has it."""
    name, *parts = (part.strip() for part in path.split(";"))
    if name == "floors" and len(parts) == 2:
        return f"{texts.record.floors()[parts[0]][parts[1]]:g}"
    found = record(name)
    if len(parts) == 1:
        value = _one("ratio", parts[0], list(found["ratios"].values()), list(found["ratios"]))
        return f"{value['value']:.3g}"
    if len(parts) != 3:
        raise ValueError(f"{path!r} is no 'record; table; row; column', nor 'record; ratio'")
    tables = found["tables"]
    table = _one("table", parts[0], tables, _above(tables))
    row = _row(parts[1], table["rows"])
    return row[_one("column", parts[2], range(len(row)), table["columns"])]


def changes(commit: str) -> str:
    """How often the package has changed since a commit, where git knows."""
    command = [
        "git",
        "-C",
        str(RECORDS),
        "rev-list",
        "--count",
        f"{commit}..HEAD",
        "--",
        "../romjax",
    ]
    try:
        found = subprocess.run(command, capture_output=True, text=True)
    except OSError:
        return "unknown"
    return found.stdout.strip() or "unknown"


def ages(today: datetime.date) -> list[tuple[str, str, str, str, str]]:
    """Of all records: name, date, age in days, commit and changes of the package since."""
    found = []
    names = {path.stem for kind in ("txt", "json") for path in RECORDS.glob(f"*.{kind}")}
    for name in sorted(names - {"summary"}):
        one = record(name)
        days = (today - datetime.date.fromisoformat(one["made"])).days
        commit = one["commit"] or "unknown"
        since = changes(commit.removesuffix("+"))
        found.append((name, one["made"], str(max(days, 0)), commit, since))
    return found


def rows_of(name: str, tables: Sequence[str], columns: Sequence[str]) -> list[list[str]]:
    """The columns of tables of a record, each row behind the beginning of its table's text."""
    found, made = [], record(name)["tables"]
    for words in tables:
        table = _one("table", words, made, _above(made))
        at = [
            _one("column", column, range(len(table["columns"])), table["columns"])
            for column in columns
        ]
        for i, row in enumerate(table["rows"]):
            found.append([words if i == 0 else "", *(row[j] for j in at)])
    return found


def written(text: str) -> str:
    """A page without roles, with the numbers that the records have now."""
    return NAMED.sub(lambda at: f"<!-- {at[1]} -->{figure(at[1])}<!-- -->", text)


if __name__ == "__main__":
    README.write_text(written(README.read_text()))
