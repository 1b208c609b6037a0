"""Signatures as the source has them: with the names of types, where Python knows their unions."""

import ast
import dataclasses
import inspect
import re
import textwrap
from typing import Any


def signature_text(part: Any, *, bound: bool = False) -> tuple[str, str | None] | None:
    """Arguments, in brackets, and result of a function or class; None where no source has them.

    `bound`: without the first argument.
    """
    if not inspect.isclass(part):
        node = _definition(inspect.unwrap(getattr(part, "__func__", part)))
        return None if node is None else _of_function(node, bound or hasattr(part, "__func__"))
    constructor = _definition(inspect.unwrap(part.__init__))
    if constructor is not None:
        return _of_function(constructor, bound=True)[0], None
    return (_of_fields(part), None) if dataclasses.is_dataclass(part) else None


def _definition(function: Any) -> ast.FunctionDef | None:
    try:
        source = textwrap.dedent(inspect.getsource(function))
        (node,) = ast.parse(source).body
    except (OSError, TypeError, SyntaxError, ValueError):
        return None
    return node if isinstance(node, ast.FunctionDef) else None


def _of_function(node: ast.FunctionDef, bound: bool) -> tuple[str, str | None]:
    arguments = node.args
    positional = arguments.posonlyargs or arguments.args
    if bound and positional:
        del positional[0]
    # Types of what comes in any number say nothing.
    for several in (arguments.vararg, arguments.kwarg):
        if several is not None and several.annotation is not None:
            several.annotation = None if _text(several.annotation) == "Any" else several.annotation
    return f"({_text(arguments)})", _text(node.returns) if node.returns else None


def _of_fields(cls: type) -> str:
    declared = {}
    for base in reversed(cls.__mro__):
        if dataclasses.is_dataclass(base):
            declared |= _fields(base)
    words = []
    for field in dataclasses.fields(cls):
        node = declared.get(field.name)
        if not field.init or node is None:
            continue
        default = _default(node.value)
        words.append(f"{field.name}: {_text(_without_converter(node.annotation))}{default}")
    return f"({', '.join(words)})"


def _fields(cls: type) -> dict[str, ast.AnnAssign]:
    """The declarations of its own fields."""
    try:
        (node,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    except (OSError, TypeError):
        return {}
    found = [x for x in node.body if isinstance(x, ast.AnnAssign)]
    return {x.target.id: x for x in found if isinstance(x.target, ast.Name)}


def _default(value: ast.expr | None) -> str:
    """As in " = 0.0"; that of `number(default=0.0)` too."""
    if isinstance(value, ast.Call):
        given = {keyword.arg: keyword.value for keyword in value.keywords}
        if "default_factory" in given:
            return f" = {_text(given['default_factory'])}()"
        value = given.get("default")
    return "" if value is None else f" = {_text(value)}"


def _without_converter(annotation: ast.expr) -> ast.expr:
    """What users may write for a field that is `Converted[array, input]`."""
    if isinstance(annotation, ast.Subscript) and _text(annotation.value) == "Converted":
        types = annotation.slice
        return types.elts[1] if isinstance(types, ast.Tuple) else types
    return annotation


def _text(node: ast.AST) -> str:
    """The source; jaxtyping's shapes without the blank that linters need before one name."""
    return re.sub(r"(['\"]) (?=[\w*])", r"\1", ast.unparse(node))
