"""The pydantic models of scene files, generated from the parts. The only importer of pydantic."""

import dataclasses
import functools
import inspect
import typing
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    ValidationError,
    WithJsonSchema,
    create_model,
)
from pydantic_core import PydanticCustomError

from ..scene.body.base import AbstractBody
from ..scene.effect.base import AbstractEffect
from ..scene.joint.base import AbstractJoint
from .forms import VECTOR, Form, ListOf, MarkerForm, Numbers, PartOf, Plain, RotationForm, TableOf
from .markers import TURNS
from .numbers import ROTATION_NUMBERS, is_turning, number_schema, wrong_numbers
from .parts import DEGREES, TYPE, Argument, Maker, classes, makers
from .problems import Place, Problems, shown, unknown
from .settings import Settings
from .versions import DIMENSIONS, FORMAT

SECTIONS: dict[str, type] = {
    "bodies": AbstractBody,
    "joints": AbstractJoint,
    "effects": AbstractEffect,
}
# Of whole numbers, which count modes and the like: more would not fit into memory.
_LARGEST = 10_000
_STRICT = ConfigDict(extra="forbid", strict=True)
_NUMBER, _POINT = Numbers(), Numbers((VECTOR,))
# Models of rotations; no key has the name of one.
_AXIS, _EULER = "axis and angle", "Euler angles"


class Schema:
    """The models of all parts that are defined, by the name of their type, and of the file."""

    def __init__(self) -> None:
        self.models: dict[str, type[BaseModel]] = {}
        self._unions: dict[type, Any] = {}
        self._table(
            "marker",
            {"body": (str, ...), "point": (self._point(), None)} | _angle() | self._turns(),
        )
        self._table("place", {"point": (self._point(), ...), "at": (self._marker(), ...)})
        self._table("ground", {"points": (dict[str, self._type(_POINT)], None)})  # type: ignore[misc]
        self._table("run", {f.name: (f.type, None) for f in dataclasses.fields(Settings)})
        sections = {name: (dict[str, self._union(base)], None) for name, base in SECTIONS.items()}  # type: ignore[misc]
        any_numbers = self._type(Numbers((None, None), loose=True))
        document = {
            "format": (Literal[FORMAT], ...),
            "dimension": (Literal[DIMENSIONS], None),
            "title": (str, None),
            "consistent": (bool, None),
            "parameters": (dict[str, any_numbers], None),  # type: ignore[valid-type]
            "ground": (self.models["ground"], None),
            **sections,
            "run": (self.models["run"], None),
        }
        self.document = self._table("", document)
        names = {_reference(base).__forward_arg__: union for base, union in self._unions.items()}
        for model in self.models.values():
            model.model_rebuild(force=True, _types_namespace=names)

    def _table(self, name: str, keys: dict[str, tuple[Any, Any]], doc: str = "") -> type[BaseModel]:
        """A model with any keys: fields have names of their own, since keys may be pydantic's."""
        fields: dict[str, Any] = {
            f"key{i}": (kind, Field(default, alias=key))
            for i, (key, (kind, default)) in enumerate(keys.items())
        }
        # Pydantic names a model by what follows the last dot.
        own = name.replace("spatial.", "spatial ")
        made: type[BaseModel] = create_model(
            own or "scene", __config__=_STRICT, __doc__=doc or None, **fields
        )
        self.models[name] = made
        return made

    def _union(self, base: type) -> Any:
        """One of the tables of a base, by its type; made on demand, since parts hold parts."""
        if base not in self._unions:
            self._unions[base] = None
            known = {name: m for name, m in makers(base).items() if m.readable}
            labels = {name: _label(name, base) for name in known}
            options = [Annotated[self._part(m, base), Tag(labels[n])] for n, m in known.items()]
            own = base.__name__ if base.__name__ in known else None
            choose = Discriminator(
                lambda value: labels.get(_tag(value, own) or ""),
                custom_error_type="type",
                custom_error_message="type",
                custom_error_context={"known": ", ".join(known)},
            )
            self._unions[base] = Annotated[typing.Union[tuple(options)], choose]  # noqa: UP007
        return _reference(base)

    def _part(self, maker: Maker, base: type) -> type[BaseModel]:
        default = None if maker.name == base.__name__ else ...
        keys: dict[str, tuple[Any, Any]] = {TYPE: (Literal[maker.name], default)}
        body = issubclass(maker.part, AbstractBody)
        for key, argument, _ in maker.entries():
            if key == "name":
                if not body:
                    keys[key] = (str, None)
                continue
            keys[key] = (self._argument(argument), _default(argument))
        if body and "position" in maker.arguments:
            keys["place"] = (self.models["place"], None)
        doc = inspect.getdoc(maker.make) or ""
        return self._table(_label(maker.name, base), keys, doc.split("\n\n")[0])

    def _argument(self, argument: Argument) -> Any:
        assert argument.form is not None
        return self._type(argument.form)

    def _type(self, form: Form) -> Any:
        match form:
            case Numbers():
                return Annotated[
                    Any,
                    PlainValidator(functools.partial(_validate, form)),
                    WithJsonSchema(number_schema(form)),
                ]
            case Plain(kind):
                return Annotated[int, Field(le=_LARGEST)] if kind is int else kind
            case MarkerForm():
                return self._marker()
            case RotationForm():
                return self._rotation()
            case ListOf(item):
                return list[self._type(item)]  # type: ignore[misc]
            case TableOf(item):
                return dict[str, self._type(item)]  # type: ignore[misc]
            case PartOf(base):
                return self._union(base)

    def _marker(self) -> Any:
        table = '{ body = "crank", point = [0.1, 0.0] }'
        return _text_or(self.models["marker"], f'a marker, such as "crank.pin" or {table}')

    def _turns(self) -> dict[str, tuple[Any, Any]]:
        return {key: (self._type(form), None) for key, form in TURNS.items()}

    def _rotation(self) -> Any:
        """A quaternion or a matrix, or one of two tables."""
        if _AXIS not in self.models:
            self._table(_AXIS, {"axis": (self._type(Numbers((3,))), ...)} | _angle())
            self._table(_EULER, {"euler": (str, ...)} | _angle("angles", Numbers((3,))))
        choose = Discriminator(
            lambda x: "numbers" if not is_turning(x) else _EULER if "euler" in x else _AXIS
        )
        options = [Annotated[self._type(ROTATION_NUMBERS), Tag("numbers")]]
        options += [Annotated[self.models[name], Tag(name)] for name in (_AXIS, _EULER)]
        return Annotated[typing.Union[tuple(options)], choose]  # noqa: UP007

    def _point(self) -> Any:
        def check(value: Any) -> Any:
            return value if isinstance(value, str) else _validate(_POINT, value)

        words = {"anyOf": [{"type": "string"}, number_schema(_POINT)]}
        return Annotated[Any, PlainValidator(check), WithJsonSchema(words)]


def _text_or(table: type[BaseModel], wanted: str) -> Any:
    choose = Discriminator(
        lambda x: "marker" if isinstance(x, dict) else "text" if isinstance(x, str) else None,
        custom_error_type="form",
        custom_error_message="form",
        custom_error_context={"wanted": wanted},
    )
    return Annotated[Annotated[str, Tag("text")] | Annotated[table, Tag("marker")], choose]


def _tag(value: Any, default: str | None) -> str | None:
    """The type that a table says it is of; None if it says none."""
    tag = value.get(TYPE, default) if isinstance(value, dict) else None
    return tag if isinstance(tag, str) else None


def _label(name: str, base: type) -> str:
    """What the model of a part is called: its type, unless a body, joint or effect has it too."""
    bases = SECTIONS.values()
    taken = base not in bases and any(name in makers(other) for other in bases)
    return f"{base.__name__.removeprefix('Abstract')} {name}" if taken else name


def _reference(base: type) -> Any:
    return typing.ForwardRef(f"of_{base.__module__}_{base.__qualname__}".replace(".", "_"))


def _angle(name: str = "angle", form: Numbers = _NUMBER) -> dict[str, tuple[Any, Any]]:
    number = Annotated[
        Any,
        PlainValidator(functools.partial(_validate, form)),
        WithJsonSchema(number_schema(form)),
    ]
    return {name: (number, None), name + DEGREES: (number, None)}


def _default(argument: Argument) -> Any:
    return ... if argument.required and not argument.angle else None


def _validate(form: Numbers, value: Any) -> Any:
    words = wrong_numbers(form, value)
    if words:
        raise PydanticCustomError("number", "{words}", {"words": words})
    return value


_made: dict[tuple[type, ...], Schema] = {}


def schema() -> Schema:
    """The models of all parts that are defined now."""
    key = classes(tuple(SECTIONS.values()))
    if key not in _made:
        _made.clear()
        _made[key] = Schema()
    return _made[key]


def json_schema() -> dict[str, Any]:
    """The JSON schema of scene files, for editors."""
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return dialect | schema().document.model_json_schema()


def validate(tables: dict[str, Any], problems: Problems) -> None:
    """Add all that tables have wrong in themselves."""
    models = schema()
    try:
        models.document.model_validate(tables)
    except ValidationError as error:
        for one in error.errors(include_url=False):
            if problems.full:
                return
            place = _place(tables, one["loc"])
            problems.add(place, _words(models, one))


def _place(tables: Any, loc: Place) -> Place:
    """The keys of an error, without the types that pydantic puts between them."""
    place: list[str | int] = []
    for index, key in enumerate(loc):
        within: Any = range(len(tables)) if isinstance(tables, list) else tables
        if isinstance(tables, dict | list) and key in within:
            tables = tables[key]  # type: ignore[index]
        elif index < len(loc) - 1 or not isinstance(tables, dict):
            continue
        place.append(key)
    return tuple(place)


def _words(models: Schema, error: Any) -> str:
    """Cause and remedy of an error of pydantic."""
    kind, value, context, loc = error["type"], error["input"], error.get("ctx", {}), error["loc"]
    if kind == "number":
        return str(context["words"])
    if kind == "missing":
        return f"The key `{loc[-1]}` is missing; add it."
    if kind == "extra_forbidden":
        model = models.models.get(str(loc[-2]) if len(loc) > 1 else "", models.document)
        return unknown("key", loc[-1], [str(f.alias) for f in model.model_fields.values()])
    if kind == "type":
        if not isinstance(value, dict):
            return f"It is {shown(value)}, but a table is needed, such as {{ type = … }}."
        if TYPE not in value:
            return f"The key `type` is missing; one of {context['known']}."
        return unknown("type", value[TYPE], context["known"].split(", "))
    if kind == "form":
        return f"It is {shown(value)}, but {context['wanted']}, is needed."
    if kind == "less_than_equal":
        return f"It is {shown(value)}, but it may be {context['le']} at most."
    if kind == "literal_error":
        return f"It is {shown(value)}, but it must be {context['expected']}."
    wanted = {
        "dict_type": "a table",
        "model_type": "a table",
        "model_attributes_type": "a table",
        "list_type": "a list",
        "string_type": "a text in quotes",
        "bool_type": "true or false",
        "int_type": "a whole number",
        "float_type": "a number",
    }.get(kind)
    if wanted:
        return f"It is {shown(value)}, but {wanted} is needed."
    return f"It is {shown(value)}: {error['msg']}."
