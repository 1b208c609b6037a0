"""Emitted functions as functions of Python."""

import ctypes
from collections.abc import Sequence

import numpy as np

from romjax.export.emit import Emitted
from romjax.export.library import load

DOUBLES = ctypes.POINTER(ctypes.c_double)
QUICK = ("-O0", "-std=c99", "-fPIC", "-Wall", "-Wextra", "-Wno-unused", "-Werror")


def library(functions: Sequence[Emitted], flags=QUICK) -> ctypes.CDLL:
    """All functions in one library."""
    return load("#include <math.h>\n" + "\n".join(f.source for f in functions), flags)


def called(code: ctypes.CDLL, function: Emitted, *args) -> dict[str, np.ndarray]:
    """The results of a function of a library, by their names."""
    given = [np.array(x, float, order="C") for x in args]
    results = {key: np.full(shape, np.nan) for key, shape in function.results.items()}
    kinds = [DOUBLES if shape else ctypes.c_double for shape in function.arguments.values()]
    entry = getattr(code, function.name)
    entry.argtypes, entry.restype = [*kinds, *(DOUBLES for _ in results)], None
    passed = [x.ctypes.data_as(DOUBLES) if x.ndim else float(x) for x in given]
    entry(*passed, *(x.ctypes.data_as(DOUBLES) for x in results.values()))
    return results
