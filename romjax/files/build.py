"""Construction of a scene from the tables of a file."""

import contextlib
import math
from collections.abc import Iterator, Mapping
from typing import Any, NoReturn

import numpy as np

from ..common.arrays import as_array
from ..common.compat import is_traced
from ..common.errors import InputError
from ..scene.body.base import AbstractBody
from ..scene.effect.base import AbstractEffect
from ..scene.joint.base import AbstractJoint
from ..scene.marker import GROUND, Ground, Marker
from ..scene.orientation import euler, rotation
from ..scene.scene import Scene, markers_of
from .arrays import read_array
from .forms import VECTOR, Form, ListOf, MarkerForm, Numbers, PartOf, RotationForm, TableOf, is_body
from .markers import TURNS, split_marker
from .numbers import PARAMETER, ROTATION_NUMBERS, is_turning
from .parameters import is_reference, no_parameter
from .parts import DEGREES, EMPTY, TYPE, Maker, makers, turn_within
from .problems import Place, Problems, owner_of, unknown

_DEGREE = math.pi / 180


class _FailedError(Exception):
    """A part that cannot be made; the mistake is noted already."""


class Builder:
    """Makes the parts of a file, and notes what keeps it from that.

    Nothing is made of a part whose table has a mistake, and nothing is said of what depends on it.
    """

    def __init__(self, tables: Mapping[str, Any], values: Mapping[str, Any], problems: Problems):
        self.tables, self.values, self.problems = tables, values, problems
        self._bodies: dict[str, AbstractBody | None] = {}
        self._waiting: list[str] = []
        self.ground = self._ground()

    def scene(self) -> Scene:
        """The scene; an empty one if anything is wrong."""
        names = self._names("bodies")
        bodies = [self.body(name) for name in names if not self.problems.full]
        dimensions = {body.dimension for body in bodies if body}
        if dimensions and self.tables.get("dimension", 2) not in dimensions:
            words = f"The bodies have {min(dimensions)}; write dimension = {min(dimensions)}."
            self.problems.add(("dimension",), words)
            return Scene([])
        joints = list(self._parts("joints", AbstractJoint))
        effects = list(self._parts("effects", AbstractEffect))
        if self.problems.mistakes:
            return Scene([])
        scene = Scene([body for body in bodies if body], joints, effects)
        try:
            scene.check()
        except ValueError as error:
            self.problems.add((), str(error))
        return scene

    def _names(self, section: str) -> list[str]:
        table = self.tables.get(section, {})
        return list(table) if isinstance(table, dict) else []

    def _ground(self) -> Ground | None:
        """Return the ground with its points, or None if they have mistakes."""
        if self.problems.touch(("ground",)):
            return None
        points = self.tables.get("ground", {}).get("points", {})
        try:
            return Ground(self._table(("ground", "points"), TableOf(Numbers((VECTOR,))), points))
        except _FailedError:
            return None

    def _parts(self, section: str, base: type) -> Iterator[Any]:
        for name in self._names(section):
            place = (section, name)
            if self.problems.full:
                return
            if self.problems.touch(place):
                continue
            table = {"name": name} | self.tables[section][name]
            try:
                part = self._part(place, base, table)
                for marker, turning in markers_of(part):
                    self._check_marker(place, marker, turning)
            except _FailedError:
                continue
            yield part

    def _check_marker(self, place: Place, marker: Marker, turning: bool) -> None:
        """Report a marker at a point that its body does not know."""
        body = self._bodies.get(marker.body)
        if body is not None:
            self._try(place, {}, lambda: body.check_marker("It", marker, turning))

    # Bodies.

    def body(self, name: str) -> AbstractBody | None:
        """A body, made where it is asked for first; None if it has a mistake."""
        if name not in self._bodies:
            self._bodies[name] = None
            if not self.problems.touch(("bodies", name)):
                self._waiting.append(name)
                with contextlib.suppress(_FailedError):
                    self._bodies[name] = self._make_body(name)
                self._waiting.pop()
        return self._bodies[name]

    def _make_body(self, name: str) -> AbstractBody:
        place = ("bodies", name)
        table = dict(self.tables["bodies"][name])
        brought = table.pop("place", None)
        if brought is not None and "position" in table:
            self._fail((*place, "position"), "The body has a `place` too; give one of both.")
        body: AbstractBody = self._part(place, AbstractBody, {"name": name} | table)
        # A body of another dimension than the file's stays as it is here, since `scene` refuses it.
        if brought is None or body.dimension != self.tables.get("dimension", 2):
            return body
        to = self._pose((*place, "place", "at"), brought["at"])
        point = self._point((*place, "place", "point"), body, brought["point"])
        placed: AbstractBody = self._try(place, table, lambda: body.placed(point, to))
        return placed

    def _pose(self, place: Place, text: Any) -> Any:
        """Return the pose of a marker at the start."""
        owner, point, _ = self._marker_parts(place, text)
        return self._try(place, {}, lambda: owner.pose(point))

    def _owner(self, place: Place, name: str) -> Any:
        """A body or the ground, by its name."""
        if name == GROUND:
            owner: Any = self.ground
        elif name not in self._names("bodies"):
            self._fail(place, unknown("body", name, [*self._names("bodies"), GROUND]))
        elif name in self._waiting:
            circle = [*self._waiting[self._waiting.index(name) :], name]
            self._fail(place, f"Bodies are placed by each other: {', '.join(circle)}.")
        else:
            owner = self.body(name)
        if owner is None:
            raise _FailedError
        return owner

    # Markers.

    def _marker(self, place: Place, value: Any) -> Marker:
        owner, point, turn = self._marker_parts(place, value)
        marker: Marker = self._try(place, {}, lambda: owner.at(point, **turn))
        return marker

    def _marker_parts(self, place: Place, value: Any) -> tuple[Any, Any, dict[str, Any]]:
        """Body and point of a marker, and how it is turned, as `AbstractBody.at` has it."""
        if isinstance(value, str):
            name, point = split_marker(value, self._names("bodies"))
            owner = self._owner(place, name)
            return owner, self._point(place, owner, point or self._origin()), {}
        owner = self._owner((*place, "body"), value["body"])
        point = self._point((*place, "point"), owner, value.get("point", self._origin()))
        given = [key for key in TURNS if key in value]
        turn = {key: self._value((*place, key), TURNS[key], value[key], {}) for key in given}
        return owner, point, turn | {"angle": self._angle(place, value, "angle", 0.0)}

    def _origin(self) -> list[float]:
        """The origin of the ground, and of every body."""
        return [0.0] * self.tables.get("dimension", 2)

    def _point(self, place: Place, owner: Any, value: Any) -> Any:
        if not isinstance(value, str) or is_reference(value):
            return self._numbers(place, Numbers((VECTOR,)), value)
        known = owner.named_points()
        if value not in known:
            self._fail(place, unknown("point", value, list(known)))
        return known[value]

    def _rotation(self, place: Place, value: Any) -> Any:
        if not is_turning(value):
            return self._numbers(place, ROTATION_NUMBERS, value)
        name = "angles" if "euler" in value else "angle"
        angle = self._angle(place, value, name, None)
        if angle is None:
            self._fail(place, f"The key `{name}` is missing; add it, or `{name}{DEGREES}`.")
        if "euler" in value:
            return self._try(place, value, lambda: euler(value["euler"], angle))
        axis = self._numbers((*place, "axis"), Numbers((3,)), value["axis"])
        return self._try(place, value, lambda: rotation(axis, angle))

    # Parts and what they hold.

    def _part(self, place: Place, base: type, table: Mapping[str, Any]) -> Any:
        maker = makers(base)[table.get(TYPE, base.__name__)]
        given = self._given(place, maker, table)
        return self._try(place, table, lambda: maker.make(**given))

    def _given(self, place: Place, maker: Maker, table: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments for the constructor of a part."""
        given: dict[str, Any] = {}
        failed = False
        for name, argument in maker.arguments.items():
            try:
                if argument.angle:
                    value = self._angle(place, table, name, argument.default)
                    if value is argument.default:
                        continue
                elif name in table and argument.form is not None:
                    if argument.unit and (turn := turn_within(table[name])):
                        words = f"The {name} is in {argument.unit}, not an angle; give `offset`."
                        self._fail((*place, name, *turn), words)
                    value = self._value((*place, name), argument.form, table[name], table)
                elif argument.optional and argument.default is EMPTY:
                    value = None
                else:
                    continue
                given[name] = value
            except _FailedError:
                failed = True
        if failed:
            raise _FailedError
        return given

    def _value(self, place: Place, form: Form, value: Any, around: Mapping[str, Any]) -> Any:
        match form:
            case Numbers():
                return self._numbers(place, form, value)
            case MarkerForm():
                return self._marker(place, value)
            case RotationForm():
                return self._rotation(place, value)
            case TableOf():
                return self._table(place, form, value)
            case ListOf(item) if isinstance(value, list):
                return tuple(self._value((*place, i), item, x, {}) for i, x in enumerate(value))
            case PartOf(base):
                named = {"name": around.get("name", "")} if is_body(form) else {}
                return self._part(place, base, named | value)
        return value

    def _table(self, place: Place, form: TableOf, value: Mapping[str, Any]) -> dict[str, Any]:
        return {key: self._value((*place, key), form.item, x, {}) for key, x in value.items()}

    def _angle(self, place: Place, table: Mapping[str, Any], name: str, default: Any) -> Any:
        """An angle, of radians or of degrees."""
        in_degrees = name + DEGREES
        if name in table and in_degrees in table:
            self._fail((*place, in_degrees), f"There is `{name}` too; give one of both.")
        if in_degrees in table:
            value = self._numbers((*place, in_degrees), Numbers(), table[in_degrees])
            return as_array((value if is_traced(value) else np.asarray(value)) * _DEGREE)
        if name in table:
            return self._numbers((*place, name), Numbers(), table[name])
        return default

    def _numbers(self, place: Place, form: Numbers, value: Any) -> Any:
        if within := form.within(value):
            return {word: self._numbers((*place, word), within, x) for word, x in value.items()}
        if isinstance(value, dict):
            return self._try(place, {}, lambda: read_array(self.problems.path.parent, value))
        resolved = self._resolve(place, value)
        if form.bare and isinstance(resolved, int | float):
            return float(resolved)
        try:
            return as_array(resolved)
        except (TypeError, ValueError):
            self._fail(place, "Its lists, or the parameters in them, have different lengths.")

    def _resolve(self, place: Place, value: Any) -> Any:
        """A number, or nested lists of them, with the values of parameters."""
        if isinstance(value, list):
            return [self._resolve(place, item) for item in value]
        if not is_reference(value):
            return value
        name = value[len(PARAMETER) :]
        if name not in self.tables.get("parameters", {}):
            self._fail(place, no_parameter(name, self.tables.get("parameters", {})))
        if name not in self.values:
            raise _FailedError
        return self.values[name]

    # Mistakes.

    def _fail(self, place: Place, words: str) -> NoReturn:
        self.problems.add(place, words)
        raise _FailedError

    def _try(self, place: Place, table: Mapping[str, Any], make: Any) -> Any:
        """Return what `make` does; an error that it raises is noted, with the key that it names."""
        try:
            return make()
        except (ValueError, TypeError, OSError) as error:
            words = str(error).split("\n")[0].removeprefix(owner_of(place)) or type(error).__name__
            field = error.field if isinstance(error, InputError) else ""
            keys = [field] if field in table else []
            self.problems.add((*place, *keys), words[:1].upper() + words[1:])
            raise _FailedError from error
