"""Numbers in a file: what they may look like, and the arrays that they stand for."""

import math
from typing import Any

from ..common.plain import is_number
from .forms import Numbers
from .problems import shown

# What begins the name of a parameter that stands for a number.
PARAMETER = "="
# A rotation that is no table is a quaternion or a matrix.
ROTATION_NUMBERS = Numbers(((3, 4), None), loose=True)
# Where arrays are that are too large for the file.
ARRAY_KEYS = ("file", "array")


def wrong_numbers(form: Numbers, value: Any) -> str:
    """Say in words what is wrong with a value that should be numbers; empty if it is right."""
    within = form.within(value)
    if within:
        return next(filter(None, (wrong_numbers(within, x) for x in value.values())), "")
    if isinstance(value, dict) and form.axes:
        return _wrong_array(value, form.worded)
    if isinstance(value, str) and value.startswith(PARAMETER) and len(value) > 1:
        return ""
    if isinstance(value, list) and form.axes:
        length, rest = form.axes[0], Numbers(form.axes[1:], form.loose)
        if length is not None and len(value) not in lengths(length):
            return f"It is a list of {len(value)}, but a list of {_size(length)} numbers is needed."
        return next(filter(None, (wrong_numbers(rest, item) for item in value)), "")
    if isinstance(value, int | float) and not isinstance(value, bool):
        return _wrong_number(form, value)
    wanted = "a number" if not form.axes else _lists(form)
    hint = ""
    if isinstance(value, str):
        hint = " Write it without quotes." if is_number(value) else ' A parameter is "=name".'
    return f"It is {shown(value)}, but {wanted} is needed.{hint}"


def _wrong_number(form: Numbers, value: int | float) -> str:
    if form.axes and not form.loose:
        return f"It is the number {value}, but {_lists(form)} is needed."
    try:
        finite = math.isfinite(value)
    except OverflowError:
        finite = False
    return "" if finite else f"It is {shown(value)}, but every number must be finite."


def _wrong_array(value: dict[str, Any], worded: bool) -> str:
    texts = all(isinstance(x, str) for x in value.values())
    if "file" in value and set(value) <= set(ARRAY_KEYS) and texts:
        return ""
    also = " Or a table of one word, which says of what kind they are." if worded else ""
    wanted = 'It is a table, but numbers are needed, or { file = "name.npz", array = "name" }.'
    return wanted + also


def _lists(form: Numbers) -> str:
    length = form.axes[0]
    if form.loose:
        return "a number, or a list of numbers"
    size = "a list of numbers" if length is None else f"a list of {_size(length)} numbers"
    return size if len(form.axes) == 1 else f"a list of lists of numbers, {len(form.axes)} deep"


def is_turning(value: Any) -> bool:
    """Whether a rotation is a table, of an axis and an angle or of Euler angles."""
    return isinstance(value, dict) and "file" not in value


def lengths(length: int | tuple[int, ...]) -> tuple[int, ...]:
    """The lengths that an axis may have."""
    return (length,) if isinstance(length, int) else length


def _size(length: int | tuple[int, ...]) -> str:
    return " or ".join(map(str, lengths(length)))


def number_schema(form: Numbers) -> dict[str, Any]:
    """The JSON schema of a form."""
    parameter = {"type": "string", "pattern": f"^{PARAMETER}.+"}
    number = {"anyOf": [{"type": "number"}, parameter]}
    if not form.axes:
        return number
    schema: dict[str, Any] = number
    for length in reversed(form.axes):
        some = () if length is None else lengths(length)
        sizes = {"minItems": min(some), "maxItems": max(some)} if some else {}
        options = [{"type": "array", "items": schema, **sizes}, parameter]
        schema = {"anyOf": [*options, *([{"type": "number"}] if form.loose else [])]}
    table = {
        "type": "object",
        "properties": {key: {"type": "string"} for key in ARRAY_KEYS},
        "required": ["file"],
        "additionalProperties": False,
    }
    options = [*schema["anyOf"], table]
    if form.worded:
        one = {"type": "object", "minProperties": 1, "maxProperties": 1}
        options.append(one | {"additionalProperties": {"anyOf": options[:]}})
    return {"anyOf": options}
