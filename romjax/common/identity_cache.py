"""A cache of values for objects by identity, since equality would compare all their arrays."""

import weakref
from typing import Any


class IdentityCache:
    """A cache of one value for each object, as long as the object is alive."""

    def __init__(self) -> None:
        self._values: dict[int, tuple[weakref.ref[Any], Any]] = {}

    def get(self, owner: Any) -> Any:
        """The value of an object; None if it has none."""
        reference, value = self._values.get(id(owner), (None, None))
        return value if reference is not None and reference() is owner else None

    def put(self, owner: Any, value: Any) -> Any:
        """Remember a value, which must not hold the object; returns it."""
        key = id(owner)
        self._values[key] = weakref.ref(owner, lambda _: self._values.pop(key, None)), value
        return value
