"""Results in words: numbers as one reads them, instead of the arrays that hold them."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np
from tabulate import tabulate

from .arrays import concrete

# Longer arrays are shown by their first and last numbers.
_MOST = 8


def is_number(text: str) -> bool:
    """Whether a text is a number as Python reads one."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def table(header: list[str], rows: list[list[str]]) -> str:
    """Columns of numbers, the first one of names, in plain text."""
    lines = [header, ["-" * len(name) for name in header], *rows]
    sides = ["left"] + ["right"] * (len(header) - 1)
    return tabulate(lines, tablefmt="plain", disable_numparse=True, colalign=sides)


def rounded(number: float) -> str:
    """A number in three digits; thousands without an exponent."""
    return f"{float(f'{number:.3g}'):g}"


def duration(seconds: float) -> str:
    """A time in three digits, below a second in milliseconds."""
    return f"{rounded(seconds)} s" if seconds >= 1 else f"{rounded(1e3 * seconds)} ms"


def plain(part: Any) -> str:
    """The fields of a tuple or dataclass with their numbers; while JAX traces, with their types."""
    names = getattr(part, "_fields", None) or [x.name for x in dataclasses.fields(part) if x.repr]
    words = ", ".join(f"{name}={_value(getattr(part, name))}" for name in names)
    return f"{type(part).__name__}({words})"


def _value(value: Any) -> str:
    if isinstance(value, eqx.Module):
        return plain(value)
    if not isinstance(value, jax.Array | np.ndarray | np.generic):
        return repr(value)
    numbers = concrete(value)
    if numbers is None:
        return str(eqx.tree_pformat(value))
    if numbers.ndim == 0:
        return str(numbers)
    return np.array2string(numbers, separator=", ", threshold=_MOST, edgeitems=2)
