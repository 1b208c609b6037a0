"""The parts that files know: all that are defined, those of users too, by their types."""

import dataclasses
import functools
import inspect
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from .. import spatial
from ..common.fields import ANGLE, ROTATION, UNIT
from .forms import Form, RotationForm, form_of, refined

# What a table says of its kind, and of degrees.
TYPE, DEGREES = "type", "_deg"
# What the types of parts in space begin with.
SPATIAL = "spatial."
# The default of what has none.
EMPTY: Any = object()


@dataclasses.dataclass(frozen=True)
class Argument:
    """An argument of a constructor; `form` is None if no file can hold it."""

    name: str
    form: Form | None
    default: Any = EMPTY
    angle: bool = False
    optional: bool = False  # None stands for none, which no file can say
    unit: str = ""  # of a signal that is no angle

    @property
    def required(self) -> bool:
        return self.default is EMPTY and not self.optional


@dataclasses.dataclass(frozen=True)
class Maker:
    """A way to make a part: its constructor, or a class method of the name of_…"""

    part: type
    name: str
    make: Callable[..., Any]
    arguments: Mapping[str, Argument]

    @functools.cached_property
    def readable(self) -> bool:
        """Whether files can hold it."""
        return TYPE not in self.arguments and all(
            x.form is not None for x in self.arguments.values() if x.required
        )

    def entries(self) -> Iterator[tuple[str, Argument, bool]]:
        """The keys of its table, each with its argument and whether it is in degrees."""
        for name, argument in self.arguments.items():
            if argument.form is not None:
                yield name, argument, False
                if argument.angle:
                    yield name + DEGREES, argument, True


def turn_within(value: Any) -> tuple[str | int, ...]:
    """Return the keys to an offset in degrees of a signal, or of one that is a part of it."""
    entries = value.items() if isinstance(value, Mapping) else enumerate(value)
    for key, part in entries:
        if key == "offset" + DEGREES:
            return (key,)
        if isinstance(part, Mapping | list) and (inner := turn_within(part)):
            return (key, *inner)
    return ()


def makers(base: type) -> dict[str, Maker]:
    """All ways to make a `base`, by type: of a part defined twice, the later one.

    A user's part does not take the place of one of romjax: it is called "module.Name".
    """
    return _makers(tuple(_descendants(base)))


@functools.lru_cache
def _makers(parts: tuple[type, ...]) -> dict[str, Maker]:
    makers: dict[str, Maker] = {}
    # Parts of romjax come first, whose names are theirs.
    for part in sorted(parts, key=_own, reverse=True):
        if inspect.isabstract(part) or part.__name__.startswith(("_", "Abstract")):
            continue
        for maker in _makers_of(part):
            known, name = makers.get(maker.name), maker.name
            if known and _own(known.part) and not _own(part):
                name = f"{part.__module__}.{name}"
            makers[name] = dataclasses.replace(maker, name=name)
    return makers


def maker_of(part: Any, base: type) -> Maker | None:
    """The constructor of a part, by the type under which files have it; None if they have not."""
    for maker in makers(base).values():
        if maker.part is type(part) and maker.make is maker.part:
            return maker
    return None


def _own(part: type) -> bool:
    return part.__module__.split(".")[0] == __name__.split(".")[0]


def _descendants(base: type) -> Iterator[type]:
    """All classes that are defined: a base, and what derives from it."""
    yield base
    direct: list[type] = base.__subclasses__()
    for part in direct:
        yield from _descendants(part)


@functools.cache
def _makers_of(part: type) -> list[Maker]:
    """The constructor of a part, and its class methods of_…"""
    fields, constructor = _fields(part), inspect.getattr_static(part, "__init__")
    main = _arguments(constructor, fields)
    makers = [Maker(part, name, part, main) for name in _names(part)]
    for name, value in inspect.getmembers(part, inspect.ismethod):
        if name.startswith("of_") and value.__self__ is part:
            own = _arguments(value, fields)
            if _takes_more(value):
                own |= {key: x for key, x in main.items() if key not in own and not x.required}
            makers += [Maker(part, f"{kind}.{name}", value, own) for kind in _names(part)]
    return makers


def _names(part: type) -> tuple[str, ...]:
    """The types by which files know a part: what is for space alone has its prefix, and what
    `romjax.spatial` has too is read by both names.
    """
    name = part.__name__
    if f".{SPATIAL}" in part.__module__:
        return (SPATIAL + name,)
    return (name, SPATIAL + name) if getattr(spatial, name, None) is part else (name,)


def _fields(part: type) -> dict[str, Argument]:
    """Return the fields of a part with their forms."""
    hints, fields = _hints(part), {}
    for field in dataclasses.fields(part):
        hint = hints.get(field.name, field.type)
        optional, angle = type(None) in typing.get_args(hint), bool(field.metadata.get(ANGLE))
        form = RotationForm() if field.metadata.get(ROTATION) else form_of(hint)
        unit = field.metadata.get(UNIT, "")
        fields[field.name] = Argument(field.name, form, angle=angle, optional=optional, unit=unit)
    return fields


def _arguments(call: Any, fields: Mapping[str, Argument]) -> dict[str, Argument]:
    """Return the arguments of a function that makes a part with some fields."""
    hints, arguments = _hints(call), {}
    for name, parameter in inspect.signature(call).parameters.items():
        if name == "self" or parameter.kind is parameter.VAR_KEYWORD:
            continue
        field = fields.get(name, Argument(name, None))
        form = refined(form_of(hints.get(name, parameter.annotation)), field.form)
        default = EMPTY if parameter.default is parameter.empty else parameter.default
        arguments[name] = dataclasses.replace(field, form=form, default=default)
    return arguments


def _takes_more(call: Any) -> bool:
    kinds = [parameter.kind for parameter in inspect.signature(call).parameters.values()]
    return inspect.Parameter.VAR_KEYWORD in kinds


def _hints(thing: Any) -> dict[str, Any]:
    """Annotations, as they stand where some of their names cannot be resolved."""
    try:
        return typing.get_type_hints(thing)
    except Exception:  # a name that a user's module imports for type checkers only
        return {}
