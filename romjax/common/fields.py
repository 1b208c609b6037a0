"""Fields that hold arrays: numbers are arrays, so that a new number never recompiles.

`Converted` and the field functions tell type checkers what a constructor takes and what its field
holds. Neither follows from the converter of a field of equinox: mypy takes the type of the field
for that of the argument, pyright that of the converter's argument, which is Any.
"""

from typing import TYPE_CHECKING, Any, Generic

import equinox as eqx
from jaxtyping import Array

from .arrays import Number, as_array
from .errors import SceneError

__all__ = [
    "ANGLE",
    "ROTATION",
    "UNIT",
    "AbstractClassVar",
    "Converted",
    "number",
    "parts",
    "radians",
]

# What marks a field as an angle, as a rotation in space, or as a signal in a unit that is no angle.
ANGLE, ROTATION, UNIT = "angle", "rotation", "unit"

if TYPE_CHECKING:
    # A class variable that subclasses have to set, which checkers take for a plain one.
    from typing import ClassVar as AbstractClassVar

    # Checkers know a field, and whether it has a default, by the function that declares it, here
    # that of equinox by other names. They do not see its converter: the annotation decides.
    from equinox import field as number
    from equinox import field as parts
    from equinox import field as radians
    from typing_extensions import TypeVar

    Kept = TypeVar("Kept")
    Given = TypeVar("Given", default=Number)

    class Converted(Generic[Kept, Given]):
        """The type of a field that holds the first type and takes the second, by default numbers.

        To checkers it is a descriptor, whose `__set__` gives the type of the argument of a
        constructor (https://typing.python.org/en/latest/spec/dataclasses.html).
        """

        def __get__(self, instance: object, owner: type) -> Kept: ...
        def __set__(self, instance: object, value: Kept | Given) -> None: ...

else:
    from equinox import AbstractClassVar

    class Converted:
        """`Converted[held, given]` is `held`: the annotation that is checked at run time."""

        def __class_getitem__(cls, types: Any) -> Any:
            return types[0] if isinstance(types, tuple) else types

    def number(**kwargs: Any) -> Any:
        """A field holding a floating-point array (or None, where the element allows it)."""
        return eqx.field(converter=_as_number, **kwargs)

    def radians(**kwargs: Any) -> Any:
        """A field as `number`, of angles: files take degrees, too, under its name and `_deg`."""
        return eqx.field(converter=_as_number, metadata={ANGLE: True}, **kwargs)

    def parts(**kwargs: Any) -> Any:
        """A field holding a tuple of elements, of any sequence of them."""
        return eqx.field(converter=_as_tuple, **kwargs)


def _as_tuple(value: Any) -> tuple[Any, ...]:
    if isinstance(value, eqx.Module):
        raise SceneError(
            f"a list of parts is needed in place of one {type(value).__name__}; put it in "
            "brackets, as in [part]."
        )
    return tuple(value)


def _as_number(value: Any) -> Array | None:
    return None if value is None else as_array(value)
