"""Whole numbers of a program in C: their quotients, their bits, and those without a sign."""

import functools
import operator
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from .arithmetic import Arithmetic
from .arrays import Cells, Operands, over
from .refuse import refuse
from .terms import TYPES, is_known
from .widths import WIDE, is_whole, narrowed, wrapped

_BITS, _MASK = 64, 2**64 - 1  # of the type of C
_REDUCED = {"reduce_and": "and", "reduce_or": "or", "reduce_xor": "xor"}
# What may leave the range of numbers without a sign, where they go on from its other end.
_WRAPPED = {"not", "shift_left"}
# By zero, and of the least number by -1.
_DIVISIONS = {
    "div": f"{{1}} == 0 ? -1 : {{1}} == -1 ? ({TYPES['i']})(0 - {WIDE}{{0}}) : {{0}} / {{1}}",
    "rem": "{1} == 0 ? {0} : {1} == -1 ? 0 : {0} % {1}",
}
# What takes each bit of a number to be there; of fewer of them C has more.
_OF_BITS = {"shift_left", "shift_right_logical"}


class Whole:
    """The operations by their names, where they are others than those of real numbers."""

    def __init__(self, arithmetic: Arithmetic) -> None:
        self.writer = arithmetic.writer
        self._operations: dict[str, tuple[str, Callable[..., Any]]] = {
            "div": ("{} / {}", _quotient),
            "rem": ("{} % {}", lambda a, b: a - b * _quotient(a, b) if b else a),
            "and": ("{} & {}", operator.and_),
            "or": ("{} | {}", operator.or_),
            "xor": ("{} ^ {}", operator.xor),
            "not": ("~{}", operator.invert),
            "shift_left": (f"({TYPES['i']})({WIDE}{{}} << {{}})", operator.lshift),
            "shift_right_arithmetic": ("{} >> {}", operator.rshift),
            "shift_right_logical": (
                f"({TYPES['i']})({WIDE}{{}} >> {{}})",
                lambda a, n: (a & _MASK) >> n,
            ),
        }

    def takes(self, name: str, dtype: Any) -> bool:
        """Whether an operation of numbers of some type is one of those."""
        return is_whole(str(dtype)) and (name in self._operations or name in _REDUCED)

    def call(self, name: str, x: Operands, p: Any, dtype: Any) -> Cells:
        """The result of an operation that this takes."""
        if name not in _REDUCED:
            return over(lambda *numbers: self._one(name, np.dtype(dtype), *numbers), x)
        pair, rows = functools.partial(self._one, _REDUCED[name], np.dtype(dtype)), x[0]
        for axis in sorted(p["axes"], reverse=True):
            each = [np.take(rows, i, axis) for i in range(rows.shape[axis])]
            rows = functools.reduce(lambda a, b: over(pair, [a, b]), each)
        return rows

    def _one(self, name: str, dtype: Any, *numbers: Any) -> Any:
        (pattern, known), kind = self._operations[name], str(dtype)
        bits = 8 * dtype.itemsize
        wraps = dtype.kind == "u" and name in _WRAPPED
        if bits != _BITS if dtype.kind == "i" and name in _OF_BITS else bits == _BITS and wraps:
            refuse(f"`{name}` of numbers of type {dtype}", "take them as int64")
        if name.startswith("shift"):
            numbers = numbers[0], self._count(name, numbers[1])
            if numbers[1] == _BITS:
                return 0
        if all(is_known(x) for x in numbers):
            return wrapped(known(*map(int, numbers)), kind)
        if name == "and" and 0 in numbers:
            return 0
        if name in _DIVISIONS and (not is_known(numbers[1]) or numbers[1] in (0, -1)):
            # As XLA divides; C would end the process.
            pattern = _DIVISIONS[name]
        if wraps or name == "div":
            pattern = narrowed(pattern, kind)
        return self.writer.compute(kind, pattern, *numbers, exact=bits < _BITS)

    def converted(self, number: Any, dtype: Any) -> Any:
        """A whole number as one of another type, whose bits are the last ones of its own."""
        kind = str(dtype)
        if is_known(number):
            return wrapped(number, kind)
        if kind == "int64":
            return number
        return self.writer.compute(kind, narrowed("{}", kind), number)

    def _count(self, name: str, by: Any) -> int:
        """By how many bits a shift goes; all of them leave nothing, but a sign."""
        if not is_known(by):
            refuse(f"`{name}` by a number that depends on the state", "multiply by powers of 2")
        most = _BITS - 1 if name == "shift_right_arithmetic" else _BITS
        return int(by) if 0 <= by < most else most

    def bitcast(self, x: Operands, p: Any, kinds: list[str]) -> Cells:
        """The bits of a double as a whole number, and back."""
        old, new = "i" if kinds[0] == "int64" else kinds[0], np.dtype(p["new_dtype"])
        if {old, new.kind} - {"f", "i"} or 8 * new.itemsize != _BITS:
            refuse(f"the bits of a number as {new}", "take those of float64 as int64, and back")
        if old == new.kind:
            return x[0]
        formats = {"f": "<d", "i": "<q"}
        union = f"(union {{{{ double f; {TYPES['i']} i; }}}})"

        def one(number: Any) -> Any:
            if is_known(number):
                return struct.unpack(formats[new.kind], struct.pack(formats[old], number))[0]
            pattern = f"({union}{{{{.{old} = {{}}}}}}).{new.kind}"
            return self.writer.compute(new.kind, pattern, number, exact=new.kind == "f")

        return over(one, x)


def _quotient(a: int, b: int) -> int:
    """Rounded towards zero."""
    if b == 0:
        return -1
    return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)
