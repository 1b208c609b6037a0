"""Forms of arguments of parts in files, from their annotations: one source for schema,
reading and writing.
"""

import collections.abc
import dataclasses
import inspect
import types
import typing
from typing import Any, NamedTuple

import jax
import jaxtyping
import numpy as np

from ..scene.body.base import AbstractBody
from ..scene.marker import Marker
from ..scene.points import NamedPoints

# The length of a vector in the plane, or in space.
VECTOR = (2, 3)
# Axes of an array of any shape, as many as the largest of a part's fields has.
ANY_AXES = (None, None, None)


@dataclasses.dataclass(frozen=True)
class Numbers:
    """A number or nested lists of them: the lengths of the `axes`, None for any, or some of which
    each will do.

    `loose`: lists may be less deep, as where one number stands for all. `bare`: held as it is, not
    as an array. `worded`: or a table of one word, such as that of a kind, and numbers.
    """

    axes: tuple[int | tuple[int, ...] | None, ...] = ()
    loose: bool = False
    bare: bool = False
    worded: bool = False

    def within(self, value: Any) -> "Numbers | None":
        """Return the form under the word of a table; None for numbers and for arrays in files."""
        if not self.worded or not isinstance(value, dict) or "file" in value or len(value) != 1:
            return None
        return dataclasses.replace(self, worded=False)


@dataclasses.dataclass(frozen=True)
class Plain:
    """A string, an integer, a truth value or a number, which no parameter can stand for."""

    kind: type


@dataclasses.dataclass(frozen=True)
class Choice:
    """One of some strings or integers."""

    values: tuple[Any, ...]


@dataclasses.dataclass(frozen=True)
class PointForm:
    """A point: its name, or its coordinates."""


@dataclasses.dataclass(frozen=True)
class MarkerForm:
    """A marker: "body", "body.point" or a table."""


@dataclasses.dataclass(frozen=True)
class RotationForm:
    """A rotation in space: a quaternion, a matrix, or a table of an axis and an angle or of Euler
    angles.
    """


@dataclasses.dataclass(frozen=True)
class PartOf:
    """A table of another part: a subclass of `base`, or `base` itself."""

    base: type


@dataclasses.dataclass(frozen=True)
class ListOf:
    """A list; or of a `single` one an item, which stands for all."""

    item: "Form"
    single: bool = False


@dataclasses.dataclass(frozen=True)
class TableOf:
    """A table with names of one's own as keys."""

    item: "Form"


class Key(NamedTuple):
    """The form of the value under a key of a table."""

    form: "Form"
    required: bool = False


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of these `keys` and no others. `name`, `words`: for editors."""

    name: str
    keys: collections.abc.Mapping[str, Key]
    words: str = ""


Form = (
    Numbers
    | Plain
    | Choice
    | PointForm
    | MarkerForm
    | RotationForm
    | PartOf
    | ListOf
    | TableOf
    | Table
)
ANY = Numbers(ANY_AXES, loose=True)


def form_of(annotation: Any) -> Form | None:
    """The form of a type; None for one that has none, such as a function."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Literal:
        return Choice(arguments)
    if origin in (typing.Union, types.UnionType):
        return _of_union(arguments)
    if origin in (list, tuple, collections.abc.Sequence, collections.abc.Iterable):
        item = form_of(arguments[0]) if arguments else None
        return item and ListOf(item)
    if origin in (dict, collections.abc.Mapping):
        item = form_of(arguments[1])
        return item and TableOf(item)
    if annotation in (Any, jax.Array, np.ndarray):
        return ANY
    if annotation in (float, complex, np.number, np.bool):
        return Numbers(bare=True)
    if annotation in (str, bool, int):
        return Plain(annotation)
    if annotation is Marker:
        return MarkerForm()
    if annotation is NamedPoints:
        return TableOf(Numbers((VECTOR,)))
    if inspect.isclass(annotation) and issubclass(annotation, jaxtyping.AbstractArray):
        axes = annotation.dim_str.split()
        if axes and axes[0][0] in "*.":
            return ANY
        return Numbers(tuple(_length(axis) for axis in axes), loose="*" in annotation.dim_str)
    if dataclasses.is_dataclass(annotation):
        return PartOf(typing.cast(type, annotation))
    return None


def _of_union(arguments: tuple[Any, ...]) -> Form | None:
    """Return the form of a union without None; several kinds of numbers make any numbers."""
    some = [argument for argument in arguments if argument is not type(None)]
    if len(some) == 1:
        return form_of(some[0])
    forms = [form_of(argument) for argument in some]
    if TableOf(ANY) in forms:
        numeric = all(_numeric(form) for form in forms if form != TableOf(ANY))
        return dataclasses.replace(ANY, worded=True) if numeric else None
    return ANY if all(_numeric(form) for form in forms) else None


def _numeric(form: Form | None) -> bool:
    if isinstance(form, ListOf):
        return _numeric(form.item)
    return isinstance(form, Numbers) or form in (Plain(int), Plain(bool))


def _length(axis: str) -> int | tuple[int, ...] | None:
    if axis == "d":  # of the dimension of the scene
        return VECTOR
    return int(axis) if axis.isdigit() else None


def refined(given: Form | None, field: Form | None) -> Form | None:
    """The form of a constructor's argument by that of its field, where it says no more than that it
    takes anything, or any numbers; where the field's axes have any length, one number is taken too.
    """
    if field is None or given not in (None, ANY):
        return given
    if isinstance(field, Numbers) and field.axes and not any(field.axes):
        return dataclasses.replace(field, loose=True)
    if field == ListOf(Plain(int)) and given == ANY:
        return dataclasses.replace(field, single=True)
    return field


def is_body(form: Form) -> bool:
    """Whether it is the table of a body, whose name is that of the body around it."""
    return isinstance(form, PartOf) and issubclass(form.base, AbstractBody)
