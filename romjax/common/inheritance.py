"""Methods and properties that a class takes over from those that it inherits from."""

from typing import Any


def goes_with(part: Any, name: str, other: str) -> bool:
    """Whether the class that says `name` of a part knew the `other` that the part has.

    A subclass that says `other` alone has not inherited what follows from the one before.
    """

    def owner(name: str) -> type:
        return next(kind for kind in type(part).__mro__ if name in vars(kind))

    return issubclass(owner(name), owner(other))
