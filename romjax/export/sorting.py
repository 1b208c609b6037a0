"""Sorting of short rows, as the transposes of linear solutions ask for."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .arithmetic import Arithmetic
from .arrays import Cells, Operands
from .refuse import refuse
from .terms import TYPES, Term, literal, uses_of

# By insertion, which keeps the order of equal keys; NaN comes last, as in JAX.
_SORT = """{{
    for (int i = 1; i < {n}; i++)
      for (int j = i; j > 0 && ({key}[j - 1] > {key}[j]{nan}); j--) {{
{exchanges}
      }}
  }}"""
_NAN = " || ({key}[j - 1] != {key}[j - 1] && {key}[j] == {key}[j])"
_EXCHANGE = "        { const KIND held = ROW[j]; ROW[j] = ROW[j - 1]; ROW[j - 1] = held; }"


class Sorting:
    """The operations by their names, as `Arrays` has them."""

    def __init__(self, arithmetic: Arithmetic) -> None:
        self.writer = arithmetic.writer
        self.operations: dict[str, Callable[[Operands, Any, list[str]], Any]] = {"sort": self._sort}

    def _sort(self, x: Operands, p: Any, kinds: list[str]) -> list[Cells]:
        """All arrays in the order of the first along one axis: a loop, since it depends on the
        numbers.
        """
        if p["num_keys"] > 1:
            refuse("sorting by several keys", "sort by one key after the other")
        rows = [np.moveaxis(each, p["dimension"], -1) for each in x]
        out = [np.empty(each.shape, object) for each in rows]
        for at in np.ndindex(rows[0].shape[:-1]):
            for to, values in zip(out, self._row([each[at] for each in rows], kinds), strict=True):
                to[at] = values
        return [np.moveaxis(each, -1, p["dimension"]) for each in out]

    def _row(self, rows: list[Cells], kinds: list[str]) -> list[list[Any]]:
        n, names = len(rows[0]), [self.writer.name("a") for _ in rows]
        types = [TYPES[kind] for kind in kinds]
        values = [value for row in rows for value in row]
        begun = [
            f"{kind} {name}[{n}] = {{{', '.join(literal(value) for value in row)}}};"
            for kind, name, row in zip(types, names, rows, strict=True)
        ]
        exchanges = "\n".join(
            _EXCHANGE.replace("KIND", kind).replace("ROW", name)
            for kind, name in zip(types, names, strict=True)
        )
        key, nan = names[0], _NAN.format(key=names[0]) if kinds[0] == "f" else ""
        loops = _SORT.format(n=n, key=key, nan=nan, exchanges=exchanges)
        self.writer.line(" ".join(begun) + " " + loops, tuple(names), uses_of(values), n * n // 2)
        # Numbers with names, so that other functions may go on with them.
        return [
            [self.writer.compute(kind, "{}", Term(f"{name}[{k}]", (name,))) for k in range(n)]
            for kind, name in zip(kinds, names, strict=True)
        ]
