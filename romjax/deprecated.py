"""Names of the release before: they work until the next one, warn once, and name the new one."""

import functools
import importlib
import warnings
from typing import Any

# Public names that changed, and where the new ones are.
RENAMED: dict[str, tuple[str, str]] = {
    "verdict": (".basis.describe", "describe"),
}


@functools.cache
def warn_once(old: str, new: str) -> None:
    """Warn, the first time only, that `old` is called `new` now."""
    warnings.warn(
        f"romjax: {old} is called {new} now; the old name goes with the next release.",
        DeprecationWarning,
        stacklevel=4,
    )


def renamed(old: str, new: str) -> Any:
    """A property, or a method, under its old name `old` of the form "Class.name"."""
    attribute = new.rpartition(".")[2]

    def read(self: Any) -> Any:
        warn_once(old, new)
        return getattr(self, attribute)

    return property(read, doc=f"The old name of `{new}`.")


def __getattr__(name: str) -> Any:
    """What `romjax.NAME` finds for an old name."""
    if name not in RENAMED:
        raise AttributeError(f"module 'romjax' has no attribute '{name}'")
    module, new = RENAMED[name]
    warn_once(f"romjax.{name}", f"romjax.{new}")
    return getattr(importlib.import_module(module, "romjax"), new)
