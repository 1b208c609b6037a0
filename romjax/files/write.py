"""Writing of a scene to a file."""

import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
import tomlkit.items

from ..common import writing
from ..common.arrays import as_array, concrete
from ..common.errors import InputError, SceneError
from ..scene.body.base import AbstractBody
from ..scene.effect.base import AbstractEffect
from ..scene.joint.base import AbstractJoint
from ..scene.marker import GROUND, Marker
from ..scene.points import NamedPoints
from ..scene.scene import Scene
from .forms import Form, ListOf, MarkerForm, Numbers, PartOf, RotationForm, TableOf, is_body
from .markers import split_marker
from .parts import EMPTY, TYPE, Argument, maker_of
from .versions import FORMAT

# A table of more characters does not stand on one line.
_LINE = 80
# Larger arrays are kept in a file of NumPy beside the text.
_LARGEST = 1000


def save(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write a scene to a file; see `Scene.save`."""
    scene.check()
    target = Path(path)
    arrays: dict[str, np.ndarray] = {}
    text = text_of(scene, arrays)
    outdated = _beside(target)
    if arrays:
        # Named by its contents: whenever this ends, each text lies beside the arrays that it means.
        beside = target.with_name(f"{target.stem}-{_digest(arrays)}.npz")
        with writing.replacing(beside) as part:
            np.savez_compressed(part, **arrays)  # type: ignore[arg-type]
        text = text_of(scene, {}, beside.name)
        outdated.discard(beside)
    writing.write(target, text)
    for file in outdated:
        file.unlink(missing_ok=True)


def _beside(target: Path) -> set[Path]:
    """The arrays that only the text of this file asks for, if it was written by `save`."""
    name = re.compile(rf"{re.escape(target.stem)}-[0-9a-f]{{16}}\.npz")
    if not any(name.fullmatch(file.name) for file in target.parent.glob("*.npz")):
        return set()
    files = [file for file in target.parent.glob("*.toml") if file.is_file()]
    texts = {file: file.read_text("utf-8", errors="replace") for file in files}
    own = set(name.findall(texts.pop(target, "")))
    return {target.with_name(x) for x in own if not any(x in text for text in texts.values())}


def _digest(arrays: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name, array in arrays.items():
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def text_of(scene: Scene, arrays: dict[str, np.ndarray] | None = None, beside: str = "") -> str:
    """A scene as TOML, with every digit of its numbers.

    Large arrays go into `arrays`, if they are given, for a file that lies `beside` the text.
    """
    writer = _Writer({body.name: body for body in scene.bodies}, arrays, beside)
    document = tomlkit.document()
    document["format"], document["dimension"] = FORMAT, scene.dimension
    sections: list[tuple[str, type, Sequence[Any]]] = [
        ("bodies", AbstractBody, scene.bodies),
        ("joints", AbstractJoint, scene.joints),
        ("effects", AbstractEffect, scene.effects),
    ]
    for section, base, parts in sections:
        if parts:
            document[section] = _section(writer, base, parts)
    return tomlkit.dumps(document)


def _section(writer: "_Writer", base: type, parts: Sequence[Any]) -> tomlkit.items.Table:
    """A table for each part under its name; one of its kind where it has none of its own."""
    section, taken = tomlkit.table(is_super_table=True), {getattr(p, "name", "") for p in parts}
    for part in parts:
        name = getattr(part, "name", "") or type(part).__name__.lower()
        key, number = name, 2
        while key in section or (key in taken and key != getattr(part, "name", "")):
            key, number = f"{name}-{number}", number + 1
        table = writer.part(part, base)
        if hasattr(part, "name") and base is not AbstractBody and part.name != key:
            table = {TYPE: table[TYPE], "name": part.name} | table
        section[key] = _table(table)
    return section


def _table(values: Mapping[str, Any]) -> tomlkit.items.Table:
    """A table: the tables in it on one line each, unless they are long."""
    table, long = tomlkit.table(), {}
    for key, value in values.items():
        if isinstance(value, dict):
            short = _short(value)
            if len(short.as_string()) > _LINE:
                long[key] = _table(value)
                continue
            value = short
        elif isinstance(value, list):
            value = _list(value)
        table[key] = value
    for key, value in long.items():
        table[key] = value
    return table


def _short(values: Mapping[str, Any]) -> tomlkit.items.InlineTable:
    table = tomlkit.inline_table()
    for key, value in values.items():
        table[key] = _short(value) if isinstance(value, dict) else _item(value)
    return table


def _item(value: Any) -> Any:
    return _list(value) if isinstance(value, list) else value


def _list(values: Sequence[Any]) -> tomlkit.items.Array:
    array = tomlkit.array()
    for value in values:
        array.append(_short(value) if isinstance(value, dict) else _item(value))
    return array


class _Writer:
    """Writes the parts of a scene as tables, lists, texts and numbers of a file."""

    def __init__(
        self,
        bodies: Mapping[str, AbstractBody],
        arrays: dict[str, np.ndarray] | None,
        beside: str,
    ):
        self._bodies, self._arrays, self._beside = bodies, arrays, beside

    def part(self, part: Any, base: type) -> dict[str, Any]:
        """The table of a part: its arguments but those that are as they would be without."""
        maker = maker_of(part, base)
        kind = type(part).__name__
        if maker is None or not maker.readable:
            raise SceneError(
                f"save: a {kind} cannot be written to a file; a part of one's own can if its "
                "fields are numbers, texts, markers or other parts, and none is called `type`."
            )
        values: dict[str, Any] = {TYPE: maker.name}
        for name, argument in maker.arguments.items():
            if name == "name" and (base is AbstractBody or base is AbstractJoint):
                continue
            value = getattr(part, name)
            if value is None or _is_default(argument, value):
                continue
            if argument.form is None:
                raise SceneError(f"save: {kind}.{name} is {value!r}, which no file can hold.")
            values[name] = self._large(name, value) or self._value(argument.form, value)
        return values

    def _large(self, name: str, value: Any) -> dict[str, str] | None:
        """Store an array that is too large for the text, and return the table that refers to it."""
        if self._arrays is None or np.size(value) <= _LARGEST or isinstance(value, str | tuple):
            return None
        key = f"{name} {len(self._arrays) + 1}"
        self._arrays[key] = np.asarray(value)
        return {"file": self._beside, "array": key}

    def _value(self, form: Form, value: Any) -> Any:
        match form:
            case Numbers() | RotationForm():
                return _numbers(value)
            case MarkerForm():
                return self._marker(value)
            case ListOf(item):
                return [self._value(item, x) for x in value]
            case TableOf(item):
                named = value.mapping() if isinstance(value, NamedPoints) else value
                return {key: self._value(item, x) for key, x in named.items()}
            case PartOf(base):
                return self.part(value, AbstractBody if is_body(form) else base)
        return value

    def _marker(self, marker: Marker) -> Any:
        """Return the text for a marker, "body" or "body.point", or a table where no text fits."""
        named = self._bodies[marker.body].named_points() if marker.body != GROUND else {}
        points: dict[str, Any] = {"": (0.0,) * marker.dimension, **named}
        unturned = 0.0 if marker.dimension == 2 else (1.0, 0.0, 0.0, 0.0)
        names = [name for name, point in points.items() if _same(point, marker.point)]
        if _same(marker.turn, unturned):
            for name in names:
                text = f"{marker.body}.{name}" if name else marker.body
                if split_marker(text, self._bodies) == (marker.body, name):
                    return text
        table: dict[str, Any] = {"body": marker.body}
        if "" not in names:
            table["point"] = names[0] if names else _numbers(marker.point)
        if not _same(marker.turn, unturned):
            table["angle" if marker.dimension == 2 else "rotation"] = _numbers(marker.turn)
        return table


def _numbers(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {word: _numbers(x) for word, x in value.items()}
    number = concrete(value)
    if number is None:
        raise InputError("save: a scene that JAX traces has no numbers; save it outside.")
    return number.astype(float).tolist()


def _is_default(argument: Argument, value: Any) -> bool:
    if isinstance(value, NamedPoints):
        return not value.names
    if argument.default is EMPTY or argument.default is None:
        return False
    if isinstance(argument.form, Numbers):
        return _same(value, argument.default)
    return bool(value == argument.default)


def _same(a: Any, b: Any) -> bool:
    """Whether numbers are the same to the bit."""
    one, other = (np.asarray(concrete(as_array(x)), float) for x in (a, b))
    return one.shape == other.shape and one.tobytes() == other.tobytes()
