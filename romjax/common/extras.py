"""Imports at run time: packages that only an extra brings."""

import importlib
from types import ModuleType
from typing import Any


def extra(owner: str, module: str, name: str, instead: str = "") -> ModuleType:
    """The `module` of a package that the extra of some `name` adds.

    `owner`: what needs it, and `instead` what does not, for the message of the ImportError that is
    raised where it is missing.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        remedy = f"; {instead}" if instead else ""
        raise ImportError(
            f"{owner} needs {package}: pip install 'romjax[{name}]'{remedy}."
        ) from error


def data_frame(owner: str, rows: Any, instead: str) -> Any:
    """Return a data frame of pandas (extra `study`); `owner` and `instead` as in `extra`."""
    return extra(owner, "pandas", "study", instead).DataFrame(rows)
