"""Factors of small dense matrices, and solutions with them."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .arithmetic import Arithmetic
from .arrays import Cells, Operands, filled
from .terms import Term, literal, uses_of

# In place, with rows exchanged: their order R, and P, with which row each was exchanged.
_LU = """{{
    for (int i = 0; i < {n}; i++) {r}[i] = i;
    for (int i = 0; i < {n}; i++) {{
      int best = i;
      for (int j = i + 1; j < {n}; j++)
        if (fabs({a}[j*{n} + i]) > fabs({a}[best*{n} + i])) best = j;
      {p}[i] = best;
      if (best != i) {{
        const long long row = {r}[i];
        {r}[i] = {r}[best];
        {r}[best] = row;
        for (int k = 0; k < {n}; k++) {{
          const double held = {a}[i*{n} + k];
          {a}[i*{n} + k] = {a}[best*{n} + k];
          {a}[best*{n} + k] = held;
        }}
      }}
      for (int j = i + 1; j < {n}; j++) {{
        {a}[j*{n} + i] /= {a}[i*{n} + i];
        for (int k = i + 1; k < {n}; k++) {a}[j*{n} + k] -= {a}[j*{n} + i]*{a}[i*{n} + k];
      }}
    }}
  }}"""


class Factors:
    """The operations by their names, as `Arrays` has them."""

    def __init__(self, arithmetic: Arithmetic) -> None:
        self.arithmetic = arithmetic
        self.operations: dict[str, Callable[[Operands, Any, list[str]], Any]] = {
            "lu": self._lu,
            "cholesky": self._cholesky,
            "triangular_solve": self._triangular_solve,
        }

    def _lu(self, x: Operands, p: Any, kinds: list[str]) -> list[Cells]:
        """L U = P A by rows, with pivots: a loop, since the pivots depend on the numbers."""
        del p, kinds
        batch, n = x[0].shape[:-2], x[0].shape[-1]
        factors, pivots, orders = (np.empty((*batch, *end), object) for end in ((n, n), (n,), (n,)))
        writer = self.arithmetic.writer
        for at in np.ndindex(batch):
            values = list(x[0][at].flat)
            a, q, r = (writer.name("a") for _ in range(3))
            numbers = ", ".join(literal(value) for value in values)
            text = f"double {a}[{n * n}] = {{{numbers}}}; long long {q}[{n}], {r}[{n}]; "
            loops = _LU.format(n=n, a=a, p=q, r=r)
            # An elimination of n rows takes about n³ / 3 products.
            writer.line(text + loops, (a, q, r), uses_of(values), n**3 // 3)
            for out, name, kind in ((factors, a, "f"), (pivots, q, "i"), (orders, r, "i")):
                part = out[at]
                for place, where in enumerate(np.ndindex(part.shape)):
                    # A number with a name, so that another function may go on with it.
                    part[where] = writer.compute(kind, "{}", Term(f"{name}[{place}]", (name,)))
        return [factors, pivots, orders]

    def _cholesky(self, x: Operands, p: Any, kinds: list[str]) -> Cells:
        del p, kinds
        a, f = x[0], self.arithmetic
        out, n, root = filled(a.shape, 0.0), a.shape[-1], f.elementwise["sqrt"]
        for at in np.ndindex(a.shape[:-2]):
            rows = out[at]
            for i in range(n):
                for j in range(i + 1):
                    rest = a[(*at, i, j)]
                    for k in range(j):
                        rest = f.sub(rest, f.mul(rows[i, k], rows[j, k]))
                    rows[i, j] = root(rest) if i == j else f.div(rest, rows[j, j])
        return out

    def _triangular_solve(self, x: Operands, p: Any, kinds: list[str]) -> Cells:
        """A X = B, or X A = B, of which the transpose is solved."""
        del kinds
        a, b = (np.array(each) for each in x)
        turned, lower = p["transpose_a"], p["lower"]
        if not p["left_side"]:
            b, turned = np.swapaxes(b, -1, -2), not turned
        if turned:
            a, lower = np.swapaxes(a, -1, -2), not lower
        out, n = b.copy(), a.shape[-1]
        order = range(n) if lower else range(n - 1, -1, -1)
        for at in np.ndindex(a.shape[:-2]):
            self._substitute(a[at], out[at], order, p["unit_diagonal"])
        return out if p["left_side"] else np.swapaxes(out, -1, -2)

    def _substitute(self, a: Cells, b: Cells, order: range, unit: bool) -> None:
        """Row after row in an `order`, in place of the right-hand sides."""
        f, known = self.arithmetic, list[int]()
        for i in order:
            for column in range(b.shape[1]):
                rest = b[i, column]
                for k in known:
                    rest = f.sub(rest, f.mul(a[i, k], b[k, column]))
                b[i, column] = rest if unit else f.div(rest, a[i, i])
            known.append(i)
