"""Operations on single numbers, known ones at once, others as terms of C."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from .folding import before, folded, log_gamma
from .terms import Term, Writer, is_known
from .widths import is_whole, nearest, to_nearest, wrapped, wrapping

Function = Callable[..., Any]
# Powers up to this one are products.
_PRODUCTS = 8


class Arithmetic:
    """Operations that write to a `Writer`. A product with a known zero is zero, and so no term."""

    def __init__(self, writer: Writer) -> None:
        self.writer = writer
        self.elementwise: dict[str, Function] = self._elementwise()
        away = self._function("round", lambda a: math.copysign(math.floor(abs(a) + 0.5), a))
        # Halves go away from zero, or to the even number, as the number of JAX's method says.
        self.rounded = away, self._function("rint", np.rint)
        self.sums: dict[str, Function] = {
            "reduce_sum": self.add,
            "reduce_max": self.largest,
            "reduce_min": self.least,
            "reduce_or": self.either,
            "reduce_and": self.both,
            "reduce_prod": self.mul,
            "cumsum": self.add,
            "cumprod": self.mul,
            "cummax": self.largest,
            "cummin": self.least,
        }

    def add(self, a: Any, b: Any, kind: str = "f") -> Any:
        if is_known(a) and is_known(b):
            return wrapped(a + b, kind)
        if _is(a, 0):
            return b
        if _is(b, 0):
            return a
        if (plus := _minus(b)) is not None:
            return self.sub(a, plus, kind)
        if (plus := _minus(a)) is not None:
            return self.sub(b, plus, kind)
        return self._written(kind, "{} + {}", *_ordered(a, b))

    def sub(self, a: Any, b: Any, kind: str = "f") -> Any:
        if is_known(a) and is_known(b):
            return wrapped(a - b, kind)
        if _is(b, 0):
            return a
        if _is(a, 0):
            return self.neg(b, kind)
        if (plus := _minus(b)) is not None:
            return self.add(a, plus, kind)
        return self._written(kind, "{} - {}", a, b)

    def neg(self, a: Any, kind: str = "f") -> Any:
        if is_known(a):
            return wrapped(-a, kind)
        if a.minus is not None:
            return a.minus
        negative = self._written(kind, "0 - {}" if is_whole(kind) else "-{}", a)
        negative.minus = a
        return negative

    def mul(self, a: Any, b: Any, kind: str = "f") -> Any:
        if is_known(a) and is_known(b):
            return wrapped(a * b, kind)
        if _is(a, 0) or _is(b, 0):
            return 0.0 if kind == "f" else 0
        if _is(a, 1):
            return b
        if _is(a, -1):
            return self.neg(b, kind)
        if _is(b, -1):
            return self.neg(a, kind)
        if _is(b, 1):
            return a
        # Signs go outwards, where sums take them: of numbers at once.
        a, b = _ordered(a, b)
        if (plus := _minus(a)) is not None:
            return (
                self.mul(plus, self.neg(b, kind), kind)
                if is_known(b)
                else self._negative(plus, b, kind)
            )
        if (plus := _minus(b)) is not None:
            return self._negative(a, plus, kind)
        return self._written(kind, "{} * {}", a, b)

    def _written(self, kind: str, pattern: str, *numbers: Any) -> Term:
        """The term of an expression, in which whole numbers keep the bits of their type."""
        exact = kind not in ("int64", "uint64")
        return self.writer.compute(kind, wrapping(pattern, kind), *numbers, exact=exact)

    def _negative(self, a: Any, b: Any, kind: str) -> Any:
        return self.neg(self.mul(a, b, kind), kind)

    def div(self, a: Any, b: Any, kind: str = "f") -> Any:
        if is_known(a) and is_known(b):
            return a / b if b else folded(np.divide, a, b)
        if _is(a, 0):
            return 0.0
        return a if _is(b, 1) else self.writer.compute(kind, "{} / {}", a, b)

    def power(self, a: Any, exponent: int, kind: str = "f") -> Any:
        """A whole power; small ones by products."""
        if exponent < 0:
            return self.div(1.0, self.power(a, -exponent, kind), kind)
        if exponent > _PRODUCTS and not is_whole(kind):
            return self._function("pow", np.power)(a, float(exponent))
        result, factor = None, a
        while exponent:
            if exponent & 1:
                result = factor if result is None else self.mul(result, factor, kind)
            exponent >>= 1
            factor = self.mul(factor, factor, kind) if exponent else factor
        return (1 if is_whole(kind) else 1.0) if result is None else result

    def largest(self, a: Any, b: Any, kind: str = "f") -> Any:
        """The larger one; NaN if one is NaN, which fmax would leave out."""
        if is_known(a) and is_known(b):
            return folded(np.maximum, a, b)
        return self._extreme(">", a, b, kind)

    def least(self, a: Any, b: Any, kind: str = "f") -> Any:
        if is_known(a) and is_known(b):
            return folded(np.minimum, a, b)
        return self._extreme("<", a, b, kind)

    def _extreme(self, sign: str, a: Any, b: Any, kind: str) -> Any:
        if is_known(a):
            a, b = b, a
        # Whole numbers are never NaN, nor is one that is known.
        if kind != "f":
            return self.writer.compute(kind, f"{{0}} {sign} {{1}} ? {{0}} : {{1}}", a, b)
        return self.writer.compute(
            kind, f"({{0}} {sign} {{1}} || {{0}} != {{0}}) ? {{0}} : {{1}}", a, b
        )

    def either(self, a: Any, b: Any, kind: str = "b") -> Any:
        if is_known(a) or is_known(b):
            known, other = (a, b) if is_known(a) else (b, a)
            return True if known else other
        return self.writer.compute("b", "{} || {}", a, b)

    def both(self, a: Any, b: Any, kind: str = "b") -> Any:
        if is_known(a) or is_known(b):
            known, other = (a, b) if is_known(a) else (b, a)
            return other if known else False
        return self.writer.compute("b", "{} && {}", a, b)

    def choose(self, which: Any, first: Any, second: Any, kind: str) -> Any:
        """`second` where `which` is true."""
        if is_known(which):
            return second if which else first
        if first is second or (is_known(first) and is_known(second) and _same(first, second)):
            return first
        return self.writer.compute(kind, "{} ? {} : {}", which, second, first)

    def convert(self, a: Any, old: str, new: str) -> Any:
        """A number of another kind."""
        if is_known(a):
            return nearest(a, new) if is_whole(new) else {"f": float, "b": bool}[new](a)
        if old == new or (old == "b" and is_whole(new)):
            return a
        if new == "b":
            return self.writer.compute("b", "{} != 0", a)
        return self.writer.compute(new, "(double){}" if new == "f" else to_nearest(new), a)

    def clamp(self, low: Any, a: Any, high: Any, kind: str) -> Any:
        return self.least(self.largest(a, low, kind), high, kind)

    def _function(self, name: str, known: Callable[..., Any]) -> Function:
        """A function of C's library."""

        def call(*numbers: Any, kind: str = "f") -> Any:
            del kind
            if all(is_known(x) for x in numbers):
                return folded(known, *numbers)
            places = ", ".join("{}" for _ in numbers)
            return self.writer.compute("f", f"{name}({places})", *numbers)

        return call

    def _comparison(self, pattern: str, known: Callable[[Any, Any], bool]) -> Function:
        def compare(a: Any, b: Any, kind: str = "b") -> Any:
            del kind
            if is_known(a) and is_known(b):
                return bool(known(a, b))
            return self.writer.compute("b", pattern, a, b)

        return compare

    def _sign(self, a: Any, kind: str = "f") -> Any:
        if is_known(a):
            return folded(np.sign, a)
        # Zero and NaN are their own signs.
        return self.writer.compute(kind, "{0} > 0 ? 1 : {0} < 0 ? -1 : {0}", a)

    def _not(self, a: Any, kind: str = "b") -> Any:
        del kind
        return (not a) if is_known(a) else self.writer.compute("b", "!{}", a)

    def _finite(self, a: Any, kind: str = "b") -> Any:
        del kind
        return bool(np.isfinite(a)) if is_known(a) else self.writer.compute("b", "isfinite({})", a)

    def _absolute(self, a: Any, kind: str = "f") -> Any:
        if is_known(a):
            return wrapped(abs(a), kind)
        if kind == "f":
            return self.writer.compute(kind, "fabs({})", a)
        return self.choose(self.elementwise["lt"](a, 0), a, self.neg(a, kind), kind)

    def _elementwise(self) -> dict[str, Function]:
        comparisons: dict[str, tuple[str, Callable[[Any, Any], bool]]] = {
            "gt": ("{} > {}", np.greater),
            "lt": ("{} < {}", np.less),
            "ge": ("{} >= {}", np.greater_equal),
            "le": ("{} <= {}", np.less_equal),
            "eq": ("{} == {}", np.equal),
            "ne": ("{} != {}", np.not_equal),
            "xor": ("{} != {}", np.not_equal),
            # Searches in tables compare by these, where NaN comes last.
            "lt_to": ("{0} < {1} || ({1} != {1} && {0} == {0})", before),
            "le_to": ("{0} <= {1} || {1} != {1}", lambda a, b: not before(b, a)),
        }
        functions = {
            **{
                name: (name, getattr(np, name))
                for name in ("sin", "cos", "tan", "sqrt", "exp", "exp2")
            },
            **{name: (name, getattr(np, name)) for name in ("sinh", "cosh", "tanh", "floor")},
            **{name: (name, getattr(np, name)) for name in ("ceil", "log", "log1p", "expm1")},
            **{name: (name, getattr(np, f"arc{name[1:]}")) for name in ("asin", "acos", "atan")},
            **{name: (name, getattr(np, f"arc{name[1:]}")) for name in ("asinh", "acosh", "atanh")},
            "atan2": ("atan2", np.arctan2),
            "pow": ("pow", np.power),
            "rem": ("fmod", np.fmod),
            "cbrt": ("cbrt", np.cbrt),
            **{name: (name, getattr(math, name)) for name in ("erf", "erfc")},
            "lgamma": ("lgamma", log_gamma),
        }
        known = {name: self._function(*each) for name, each in functions.items()}
        return {
            "add": self.add,
            "add_any": self.add,
            "sub": self.sub,
            "mul": self.mul,
            "div": self.div,
            "neg": self.neg,
            "max": self.largest,
            "min": self.least,
            "and": self.both,
            "or": self.either,
            "not": self._not,
            "abs": self._absolute,
            "sign": self._sign,
            "is_finite": self._finite,
            "square": lambda a, kind: self.mul(a, a, kind),
            # JAX 0.12 has it in derivatives of arc functions.
            "one_minus_square": lambda a, kind: self.mul(self.sub(1.0, a), self.add(1.0, a), kind),
            "rsqrt": lambda a, kind: self.div(1.0, known["sqrt"](a), kind),
            "logistic": lambda a, kind: self.div(1.0, self.add(1.0, known["exp"](self.neg(a)))),
            **known,
            **{name: self._comparison(*each) for name, each in comparisons.items()},
        }


def _minus(x: Any) -> Any:
    """The number of which x is the negative, if it is one."""
    return x.minus if isinstance(x, Term) else None


def _ordered(a: Any, b: Any) -> tuple[Any, Any]:
    """Both in the one order in which sums and products of them are written, known ones last."""
    if is_known(a) != is_known(b):
        return (b, a) if is_known(a) else (a, b)
    return (a, b) if (len(str(a)), str(a)) <= (len(str(b)), str(b)) else (b, a)


def _is(x: Any, value: float) -> bool:
    return not isinstance(x, Term) and bool(x == value)


def _same(a: Any, b: Any) -> bool:
    return bool(a == b) and math.copysign(1, a) == math.copysign(1, b)
