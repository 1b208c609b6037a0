"""Pictures of runs and scenes: a generic function, which the folder of pictures defines."""

import functools
from collections.abc import Callable
from typing import Any

from .errors import InputError


@functools.singledispatch
def picture_of(shown: Any, *others: Any, **options: Any) -> Any:
    """The picture of a scene at its start, or the moving one of a run, and of `others` over it."""
    raise TypeError(f"No picture shows a {type(shown).__name__}, {others}, {options}.")


def inline(make: Callable[[], Any]) -> str | None:
    """The picture that `make` makes, for notebooks; None where it cannot, and they show words."""
    try:
        picture: str = make().embedded()
    except InputError:
        return None
    return picture
