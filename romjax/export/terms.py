"""Numbers of a program in C: what is known is a number of Python, what is not is a name."""

import contextlib
import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .refuse import refuse

# The kinds of whole numbers of JAX, by the names of their types.
WHOLE = tuple(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))
# Types of C by kinds of numbers; "i" are indices of the program's own, which stay small.
TYPES = {"f": "double", "b": "int", **dict.fromkeys(("i", *WHOLE), "long long")}


class Term:
    """A number that the program computes: `text` stands for it, and needs the variables `uses`.

    `minus`: the term of which it is the negative, if it is one.
    """

    __slots__ = ("minus", "text", "uses")

    def __init__(self, text: str, uses: tuple[str, ...]) -> None:
        self.text = text
        self.uses = uses
        self.minus: Term | None = None

    def __repr__(self) -> str:
        return self.text


@dataclasses.dataclass
class _Statement:
    """A line of C, which `defines` a variable or has an effect; a loop has a `body` as well.

    `kind`: the type of a number that does not change.
    """

    text: str
    defines: tuple[str, ...]
    uses: tuple[str, ...]
    operations: int
    body: "list[_Statement] | None" = None
    kind: str = ""


def is_known(x: Any) -> bool:
    """Whether a number is one of Python's."""
    return not isinstance(x, Term)


def literal(x: Any) -> str:
    """A number or a name as C has it."""
    if isinstance(x, Term):
        return x.text
    if isinstance(x, bool | np.bool_ | int | np.integer):
        # C takes the digits and the sign for two things, of which the first may be too large.
        return str(int(x)) if x > -(2**63) else f"({int(x) + 1} - 1)"
    x = float(x)
    if np.isnan(x):
        return "NAN"
    if np.isinf(x):
        return "INFINITY" if x > 0 else "-INFINITY"
    return repr(x)


def uses_of(numbers: Sequence[Any]) -> tuple[str, ...]:
    """The variables that some numbers need."""
    variables = {name: None for x in numbers if isinstance(x, Term) for name in x.uses}
    return tuple(variables)


def distinct(numbers: Iterable[Any]) -> list[Any]:
    """Known numbers, and after them each term once: so the zeros of a sparse array are one."""
    terms = {x.text: x for x in numbers if not is_known(x)}
    return [*(x for x in numbers if is_known(x)), *terms.values()]


class Writer:
    """The body of a function of C, written line by line; equal terms are computed once.

    - `most`: how many operations there may be. `unrolled`: how many one loop may become as lines
      of its own; a larger one is a loop in C.
    """

    def __init__(self, prefix: str, most: int, unrolled: int) -> None:
        self.prefix, self.most, self.unrolled = prefix, most, unrolled
        self._lines: list[_Statement] = []
        self._scopes: list[dict[str, Term]] = [{}]
        self._tables: dict[str, str] = {}
        self._texts: dict[str, str] = {}
        self._count = 0

    @property
    def written(self) -> int:
        """How many lines the innermost loop has."""
        return len(self._lines)

    def name(self, stem: str) -> str:
        """Return a new name."""
        self._count += 1
        return f"{stem}{self._count - 1}"

    def compute(self, kind: str, pattern: str, *numbers: Any, exact: bool = True) -> Term:
        """The term of an expression, `pattern` with the numbers in their places.

        `exact`: whether a double can hold it, in which other functions are given it.
        """
        text = pattern.format(*[literal(x) for x in numbers])
        for scope in reversed(self._scopes):
            if text in scope:
                return scope[text]
        if len(self._lines) > 4 * self.most:
            refuse(
                f"more than {4 * self.most} operations before those are left out that nobody uses",
                f"straight-line code pays up to {self.most}; reduce the system",
            )
        name, c = self.name("x"), TYPES[kind]
        count = int(pattern != "{}")  # a number that only gets a name is none
        own = f"const {c} {name} = {text};"
        held = c if exact else ""
        self._lines.append(_Statement(own, (name,), uses_of(numbers), count, kind=held))
        term = self._scopes[-1][text] = Term(name, (name,))
        return term

    def line(
        self, text: str, defines: tuple[str, ...], uses: tuple[str, ...], operations: int = 0
    ) -> None:
        """Add a line; one that defines nothing stays, others where they are used."""
        self._lines.append(_Statement(text, defines, uses, operations))

    def variable(self, kind: str, value: Any) -> Term:
        """A variable that starts with a value and may change."""
        name = self.name("w")
        self.line(f"{TYPES[kind]} {name} = {literal(value)};", (name,), uses_of([value]))
        return Term(name, (name,))

    def array(
        self,
        kind: str,
        values: Sequence[Any],
        changes: Mapping[str, Any] | None = None,
        *needed: Term,
    ) -> str:
        """The name of an array of values, some of which are changed right after, by their places
        in C, which have `needed` these terms.

        A table of numbers is kept once, outside of the function.
        """
        if not changes and all(is_known(x) for x in values):
            return self._table(kind, values)
        name, numbers = self.name("a"), ", ".join(literal(x) for x in values)
        changed = changes or {}
        # One statement, so that the array and its changes stay together.
        text = f"{TYPES[kind]} {name}[{len(values)}] = {{{numbers}}};"
        text += "".join(f" {name}[{place}] = {literal(x)};" for place, x in changed.items())
        uses = uses_of([*values, *changed.values(), *needed])
        self.line(text, (name,), uses, len(values))
        return name

    def _table(self, kind: str, values: Sequence[Any]) -> str:
        numbers = ", ".join(literal(x) for x in values)
        key = kind + numbers
        if key not in self._tables:
            name = self._tables[key] = f"{self.prefix}_table{len(self._tables)}"
            head = f"static const {TYPES[kind]} {name}[{len(values)}]"
            self._texts[name] = f"{head} = {{{numbers}}};"
        return self._tables[key]

    def room(self, kind: str, size: int) -> str:
        """The name of an array without values."""
        name = self.name("a")
        self.line(f"{TYPES[kind]} {name}[{size}];", (name,), ())
        return name

    def mark(self) -> tuple[int, int]:
        """Return where the writing is, for `forget`."""
        self._scopes.append({})
        return len(self._lines), self._count

    def forget(self, mark: tuple[int, int]) -> None:
        """Take back what was written since a mark."""
        del self._lines[mark[0] :]
        self._count = mark[1]
        self._scopes.pop()

    def keep(self) -> None:
        """Keep what was written since the last mark."""
        scope = self._scopes.pop()
        self._scopes[-1].update(scope)

    @contextlib.contextmanager
    def loop(self, head: str, defines: tuple[str, ...]) -> Iterator[None]:
        """Write the body of a loop, which changes the variables that it `defines`."""
        outer, self._lines = self._lines, []
        self._scopes.append({})
        try:
            yield
        finally:
            body, self._lines = self._lines, outer
            self._scopes.pop()
        self._lines.append(_Statement(head, defines, (), 0, body))

    def finish(self, results: Sequence[Any]) -> tuple[list[str], list[str], int]:
        """The lines that some results need, the tables, and the number of operations."""
        return self._finished(self._lines, set(uses_of(results)))

    def split(
        self, results: Sequence[Any], late_results: Sequence[Any], late: Iterable[str]
    ) -> tuple[list[str], tuple[list[str], list[str], int], tuple[list[str], list[str], int]]:
        """The names of the numbers that the `late_results` take from the function of the others,
        and what `finish` returns of both functions. `late`: variables that only one of them has.
        """
        unknown = set(late)
        for line in self._lines:
            _spread(line, unknown)
        known = {
            name: line
            for line in self._lines
            for name in line.defines
            if line.kind and name not in unknown
        }
        rest = [line for line in self._lines if not known.keys() & set(line.defines)]
        live = set(uses_of(late_results))
        second = self._finished(rest, live)
        kept = [name for name in known if name in live]
        loads = [
            f"  const {known[name].kind} {name} = ({known[name].kind})kept[{i}];"
            for i, name in enumerate(kept)
        ]
        first = self._finished(self._lines, {*uses_of(results), *kept})
        tables = [text for text in second[1] if text not in first[1]]
        return kept, first, (loads + second[0], tables, second[2])

    def _finished(
        self, lines: list[_Statement], live: set[str]
    ) -> tuple[list[str], list[str], int]:
        kept = _needed(lines, live)
        count = sum(_operations(x) for x in kept)
        if count > self.most:
            refuse(
                f"{count} operations, and straight-line code pays up to {self.most}",
                "reduce the system, or leave it to romjax.simulate",
            )
        tables = [text for name, text in self._texts.items() if name in live]
        return list(_texts(kept, "  ")), tables, count


def _spread(line: _Statement, names: set[str]) -> None:
    """Add to some names what a line computes from them; in a loop, by what is computed in it, and
    all that it changes where one of them says when it ends.
    """
    if line.body is None:
        if names.intersection(line.uses):
            names.update(line.defines)
        return
    known = -1
    while len(names) > known:
        known = len(names)
        for inner in line.body:
            _spread(inner, names)
            if not inner.defines and names.intersection(inner.uses):
                names.update(line.defines)


def _needed(lines: list[_Statement], live: set[str]) -> list[_Statement]:
    """The statements that have an effect or define what is `live`, which grows by what they use."""
    kept = []
    for line in reversed(lines):
        if line.defines and not live.intersection(line.defines):
            continue
        live.update(line.uses)
        if line.body is not None:
            # What the start of a loop uses, its end before has changed.
            known = -1
            while len(live) > known:
                known = len(live)
                body = _needed(line.body, live)
            line = dataclasses.replace(line, body=body)
        kept.append(line)
    return kept[::-1]


def _operations(line: _Statement) -> int:
    return line.operations + sum(_operations(x) for x in line.body or [])


def _texts(lines: list[_Statement], indent: str) -> Iterator[str]:
    for line in lines:
        if line.body is None:
            yield indent + line.text
        else:
            yield f"{indent}{line.text} {{"
            yield from _texts(line.body, indent + "  ")
            yield indent + "}"
