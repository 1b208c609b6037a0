"""The form of scene files, from the classes of parts: mistakes in one, and its JSON schema."""

import dataclasses
import difflib
import inspect
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..scene.body.base import AbstractBody
from ..scene.effect.base import AbstractEffect
from ..scene.joint.base import AbstractJoint
from .forms import (
    VECTOR,
    Choice,
    Form,
    Key,
    ListOf,
    MarkerForm,
    Numbers,
    PartOf,
    Plain,
    PointForm,
    RotationForm,
    Table,
    TableOf,
    form_of,
)
from .markers import TURNS
from .numbers import ROTATION_NUMBERS, is_turning, number_schema, wrong_numbers
from .parts import DEGREES, SPATIAL, TYPE, Maker, makers
from .problems import Place, Problems, shown, unknown
from .settings import Settings
from .versions import DIMENSIONS, FORMAT

SECTIONS: dict[str, type] = {
    "bodies": AbstractBody,
    "joints": AbstractJoint,
    "effects": AbstractEffect,
}
# The largest whole number: they count modes and the like, of which more do not fit into memory.
_LARGEST = 10_000
# Keys as alike as this differ by a typo, as "lenght" from "length"; "E" and "EI" are less.
_TYPO = 0.7
# What messages and editors call a value.
_KINDS = {
    str: ("a text in quotes", "string"),
    bool: ("true or false", "boolean"),
    int: ("a whole number", "integer"),
    float: ("a number", "number"),
}


def _angle(name: str = "angle", form: Form = Numbers()) -> dict[str, Key]:  # noqa: B008
    return {name: Key(form), name + DEGREES: Key(form)}


_TEXT, _POINT = Plain(str), Numbers((VECTOR,))
_TURNS = {key: Key(form) for key, form in TURNS.items()}
_MARKER = Table("marker", {"body": Key(_TEXT, True), "point": Key(PointForm())} | _angle() | _TURNS)
_PLACE = Table("place", {"point": Key(PointForm(), True), "at": Key(MarkerForm(), True)})
_AXIS = Table("axis-and-angle", {"axis": Key(Numbers((3,)), True)} | _angle())
_EULER = Table("Euler-angles", {"euler": Key(_TEXT, True)} | _angle("angles", Numbers((3,))))


def _setting(kind: Any) -> Form:
    """The form of a setting of a run, for which no parameter stands."""
    form = Plain(float) if kind is float else form_of(kind)
    assert form is not None
    return form


_DOCUMENT = Table(
    "scene",
    {
        "format": Key(Choice((FORMAT,)), True),
        "dimension": Key(Choice(DIMENSIONS)),
        "title": Key(_TEXT),
        "consistent": Key(Plain(bool)),
        "parameters": Key(TableOf(Numbers((None, None), loose=True))),
        "ground": Key(Table("ground", {"points": Key(TableOf(_POINT))})),
        **{name: Key(TableOf(PartOf(base))) for name, base in SECTIONS.items()},
        "run": Key(
            Table("run", {x.name: Key(_setting(x.type)) for x in dataclasses.fields(Settings)})
        ),
    },
)


def _readable(base: type) -> dict[str, Maker]:
    return {name: maker for name, maker in makers(base).items() if maker.readable}


def _part(maker: Maker, base: type) -> Table:
    """The table of a part."""
    keys = {TYPE: Key(Choice((maker.name,)), maker.name != base.__name__)}
    body = issubclass(maker.part, AbstractBody)
    for key, argument, _ in maker.entries():
        if key != "name":
            assert argument.form is not None
            keys[key] = Key(argument.form, argument.required and not argument.angle)
        elif not body:
            keys[key] = Key(_TEXT)
    if body and "position" in maker.arguments:
        keys["place"] = Key(_PLACE)
    words = (inspect.getdoc(maker.make) or "").split("\n\n")[0]
    return Table(_label(maker.name, base), keys, words)


def _label(name: str, base: type) -> str:
    """Name the table of a part: its type, unless a body, joint or effect has it too."""
    bases = SECTIONS.values()
    taken = base not in bases and any(name in makers(other) for other in bases)
    return f"{base.__name__.removeprefix('Abstract')}-{name}" if taken else name


# What is wrong.


def validate(tables: dict[str, Any], problems: Problems) -> None:
    """Add all that tables have wrong in themselves."""
    planar = _planar_bodies(tables)
    for place, words in _mistakes(_DOCUMENT, (), tables):
        name = str(place[1]) if place[:1] == ("bodies",) and len(place) > 1 else ""
        if name in planar:
            # Told once, instead of each key that a body of space has otherwise.
            if kind := planar[name]:
                words = f'It is a {kind} in the plane; in a scene with dimension = 3 write type = "'
                problems.add(("bodies", name), f'{words}{SPATIAL}{kind}".')
            planar[name] = ""
        else:
            problems.add(place, words)
        if problems.full:
            return


def _planar_bodies(tables: Mapping[str, Any]) -> dict[str, str]:
    """The types of the bodies in a file of three dimensions that are of the plane, by names."""
    bodies, known = tables.get("bodies"), _readable(AbstractBody)
    if tables.get("dimension") != 3 or not isinstance(bodies, dict):
        return {}
    return {
        name: kind
        for name, x in bodies.items()
        if isinstance(x, dict) and isinstance(kind := x.get(TYPE), str)
        if {kind, SPATIAL + kind} <= known.keys()
    }


def _mistakes(form: Form, place: Place, value: Any) -> Iterator[tuple[Place, str]]:
    """Each mistake in a value, with its place."""
    match form:
        case Numbers():
            yield from _said(place, wrong_numbers(form, value))
        case Plain(kind):
            yield from _said(place, _wrong_plain(kind, value))
        case Choice(values):
            if isinstance(value, bool) or value not in values:
                names = [repr(x) for x in values]
                wanted = " or ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
                yield place, f"It is {shown(value)}, but it must be {wanted}."
        case PointForm():
            if not isinstance(value, str):
                yield from _mistakes(_POINT, place, value)
        case MarkerForm():
            if isinstance(value, dict):
                yield from _mistakes(_MARKER, place, value)
            elif not isinstance(value, str):
                such = 'a marker, such as "crank.pin" or { body = "crank", point = [0.1, 0.0] },'
                yield place, _needed(value, such)
        case RotationForm():
            turned = is_turning(value) and (_EULER if "euler" in value else _AXIS)
            yield from _mistakes(turned or ROTATION_NUMBERS, place, value)
        case ListOf(item, single):
            several = isinstance(value, list)
            yield from _said(place, "" if several or single else _needed(value, "a list"))
            for i, x in enumerate(value if several else [value] * single):
                yield from _mistakes(item, (*place, i) if several else place, x)
        case TableOf(item):
            yield from _said(place, "" if isinstance(value, dict) else _needed(value, "a table"))
            for key, x in value.items() if isinstance(value, dict) else ():
                yield from _mistakes(item, (*place, key), x)
        case PartOf(base):
            yield from _wrong_part(base, place, value)
        case Table(_, keys):
            yield from _wrong_keys(keys, place, value)


def _said(place: Place, words: str) -> Iterator[tuple[Place, str]]:
    if words:
        yield place, words


def _needed(value: Any, wanted: str) -> str:
    return f"It is {shown(value)}, but {wanted} is needed."


def _wrong_plain(kind: type, value: Any) -> str:
    if kind is float and not isinstance(value, str):
        return wrong_numbers(Numbers(), value)
    if kind is int and type(value) is int and value > _LARGEST:
        return f"It is {shown(value)}, but it may be {_LARGEST} at most."
    return "" if type(value) is kind else _needed(value, _KINDS[kind][0])


def _wrong_part(base: type, place: Place, value: Any) -> Iterator[tuple[Place, str]]:
    known = _readable(base)
    if not isinstance(value, dict):
        yield place, f"It is {shown(value)}, but a table is needed, such as {{ type = … }}."
        return
    kind = value.get(TYPE, base.__name__)
    if isinstance(kind, str) and kind in known:
        keys = _part(known[kind], base).keys
        ways = _other_ways(kind, keys, known, base)
        hint = "".join(f' The type "{way}" has {", ".join(more)}.' for way, more in ways.items())
        for at, words in _wrong_keys(keys, place, value):
            # A key that it does not have may be meant for another way to make the part.
            key = str(at[len(place)])
            if key not in keys and not _is_typo(key, keys, ways):
                words, hint = words + hint, ""
            yield at, words
    elif TYPE in value:
        yield place, unknown("type", kind, list(known))
    else:
        yield place, f"The key `{TYPE}` is missing; one of {', '.join(known)}."


def _other_ways(
    kind: str, keys: Mapping[str, Key], known: Mapping[str, Maker], base: type
) -> dict[str, list[str]]:
    """The other ways to make a part, such as by a section, with the keys that only they have."""
    others = (x for x in known if x.startswith(f"{kind}."))
    found = {x: [key for key in _part(known[x], base).keys if key not in keys] for x in others}
    return {x: more for x, more in found.items() if more}


def _is_typo(key: str, keys: Mapping[str, Key], ways: Mapping[str, Sequence[str]]) -> bool:
    """Whether a key is nearly one of a part's own, and none of another way to make it."""
    if any(key in more for more in ways.values()):
        return False
    return bool(difflib.get_close_matches(key, keys, n=1, cutoff=_TYPO))


def _wrong_keys(keys: Mapping[str, Key], place: Place, table: Any) -> Iterator[tuple[Place, str]]:
    if not isinstance(table, dict):
        yield place, _needed(table, "a table")
        return
    for key, value in table.items():
        if key in keys:
            yield from _mistakes(keys[key].form, (*place, key), value)
        else:
            yield (*place, key), unknown("key", key, list(keys))
    for key, (_, required) in keys.items():
        if required and key not in table:
            yield (*place, key), f"The key `{key}` is missing; add it."


# For editors.


def json_schema() -> dict[str, Any]:
    """The JSON schema of scene files, for editors."""
    definitions: dict[str, dict[str, Any]] = {}
    _schema(_DOCUMENT, definitions)
    own = definitions.pop(_DOCUMENT.name)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **own, "$defs": definitions}


def _schema(form: Form, definitions: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The schema of a form; those of tables are put into the `definitions`, by their names."""
    match form:
        case Numbers():
            return number_schema(form)
        case Plain(kind):
            limit = {"maximum": _LARGEST} if kind is int else {}
            return {"type": _KINDS[kind][1], **limit}
        case Choice(values):
            return {"enum": list(values)}
        case PointForm():
            return {"anyOf": [_schema(_TEXT, definitions), number_schema(_POINT)]}
        case MarkerForm():
            return {"oneOf": [_schema(x, definitions) for x in (_TEXT, _MARKER)]}
        case RotationForm():
            return {"oneOf": [_schema(x, definitions) for x in (ROTATION_NUMBERS, _AXIS, _EULER)]}
        case ListOf(item, single):
            many = {"type": "array", "items": (one := _schema(item, definitions))}
            return {"oneOf": [one, many]} if single else many
        case TableOf(item):
            return {"type": "object", "additionalProperties": _schema(item, definitions)}
        case PartOf(base):
            tables = [_part(maker, base) for maker in _readable(base).values()]
            return {"oneOf": [_schema(table, definitions) for table in tables]}
        case Table(name, keys, words):
            if name not in definitions:
                own: dict[str, Any] = {"type": "object", "additionalProperties": False}
                definitions[name] = own | ({"description": words} if words else {})
                properties = {key: _schema(x.form, definitions) for key, x in keys.items()}
                required = [key for key, x in keys.items() if x.required]
                definitions[name] |= {"properties": properties, "required": required}
            return {"$ref": f"#/$defs/{name}"}
