"""The equations of a traced program, one after the other, and those that hold programs."""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jax.extend import core

from ..common import compat
from .arithmetic import Arithmetic
from .arrays import Arrays, Cells, cells, over
from .factors import Factors
from .refuse import refuse
from .terms import TYPES, Term, Writer, distinct, is_known, literal, uses_of

# What these hold is evaluated as it is: their derivatives were taken before, if any were.
_PLAIN = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "closed_call": "call_jaxpr",
    "core_call": "call_jaxpr",
    "remat2": "jaxpr",
    "checkpoint": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}
# Sums in which the order and repetitions do not count.
_IDEMPOTENT = {"reduce_max", "reduce_min", "reduce_or", "reduce_and"}
# Operations of truth values, which are others of whole numbers.
_LOGICAL = {"and", "or", "not"}


class Control:
    """A program, written to a `Writer` equation by equation."""

    def __init__(self, writer: Writer, arithmetic: Arithmetic, arrays: Arrays) -> None:
        self.writer, self.arithmetic = writer, arithmetic
        self.operations = arrays.operations | Factors(arithmetic).operations

    def run(self, jaxpr: Any, consts: Sequence[Any], args: Sequence[Cells]) -> list[Cells]:
        """Evaluate a program at numbers, known or not."""
        known: dict[Any, Cells] = {}

        def read(atom: Any) -> Cells:
            return cells(atom.val) if isinstance(atom, core.Literal) else known[atom]

        for variable, value in zip(jaxpr.constvars, consts, strict=True):
            known[variable] = cells(value)
        for variable, value in zip(jaxpr.invars, args, strict=True):
            known[variable] = np.asarray(value, dtype=object).reshape(variable.aval.shape)
        for equation in jaxpr.eqns:
            results = self._evaluate(equation, [read(x) for x in equation.invars])
            if not isinstance(results, list):
                results = [results]
            for variable, result in zip(equation.outvars, results, strict=True):
                known[variable] = np.asarray(result, dtype=object).reshape(variable.aval.shape)
        return [read(x) for x in jaxpr.outvars]

    def _evaluate(self, equation: Any, x: list[Cells]) -> Any:
        name, p = equation.primitive.name, equation.params
        kinds = [kind_of(atom.aval) for atom in equation.invars]
        kind = kind_of(equation.outvars[0].aval) if equation.outvars else "f"
        if name in _PLAIN:
            inner = p[_PLAIN[name]]
            inner, consts = (inner.jaxpr, inner.consts) if hasattr(inner, "consts") else (inner, [])
            return self.run(inner, consts, x)
        if name in _LOGICAL and kind != "b":
            refuse(f"`{name}` of the bits of whole numbers", "leave it to romjax.simulate")
        if name in self.arithmetic.elementwise:
            function = self.arithmetic.elementwise[name]
            return over(lambda *numbers: function(*numbers, kind=kind), x)
        if name in self.arithmetic.sums:
            return self._sum(name, x[0], p, kind)
        if name in self.operations:
            return self.operations[name](x, p, kinds)
        held = getattr(self, f"_{name.replace('-', '_')}", None)
        if held is None:
            refuse(
                f"the operation `{name}` of JAX, for which there is no C",
                "write the part that needs it with other functions, or leave it to romjax.simulate",
            )
        return held(x, p, kinds)

    def _sum(self, name: str, x: Cells, p: Any, kind: str) -> Cells:
        function = self.arithmetic.sums[name]

        def pair(a: Any, b: Any) -> Any:
            return function(a, b, kind)

        if name.startswith("cum"):
            rows = np.moveaxis(x, p["axis"], 0)[:: -1 if p["reverse"] else 1].copy()
            for i in range(1, len(rows)):
                rows[i, ...] = over(pair, [rows[i - 1], rows[i]])
            return np.moveaxis(rows[:: -1 if p["reverse"] else 1], 0, p["axis"])
        empty = {"reduce_sum": 0.0, "reduce_prod": 1.0, "reduce_or": False, "reduce_and": True}
        once = name in _IDEMPOTENT
        for axis in sorted(p["axes"], reverse=True):
            if not x.shape[axis]:
                start = empty.get(name, -np.inf if name == "reduce_max" else np.inf)
                return cells(np.full(np.delete(x.shape, axis), start))
            rows = np.moveaxis(x, axis, -1)
            x = np.empty(rows.shape[:-1], object)
            for at in np.ndindex(x.shape):
                x[at] = functools.reduce(pair, distinct(rows[at]) if once else rows[at])
        return x

    def _integer_pow(self, x: list[Cells], p: Any, kinds: list[str]) -> Cells:
        return over(lambda a: self.arithmetic.power(a, p["y"], kinds[0]), x)

    def _convert_element_type(self, x: list[Cells], p: Any, kinds: list[str]) -> Cells:
        new = kind_of(jax.core.ShapedArray((), p["new_dtype"]))
        return over(lambda a: self.arithmetic.convert(a, kinds[0], new), x)

    def _select_n(self, x: list[Cells], p: Any, kinds: list[str]) -> Cells:
        del p
        which, cases, kind = x[0], x[1:], kinds[1]
        if len(cases) > 2:
            refuse("a choice among more than two arrays", "nest choices between two")
        return over(lambda w, a, b: self.arithmetic.choose(w, a, b, kind), [which, *cases])

    def _clamp(self, x: list[Cells], p: Any, kinds: list[str]) -> Cells:
        del p
        return over(lambda low, a, high: self.arithmetic.clamp(low, a, high, kinds[1]), x)

    def _custom_linear_solve(self, x: list[Cells], p: Any, kinds: list[str]) -> list[Cells]:
        del kinds
        lengths, solve = p["const_lengths"], p["jaxprs"].solve
        before = lengths.matvec + lengths.vecmat
        after = before + lengths.solve
        rest = x[after + lengths.transpose_solve :]
        return self.run(solve.jaxpr, solve.consts, x[before:after] + rest)

    def _cond(self, x: list[Cells], p: Any, kinds: list[str]) -> list[Cells]:
        """All branches, of which the results are chosen: none has an effect."""
        del kinds
        which, branches = x[0].item(), p["branches"]
        if is_known(which):
            taken = branches[min(max(int(which), 0), len(branches) - 1)]
            return self.run(taken.jaxpr, taken.consts, x[1:])
        results = [self.run(branch.jaxpr, branch.consts, x[1:]) for branch in branches]
        chosen, types = results[0], [kind_of(v.aval) for v in branches[0].jaxpr.outvars]
        for number, other in enumerate(results[1:], 1):
            takes = self.writer.compute("b", f"{{}} >= {number}", which)
            chosen = [
                over(lambda a, b, t=takes, k=kind: self.arithmetic.choose(t, a, b, k), [a, b])
                for a, b, kind in zip(chosen, other, types, strict=True)
            ]
        return chosen

    def _platform_index(self, x: list[Cells], p: Any, kinds: list[str]) -> Cells:
        """The branch of a processor, among those for several platforms."""
        del x, kinds
        taken = [each is None or "cpu" in each for each in p["platforms"]]
        return cells(taken.index(True))

    # Loops.

    def _scan(self, x: list[Cells], p: Any, kinds: list[str]) -> list[Cells]:
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
            out = self.run(inner.jaxpr, inner.consts, [*consts, *carry, *(row[i] for row in rows)])
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
            out = self.run(inner.jaxpr, inner.consts, [*consts, *state, *now])
            for name, value in zip(places, out[carried:], strict=True):
                for k, each in enumerate(value.flat):
                    text = f"{name}[{i}*{value.size} + {k}] = {literal(each)};"
                    self.writer.line(text, (name,), uses_of([each]), 1)
            self._assign(state, out[:carried], types[:carried])
        each = zip(places, outs, strict=True)
        columns = [_entries(name, (length, *v.aval.shape), None) for name, v in each]
        return self._named([*state, *columns], types[:carried] + [kind_of(v.aval) for v in outs])

    def _while(self, x: list[Cells], p: Any, kinds: list[str]) -> list[Cells]:
        condition, body = p["cond_jaxpr"], p["body_jaxpr"]
        a, b = p["cond_nconsts"], p["body_nconsts"]
        fixed, given, start = x[:a], x[a : a + b], x[a + b :]
        types = kinds[a + b :]
        mark, first, state = self.writer.mark(), self.writer.written, start
        while True:
            here = self.writer.mark()
            goes = self.run(condition.jaxpr, condition.consts, [*fixed, *state])[0].item()
            self.writer.forget(here)
            if not is_known(goes) or self.writer.written - first > self.writer.unrolled:
                break
            if not goes:
                self.writer.keep()
                return state
            state = self.run(body.jaxpr, body.consts, [*given, *state])
        self.writer.forget(mark)
        state = self._variables(start, types)
        names = tuple(t.text for each in state for t in each.flat)
        with self.writer.loop("for (;;)", names):
            goes = self.run(condition.jaxpr, condition.consts, [*fixed, *state])[0].item()
            self.writer.line(f"if (!({literal(goes)})) break;", (), uses_of([goes]), 1)
            out = self.run(body.jaxpr, body.consts, [*given, *state])
            self._assign(state, out, types)
        return self._named(state, types)

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


def kind_of(aval: Any) -> str:
    """The kind of the numbers of an array, one of `TYPES`."""
    dtype: Any = np.dtype(aval.dtype)
    if dtype.kind == "f" and dtype != np.float64:
        refuse(
            f"numbers of type {dtype}, since C is made in double precision",
            'call jax.config.update("jax_enable_x64", True) before making any array',
        )
    if dtype.kind not in TYPES:
        refuse(f"numbers of type {dtype}", "use real numbers")
    return str(dtype.kind)


def _entries(name: str, shape: tuple[int, ...], index: str | None) -> Cells:
    """The entries of an array in C, or of its row of some `index`."""
    size = int(np.prod(shape))
    base = "" if index is None else f"{index}*{size} + "
    out = np.empty(size, object)
    for k in range(size):
        out[k] = Term(f"{name}[{base}{k}]", (name,))
    return out.reshape(shape)
