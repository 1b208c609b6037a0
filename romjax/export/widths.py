"""Whole numbers of as many bits as their type has."""

import math

import numpy as np

from .refuse import refuse
from .terms import WHOLE, literal

WIDE = "(unsigned long long)"
_NARROW = {8: "signed char", 16: "short", 32: "int"}


def is_whole(kind: str) -> bool:
    return kind in WHOLE


def filling(kind: str) -> int:
    """What JAX has in places outside of an array."""
    return int(np.iinfo(kind).max if kind.startswith("u") else np.iinfo(kind).min)


def wrapped(value: int, kind: str) -> int:
    """A known whole number that goes on from the other end of its range, as JAX has it."""
    if not is_whole(kind):
        return value
    least, most = int(np.iinfo(kind).min), int(np.iinfo(kind).max)
    return (int(value) - least) % (most - least + 1) + least


def wrapping(pattern: str, kind: str) -> str:
    """The expression of C for it. In C the sum of numbers with a sign may not leave their range."""
    if not is_whole(kind):
        return pattern
    return narrowed(WIDE + pattern, kind)


def narrowed(pattern: str, kind: str) -> str:
    """The last bits of a number, as many as its type has, as an expression of C."""
    bits = np.iinfo(kind).bits
    if kind.startswith("u"):
        if bits == 64:
            refuse("numbers of type uint64 that depend on the state", "take them as int64")
        return f"(long long)(({pattern}) & {2**bits - 1})"
    return f"(long long)({_NARROW[bits]})({pattern})" if bits < 64 else f"(long long)({pattern})"


def nearest(value: float, kind: str) -> int:
    """A known real number as a whole one: zero for NaN, and no further than its range."""
    limits = np.iinfo(kind)
    if math.isnan(value):
        return 0
    return int(min(max(value, int(limits.min)), int(limits.max)))


def to_nearest(kind: str) -> str:
    """The expression of C for it, which in C is undefined beyond the range."""
    least, most = int(np.iinfo(kind).min), int(np.iinfo(kind).max)
    if most > 2**63:
        refuse("real numbers as numbers of type uint64", "take them as int64")
    # The largest number with a sign of 64 bits is no double; the one above is.
    low = f"{{0}} <= {float(least)!r} ? {literal(least)}"
    return f"{{0}} != {{0}} ? 0 : {low} : {{0}} >= {float(most)!r} ? {most} : (long long){{0}}"
