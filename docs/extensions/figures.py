"""Numbers of pages from the records of benchmarks: the role `figure`, and a table of the records.

`` {figure}`reduction; cart-pendulum, 1 s; galerkin 5; held out` `` is the cell of
`benchmarks/reduction.json` whose table, row and column begin with these words; a row is known by
its cells, from the first one on. `` {figure}`reduction; four-bar: full / table r = 1` `` is a
ratio, and `` {figure}`floors; reduction; four-bar: full / table r = 1` `` its floor. What names
none, or more than one, ends the build.
"""

import datetime
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import Directive
from records import ages, figure, rows_of

if TYPE_CHECKING:
    from docutils.parsers.rst.states import Inliner
    from sphinx.application import Sphinx


def _role(
    name: str, rawtext: str, text: str, lineno: int, inliner: "Inliner", **_: Any
) -> tuple[list[nodes.Node], list[nodes.Node]]:
    try:
        # A class, so that the style keeps a number such as 7.5e-05 on one line.
        return [nodes.inline("", figure(text), classes=["figure"])], []
    except ValueError as error:
        message = inliner.reporter.error(f"figure: {error}", line=lineno)
        return [inliner.problematic(rawtext, rawtext, message)], [message]


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
        head = ("record", "measured on", "days before this site", "at the commit", "changes since")
        return [_table(head, ages(datetime.datetime.now(tz=datetime.UTC).date()), left=4)]


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
