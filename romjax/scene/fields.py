"""Fields of scene elements: numbers are arrays, so that a new number never recompiles.

`Converted` and the field functions tell type checkers what a constructor takes and what its field
holds. Neither follows from the converter of a field of equinox: mypy takes the type of the field
for that of the argument, pyright that of the converter's argument, which is Any.
"""

import dataclasses
import functools
from typing import TYPE_CHECKING, Any, Generic, Literal

import equinox as eqx
from jaxtyping import Array

from .. import checks
from ..arrays import Number, as_array
from ..errors import SceneError

__all__ = [
    "Converted",
    "check_finite",
    "check_not_negative",
    "check_numbers",
    "check_positive",
    "check_shape",
    "number",
    "parts",
]

check_shape = functools.partial(checks.check_shape, error=SceneError)
check_finite = functools.partial(checks.check_finite, error=SceneError)
check_positive = functools.partial(checks.check_positive, error=SceneError)
check_not_negative = functools.partial(checks.check_not_negative, error=SceneError)


if TYPE_CHECKING:
    # Checkers know a field, and whether it has a default, by the function that declares it, here
    # that of equinox by other names. They do not see its converter: the annotation decides.
    from equinox import field as number
    from equinox import field as parts
    from typing_extensions import TypeVar

    Held = TypeVar("Held")
    Given = TypeVar("Given", default=Number)

    class Converted(Generic[Held, Given]):
        """Of a field that holds the first type and takes the second too, a number unless told.

        To checkers it is a descriptor, whose `__set__` gives the type of the argument of a
        constructor (https://typing.python.org/en/latest/spec/dataclasses.html).
        """

        def __get__(self, instance: object, owner: type) -> Held: ...
        def __set__(self, instance: object, value: Held | Given) -> None: ...

else:

    class Converted:
        """`Converted[held, given]` is `held`: the annotation that is checked at run time."""

        def __class_getitem__(cls, types: Any) -> Any:
            return types[0] if isinstance(types, tuple) else types

    def number(**kwargs: Any) -> Any:
        """A field holding a floating-point array (or None, where the element allows it)."""
        return eqx.field(converter=_as_number, **kwargs)

    def parts(**kwargs: Any) -> Any:
        """A field holding a tuple of elements, of any sequence of them."""
        return eqx.field(converter=tuple, **kwargs)


def _as_number(value: Any) -> Array | None:
    return None if value is None else as_array(value)


def check_numbers(
    owner: str,
    part: Any,
    *fields: str,
    shape: tuple[int | None, ...] = (),
    sign: Literal["any", "not negative", "positive"] = "any",
    prefix: str = "",
    remedy: str = "",
) -> None:
    """Check shape, finiteness and sign of the fields of `part`; None only where it is the default.

    `prefix` goes before their names in messages, `remedy` after what is said of a sign.
    """
    optional = {field.name for field in dataclasses.fields(part) if field.default is None}
    for field in fields:
        value = getattr(part, field)
        if value is None and field in optional:
            continue
        if value is None:
            raise SceneError(f"{owner}: {prefix}{field} is None; give a number.")
        check_shape(owner, prefix + field, value, shape)
        check_finite(owner, prefix + field, value)
        if sign == "not negative":
            check_not_negative(owner, prefix + field, value)
        elif sign == "positive":
            check_positive(owner, prefix + field, value, remedy)
