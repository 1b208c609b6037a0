"""Vectors in the plane."""

from ..common.arrays import Numbers, namespace


def perpendicular(x: Numbers) -> Numbers:
    """Vectors (2, ...), a quarter turn on; by NumPy of arrays of that."""
    turned: Numbers = namespace(x).stack([-x[1], x[0]])
    return turned
