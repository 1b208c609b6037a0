"""Pictures of runs and scenes, whose code is imported when somebody asks for one."""

from collections.abc import Callable
from typing import Any

from .errors import InputError
from .extras import lazy_import

_ANIMATE = "plot.motion.animate"


def animated(run: Any, *others: Any, **options: Any) -> Any:
    """The moving picture of a run, and of `others` over it."""
    return lazy_import(_ANIMATE, "animate_run")(run, *others, **options)


def still(scene: Any) -> Any:
    """The picture of a scene at its start."""
    return lazy_import(_ANIMATE, "animate")(scene)


def inline(make: Callable[[], Any]) -> str | None:
    """The picture that `make` makes, for notebooks; None where it cannot, and they show words."""
    try:
        picture: str = make().embedded()
    except InputError:
        return None
    return picture
