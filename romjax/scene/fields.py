"""Fields of scene elements: how they are declared, and checks of what they hold."""

import dataclasses
import functools
from typing import Any, Literal

from ..common import checks
from ..common.errors import SceneError
from ..common.fields import UNIT, Converted, number, parts, radians

__all__ = [
    "UNIT",
    "Converted",
    "check_choice",
    "check_finite",
    "check_kind",
    "check_mass",
    "check_not_negative",
    "check_numbers",
    "check_positive",
    "check_shape",
    "number",
    "parts",
    "radians",
]

# The remedy for links whose mass is not known.
_MASSLESS = (
    "A link without mass is no body: weld it to a neighbour (put its markers there), use a joint "
    "that stands for it, such as Distance or Universal, or lump in it a small mass and a small "
    "inertia."
)

check_kind = functools.partial(checks.check_kind, error=SceneError)
check_choice = functools.partial(checks.check_choice, error=SceneError)
check_shape = functools.partial(checks.check_shape, error=SceneError)
check_finite = functools.partial(checks.check_finite, error=SceneError)
check_positive = functools.partial(checks.check_positive, error=SceneError)
check_not_negative = functools.partial(checks.check_not_negative, error=SceneError)


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


def check_mass(owner: str, body: Any) -> None:
    """Check the mass of a body, of which messages say what stands for a link without any."""
    check_numbers(owner, body, "mass", sign="positive", remedy=_MASSLESS)
