"""Packages that come with an extra only, and methods whose code is in a room above their class."""

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


def frame(owner: str, rows: Any, instead: str) -> Any:
    """A data frame of pandas (extra `study`); `owner` and `instead` are as `extra` has them."""
    return extra(owner, "pandas", "study", instead).DataFrame(rows)


def above(module: str, function: str) -> Any:
    """A function of a room that its caller must not import, loaded when it is called.

    Imports point one way, but a run has a method `save` all the same.
    """
    return getattr(importlib.import_module(f"romjax.{module}"), function)
