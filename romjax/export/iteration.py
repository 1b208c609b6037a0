"""Loops of a traced program: written line by line where that is short, else as loops of C."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ..common import compat
from .arithmetic import Arithmetic
from .arrays import Cells, all_known, kind_of, over
from .terms import TYPES, Term, literal, uses_of


class Iteration:
    """Loops, as `Arithmetic` writes them; `run` evaluates the program that a loop holds."""

    def __init__(self, arithmetic: Arithmetic, run: Callable[..., list[Cells]]) -> None:
        self.arithmetic, self.writer, self._run = arithmetic, arithmetic.writer, run
        self.operations = {"scan": self.scan, "while": self.while_loop}

    def scan(self, x: list[Cells], p: Any, kinds: list[str]) -> list[Cells]:
        del kinds
        fixed, carried = compat.scan_counts(p)
        consts, carry, rows = x[:fixed], x[fixed : fixed + carried], x[fixed + carried :]
        length, inner = p["length"], p["jaxpr"]
        if not self.writer.unrolled:
            return self._scan_loop(p, consts, carry, rows)
        order = list(range(length))[:: -1 if p["reverse"] else 1]
        mark, start, seen = self.writer.mark(), carry, []
        first = self.writer.written
        for i in order:
            out = self._run(inner.jaxpr, inner.consts, [*consts, *carry, *(row[i] for row in rows)])
            carry, written = out[:carried], self.writer.written - first
            seen.append(out[carried:])
            if written * length > self.writer.unrolled * (len(seen)):
                self.writer.forget(mark)
                return self._scan_loop(p, consts, start, rows)
        self.writer.keep()
        if p["reverse"]:
            seen.reverse()
        shapes = [v.aval.shape for v in inner.jaxpr.outvars[carried:]]
        columns = [np.empty((length, *shape), object) for shape in shapes]
        for i, row in enumerate(seen):
            for column, value in zip(columns, row, strict=True):
                column[i] = value if value.ndim else value.item()
        return [*carry, *columns]

    def _scan_loop(
        self, p: Any, consts: list[Cells], start: list[Cells], rows: list[Cells]
    ) -> list[Cells]:
        """A scan as a loop of C, whose rows are in arrays."""
        inner, length, (fixed, carried) = p["jaxpr"], p["length"], compat.scan_counts(p)
        atoms = inner.jaxpr.invars[fixed:]
        types = [kind_of(v.aval) for v in atoms]
        names = [
            self.writer.array(k, list(row.flat))
            for k, row in zip(types[carried:], rows, strict=True)
        ]
        state = self._variables(start, types[:carried])
        outs = inner.jaxpr.outvars[carried:]
        places = [
            self.writer.room(kind_of(v.aval), max(1, length * int(np.prod(v.aval.shape))))
            for v in outs
        ]
        i = self.writer.name("i")
        forth = f"for (int {i} = 0; {i} < {length}; {i}++)"
        back = f"for (int {i} = {length - 1}; {i} >= 0; {i}--)"
        changed = tuple(t.text for each in state for t in each.flat)
        with self.writer.loop(back if p["reverse"] else forth, (*changed, *places)):
            now = [
                _entries(name, v.aval.shape, i)
                for name, v in zip(names, atoms[carried:], strict=True)
            ]
            out = self._run(inner.jaxpr, inner.consts, [*consts, *state, *now])
            for name, value in zip(places, out[carried:], strict=True):
                for k, each in enumerate(value.flat):
                    text = f"{name}[{i}*{value.size} + {k}] = {literal(each)};"
                    self.writer.line(text, (name,), uses_of([each]), 1)
            self._assign(state, out[:carried], types[:carried])
        each = zip(places, outs, strict=True)
        columns = [_entries(name, (length, *v.aval.shape), None) for name, v in each]
        return self._named([*state, *columns], types[:carried] + [kind_of(v.aval) for v in outs])

    def while_loop(self, x: list[Cells], p: Any, kinds: list[str]) -> list[Cells]:
        condition, body = p["cond_jaxpr"], p["body_jaxpr"]
        a, b = p["cond_nconsts"], p["body_nconsts"]
        fixed, given, start = x[:a], x[a : a + b], x[a + b :]
        types = kinds[a + b :]
        mark, first, state = self.writer.mark(), self.writer.written, start
        while True:
            here = self.writer.mark()
            lanes, goes = self._goes(condition, fixed, state)
            self.writer.forget(here)
            if not all_known(lanes) or self.writer.written - first > self.writer.unrolled:
                break
            if not goes:
                self.writer.keep()
                return state
            new = self._run(body.jaxpr, body.consts, [*given, *state])
            state = self._going(lanes, state, new, types)
        self.writer.forget(mark)
        state = self._variables(start, types)
        names = tuple(t.text for each in state for t in each.flat)
        with self.writer.loop("for (;;)", names):
            lanes, goes = self._goes(condition, fixed, state)
            self.writer.line(f"if (!({literal(goes)})) break;", (), uses_of([goes]), 1)
            out = self._run(body.jaxpr, body.consts, [*given, *state])
            self._assign(state, self._going(lanes, state, out, types), types)
        return self._named(state, types)

    def _goes(self, condition: Any, fixed: list[Cells], state: list[Cells]) -> tuple[Cells, Any]:
        """Which lanes of a loop go on, and whether any does."""
        (lanes,) = self._run(condition.jaxpr, condition.consts, [*fixed, *state])
        return lanes, functools.reduce(self.arithmetic.either, lanes.flat, False)

    def _going(
        self, lanes: Cells, old: list[Cells], new: list[Cells], types: list[str]
    ) -> list[Cells]:
        """The new numbers of lanes that go on, where a loop has any."""
        if not lanes.ndim:
            return new
        choose = self.arithmetic.choose
        return [
            over(
                lambda goes, a, b, k=kind: choose(goes, a, b, k),
                [lanes.reshape(lanes.shape + (1,) * (a.ndim - lanes.ndim)), a, b],
            )
            for a, b, kind in zip(old, new, types, strict=True)
        ]

    def _named(self, values: list[Cells], types: list[str]) -> list[Cells]:
        """Variables that change no more as numbers with names of their own."""
        write, each = self.writer.compute, zip(values, types, strict=True)
        return [over(lambda x, k=kind: write(k, "{}", x), [value]) for value, kind in each]

    def _variables(self, values: list[Cells], types: list[str]) -> list[Cells]:
        """Variables that start with values."""
        state = []
        for value, kind in zip(values, types, strict=True):
            out = np.empty(value.shape, object)
            for at in np.ndindex(value.shape):
                out[at] = self.writer.variable(kind, value[at])
            state.append(out)
        return state

    def _assign(self, state: list[Cells], values: list[Cells], types: list[str]) -> None:
        """Change variables to values, all at once: some may need the old ones of others."""
        changes = []
        for old, new, kind in zip(state, values, types, strict=True):
            for variable, value in zip(old.flat, new.flat, strict=True):
                if isinstance(value, Term) and value.text == variable.text:
                    continue
                held = self.writer.name("n")
                text = f"const {TYPES[kind]} {held} = {literal(value)};"
                self.writer.line(text, (held,), uses_of([value]))
                changes.append((variable, held))
        for variable, held in changes:
            self.writer.line(f"{variable} = {held};", variable.uses, (held,))


def _entries(name: str, shape: tuple[int, ...], index: str | None) -> Cells:
    """The entries of an array in C, or of its row of some `index`."""
    size = int(np.prod(shape))
    base = "" if index is None else f"{index}*{size} + "
    out = np.empty(size, object)
    for k in range(size):
        out[k] = Term(f"{name}[{base}{k}]", (name,))
    return out.reshape(shape)
