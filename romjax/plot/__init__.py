"""Figures of motions, bases and mechanisms; the only importer of matplotlib.

A figure is imported when it is first asked for: `import romjax` loads no matplotlib.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .figures.accuracy import accuracy as accuracy
    from .figures.bode import bode as bode
    from .figures.configuration import configuration as configuration
    from .figures.errors import errors as errors
    from .figures.loads import loads as loads
    from .figures.modes import modes as modes
    from .figures.reduction import reduction as reduction
    from .figures.reductions import reductions as reductions
    from .figures.response import response as response
    from .figures.tuning import tuning as tuning
    from .figures.values import values as values

# Functions, and the modules of `figures` that define them.
_FIGURES = {
    "accuracy": "accuracy",
    "bode": "bode",
    "configuration": "configuration",
    "errors": "errors",
    "loads": "loads",
    "modes": "modes",
    "reduction": "reduction",
    "reductions": "reductions",
    "response": "response",
    "tuning": "tuning",
    "values": "values",
}


def __getattr__(name: str) -> Any:
    if name not in _FIGURES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    function = getattr(importlib.import_module(f".figures.{_FIGURES[name]}", __name__), name)
    globals()[name] = function  # the next access does not come here
    return function


def __dir__() -> list[str]:
    return sorted([*globals(), *_FIGURES])
