"""Names of decompositions, for those who write words instead of objects."""

from collections.abc import Callable

from ...common.errors import InputError
from ..basis import AbstractDecomposition
from .pod import POD
from .sod import SOD

_NAMED: dict[str, Callable[[], AbstractDecomposition]] = {"POD": POD, "SOD": SOD}


def as_decomposition(decomposition: AbstractDecomposition | str) -> AbstractDecomposition:
    """The decomposition of that name, with its defaults; an object is returned as it is.

    Raises InputError for an unknown name.
    """
    if isinstance(decomposition, AbstractDecomposition):
        return decomposition
    if decomposition not in _NAMED:
        raise InputError(f"{decomposition!r} is none of {', '.join(_NAMED)}.")
    return _NAMED[decomposition]()
