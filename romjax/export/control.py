"""The equations of a traced program, one after the other, and those that hold programs."""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

from .arithmetic import Arithmetic
from .arrays import Arrays, Cells, all_known, cells, kind_of, over
from .factors import Factors
from .iteration import Iteration
from .refuse import refuse
from .scatter import Scatter
from .sorting import Sorting
from .terms import Writer, distinct, is_known
from .whole import Whole
from .widths import is_whole

# What these hold is evaluated as it is: their derivatives were taken before, if any were.
_PLAIN = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "closed_call": "call_jaxpr",
    "core_call": "call_jaxpr",
    "eval_jaxpr": "call_jaxpr",
    "remat2": "jaxpr",
    "checkpoint": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}
# Sums in which the order and repetitions do not count.
_IDEMPOTENT = {"reduce_max", "reduce_min", "reduce_or", "reduce_and"}


class Control:
    """A program, written to a `Writer` equation by equation."""

    def __init__(self, writer: Writer, arithmetic: Arithmetic, arrays: Arrays) -> None:
        self.writer, self.arithmetic = writer, arithmetic
        self.whole = Whole(arithmetic)
        self.operations = {
            **arrays.operations,
            **Factors(arithmetic).operations,
            **Sorting(arithmetic).operations,
            **Scatter(arithmetic, self.run).operations,
            **Iteration(arithmetic, self.run).operations,
            "integer_pow": self._integer_pow,
            "convert_element_type": self._convert_element_type,
            "select_n": self._select_n,
            "clamp": self._clamp,
            "custom_linear_solve": self._custom_linear_solve,
            "cond": self._cond,
            "platform_index": self._platform_index,
            "bitcast_convert_type": self.whole.bitcast,
        }

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
        dtype = equation.invars[0].aval.dtype if equation.invars else None
        if self.whole.takes(name, dtype):
            return self.whole.call(name, x, p, dtype)
        if name in self.arithmetic.elementwise:
            function = self.arithmetic.elementwise[name]
            return over(lambda *numbers: function(*numbers, kind=kind), x)
        if name in self.arithmetic.sums:
            return self._sum(name, x[0], p, kind)
        if name not in self.operations:
            if all(all_known(each) for each in x):
                return _by_jax(equation, x)
            refuse(
                f"the operation `{name}` of JAX, for which there is no C",
                "write the part that needs it with other functions, or leave it to romjax.simulate",
            )
        return self.operations[name](x, p, kinds)

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
        dtype = np.dtype(p["new_dtype"])
        if is_whole(kinds[0]) and dtype.kind in "iu":
            return over(lambda a: self.whole.converted(a, dtype), x)
        new = kind_of(jax.core.ShapedArray((), dtype))
        return over(lambda a: self.arithmetic.convert(a, kinds[0], new), x)

    def _select_n(self, x: list[Cells], p: Any, kinds: list[str]) -> Cells:
        del p
        which, (first, *others), kind = x[0], x[1:], kinds[1]
        if kinds[0] == "b":
            return over(
                lambda w, a, b: self.arithmetic.choose(w, a, b, kind), [which, first, *others]
            )
        return self._chosen(which, [[first], *([each] for each in others)], [kind])[0]

    def _clamp(self, x: list[Cells], p: Any, kinds: list[str]) -> Cells:
        del p
        return over(lambda low, a, high: self.arithmetic.clamp(low, a, high, kinds[1]), x)

    def _custom_linear_solve(self, x: list[Cells], p: Any, kinds: list[str]) -> list[Cells]:
        del kinds
        lengths, solve = p["const_lengths"], p["jaxprs"].solve
        before = lengths.matvec + lengths.vecmat
        after = before + lengths.solve
        right = x[after + lengths.transpose_solve :]
        return self.run(solve.jaxpr, solve.consts, x[before:after] + right)

    def _cond(self, x: list[Cells], p: Any, kinds: list[str]) -> list[Cells]:
        """All branches, of which the results are chosen: none has an effect."""
        del kinds
        which, branches = x[0].item(), p["branches"]
        if is_known(which):
            taken = branches[min(max(int(which), 0), len(branches) - 1)]
            return self.run(taken.jaxpr, taken.consts, x[1:])
        results = [self.run(branch.jaxpr, branch.consts, x[1:]) for branch in branches]
        return self._chosen(x[0], results, [kind_of(v.aval) for v in branches[0].jaxpr.outvars])

    def _chosen(self, which: Cells, cases: list[list[Cells]], types: list[str]) -> list[Cells]:
        """The results of the case of a number, the last one beyond."""
        reaches, chosen = self.arithmetic.elementwise["ge"], cases[0]
        for number, other in enumerate(cases[1:], 1):
            takes = over(lambda w, n=number: reaches(w, n), [which])
            chosen = [
                over(lambda t, a, b, k=kind: self.arithmetic.choose(t, a, b, k), [takes, a, b])
                for a, b, kind in zip(chosen, other, types, strict=True)
            ]
        return chosen

    def _platform_index(self, x: list[Cells], p: Any, kinds: list[str]) -> Cells:
        """The branch of a processor, among those for several platforms."""
        del x, kinds
        taken = [each is None or "cpu" in each for each in p["platforms"]]
        return cells(taken.index(True))


def _by_jax(equation: Any, x: list[Cells]) -> list[Cells]:
    """The results of an operation of numbers that are known."""
    with jax.ensure_compile_time_eval():
        given = [
            jnp.asarray(np.asarray(each.tolist(), atom.aval.dtype).reshape(atom.aval.shape))
            for each, atom in zip(x, equation.invars, strict=True)
        ]
        results = equation.primitive.bind(*given, **equation.params)
    return [cells(each) for each in (results if equation.primitive.multiple_results else [results])]
