"""Names of the release before: they work until the next one, warn once, and name the new one."""

import dataclasses
import functools
import importlib
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")

# Public names that changed, and where the new ones are.
RENAMED: dict[str, tuple[str, str]] = {
    "Doubt": (".system.flags", "Flag"),
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


def renamed_keywords(**names: str) -> Callable[[type[T]], type[T]]:
    """Let a constructor take arguments by their old names, too; `names` gives the new ones."""

    def decorate(cls: type[T]) -> type[T]:
        init = cls.__init__

        @functools.wraps(init)
        def accept(self: T, *args: Any, **kwargs: Any) -> None:
            for old in names.keys() & kwargs.keys():
                warn_once(f"{cls.__name__}({old}=...)", f"{cls.__name__}({names[old]}=...)")
                kwargs[names[old]] = kwargs.pop(old)
            init(self, *args, **kwargs)

        type.__setattr__(cls, "__init__", accept)
        return cls

    return decorate


def adopt(cls: type, **names: str) -> None:
    """Let what a subclass overrides by old names count as the new ones, which `names` gives.

    Else a part of a user's own would be taken for one that does not have them, in silence.
    """
    for old in names.keys() & vars(cls).keys():
        warn_once(f"{cls.__name__}.{old}", f"{cls.__name__}.{names[old]}")
        type.__setattr__(cls, names[old], vars(cls)[old])


def __getattr__(name: str) -> Any:
    """What the package has by an old name."""
    if name not in RENAMED:
        raise AttributeError(f"module 'romjax' has no attribute '{name}'")
    module, new = RENAMED[name]
    warn_once(f"romjax.{name}", f"romjax.{new}")
    return getattr(importlib.import_module(module, "romjax"), new)


def write_gif(scene: Any, trajectories: Any, path: Any, fps: Any = 25, seconds: Any = None) -> Any:
    """What `romjax.plot.animate` did with trajectories by name."""
    warn_once("romjax.plot.animate", "romjax.animate(scene, …).save(path)")
    animate = importlib.import_module(".plot.motion.animate", "romjax").animate
    moving = animate(scene, *trajectories.values(), labels=list(trajectories))
    return moving.save(path, fps=fps, seconds=seconds)


# What were methods of a system, and the functions in `system.dynamics` that took their place.
_METHODS = {
    "momentum": "apply_mass",
    "jacobian": "jacobian",
    "constraint_state": "constraint_state",
    "gamma": "gamma",
    "linearize": "linearize",
    "kinetic_energy": "kinetic_energy",
}
# Attributes of reduced systems that have another name now.
_ATTRIBUTES = {
    "physical": "reconstruct",
    "reduced": "restrict",
    "training": "validity",
    "reason": "summary",
}
# What was an attribute of reduced systems, and belongs to their lifts now.
_OF_LIFTS = ("chart", "modes", "offset")


def method_of_system(system: Any, name: str) -> Any:
    """What an attribute of a system is by its old name."""
    if name in _METHODS:
        dynamics = importlib.import_module(".system.dynamics", "romjax")
        new = _METHODS[name]
        warn_once(f"system.{name}(…)", f"romjax.system.dynamics.{new}(system, …)")
        return functools.partial(getattr(dynamics, new), system)
    new = _ATTRIBUTES.get(name, "")
    if hasattr(type(system), new) or new in getattr(system, "__dataclass_fields__", ()):
        warn_once(f"system.{name}", f"system.{new}")
        return getattr(system, new)
    if name in _OF_LIFTS and hasattr(getattr(system, "lift", None), name):
        warn_once(f"system.{name}", f"system.lift.{name}")
        return getattr(system.lift, name)
    if name == "coordinate_labels":
        warn_once("system.coordinate_labels()", "system.structure.labels")
        return lambda: system.full.structure.labels
    raise AttributeError(f"'{type(system).__name__}' has no attribute '{name}'")


# What were keyword arguments of `reduce`, and the formulation that has them.
_DECISIONS = {"constraints": "Galerkin", "chart": "Minimal"}


def decided(formulation: T, old: dict[str, Any]) -> T:
    """The formulation with what was a keyword argument of `reduce`: `constraints`, `chart`."""
    fields = getattr(formulation, "__dataclass_fields__", {})
    for name, value in old.items():
        if name not in _DECISIONS:
            raise TypeError(f"reduce() got an unexpected keyword argument '{name}'")
        warn_once(f"reduce({name}=…)", f"{_DECISIONS[name]}({name}=…)")
        if name in fields:
            formulation = dataclasses.replace(formulation, **{name: value})  # type: ignore[type-var]
    return formulation
