"""Numbers of pages from the records of benchmarks: the role `figure`, and a table of the records.

`` {figure}`reduction; cart-pendulum, 1 s; galerkin 5; held out` `` is the cell of
`benchmarks/reduction.json` whose table, row and column begin with these words; a row is known by
its cells, from the first one on. `` {figure}`reduction; four-bar: full / table r = 1` `` is a
ratio, and `` {figure}`floors; reduction; four-bar: full / table r = 1` `` its floor. What names
none, or more than one, ends the build.
"""

import datetime
import functools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive

RECORDS = Path(__file__).parents[2] / "benchmarks"
# After the extensions, some of which have names that benchmarks have, too.
sys.path.append(str(RECORDS))

import texts  # noqa: E402

if TYPE_CHECKING:
    from docutils.parsers.rst.states import Inliner
    from sphinx.application import Sphinx


@functools.cache
def record(name: str) -> dict[str, Any]:
    """What a comparison measured last."""
    path = RECORDS / f"{name}.json"
    if path.exists():
        return json.loads(path.read_text())
    # Measured before records came as JSON.
    text = path.with_suffix(".txt")
    if not text.exists():
        raise ValueError(f"there is no record benchmarks/{name}.json")
    return texts.record_of(text)


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
    table = _one("table", parts[0], tables, [" ".join(x["text"].split()) for x in tables])
    row = _row(parts[1], table["rows"])
    return row[_one("column", parts[2], range(len(row)), table["columns"])]


def _role(
    name: str, rawtext: str, text: str, lineno: int, inliner: "Inliner", **_: Any
) -> tuple[list[nodes.Node], list[nodes.Node]]:
    try:
        return [nodes.Text(figure(text))], []
    except ValueError as error:
        message = inliner.reporter.error(f"figure: {error}", line=lineno)
        return [inliner.problematic(rawtext, rawtext, message)], [message]


def ages(today: datetime.date) -> list[tuple[str, str, str, str]]:
    """Of all records: name, date, age in days and commit."""
    found = []
    names = {path.stem for kind in ("txt", "json") for path in RECORDS.glob(f"*.{kind}")}
    for name in sorted(names - {"summary"}):
        one = record(name)
        days = (today - datetime.date.fromisoformat(one["made"])).days
        found.append((name, one["made"], str(max(days, 0)), one["commit"] or "unknown"))
    return found


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> nodes.table:
    """Of text, the first columns on the left and the others, of numbers, on the right."""
    table, group = nodes.table(), nodes.tgroup(cols=len(head))
    table += group
    group += [nodes.colspec(colwidth=1) for _ in head]
    top, body = nodes.thead(), nodes.tbody()
    group += [top, body]
    for parent, lines in ((top, [head]), (body, rows)):
        for cells in lines:
            line = nodes.row()
            for i, cell in enumerate(cells):
                classes = [] if i < left else ["text-right"]
                line += nodes.entry("", nodes.paragraph(text=cell), classes=classes)
            parent += line
    return table


class Records(Directive):
    """A table of the records, and how old they are when the site is built."""

    def run(self) -> list[nodes.Node]:
        head = ("record", "measured on", "days before this site", "at the commit")
        return [_table(head, ages(datetime.datetime.now(tz=datetime.UTC).date()), left=4)]


def rows_of(name: str, tables: Sequence[str], columns: Sequence[str]) -> list[list[str]]:
    """The columns of tables of a record, each row behind the beginning of its table's text."""
    found, made = [], record(name)["tables"]
    texts = [" ".join(one["text"].split()) for one in made]
    for words in tables:
        table = _one("table", words, made, texts)
        at = [
            _one("column", column, range(len(table["columns"])), table["columns"])
            for column in columns
        ]
        for i, row in enumerate(table["rows"]):
            found.append([words if i == 0 else "", *(row[j] for j in at)])
    return found


class Figures(Directive):
    """Tables of a record below each other: the record, its tables and their columns."""

    required_arguments = 1
    option_spec: ClassVar = {"tables": str, "columns": str, "left": int}

    def run(self) -> list[nodes.Node]:
        tables, columns = (
            [one.strip() for one in self.options[key].split("|")] for key in ("tables", "columns")
        )
        try:
            rows = rows_of(self.arguments[0], tables, columns)
        except ValueError as error:
            raise self.error(f"figures: {error}") from error
        head = ["mechanism", *columns]
        if len(tables) == 1:  # which the page has named
            head, rows = columns, [row[1:] for row in rows]
        return [_table(head, rows, self.options.get("left", 1))]


def setup(app: "Sphinx") -> dict[str, Any]:
    app.add_role("figure", _role)
    app.add_directive("records", Records)
    app.add_directive("figures", Figures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
