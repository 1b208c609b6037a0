"""Signatures as the source has them: with the names of types, where Python knows their unions."""

import ast
import dataclasses
import inspect
import re
import sys
import textwrap
from collections.abc import Callable, Mapping
from typing import Any


def signature_text(
    part: Any, public: Mapping[type, str], *, bound: bool = False
) -> tuple[str, str | None] | None:
    """Arguments, in brackets, and result of a function or class; None where no source has them.

    **Arguments:**

    - `part`: the function or class.
    - `public`: names by which classes are documented, and so take the place of others.
    - `bound`: without the first argument.
    """
    owner = inspect.unwrap(getattr(part, "__func__", part))
    known = vars(sys.modules[owner.__module__])

    def text(node: ast.AST) -> str:
        return _text(_Named(known, public).visit(node))

    if not inspect.isclass(part):
        node = _definition(owner)
        bound = bound or hasattr(part, "__func__")
        return None if node is None else _of_function(node, text, bound)
    constructor = _definition(inspect.unwrap(part.__init__))
    if constructor is not None:
        return _of_function(constructor, text, bound=True)[0], None
    return (_of_fields(part, text), None) if dataclasses.is_dataclass(part) else None


class _Named(ast.NodeTransformer):
    """Names of classes become those by which they are documented."""

    def __init__(self, known: Mapping[str, Any], public: Mapping[type, str]):
        self.known, self.public = known, public

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return self._name(node.id) or node

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """Of a class that is not defined yet, the name is a string, and so is a union with it."""
        if not isinstance(node.value, str):
            return node
        if " | " in node.value:
            return self.visit(ast.parse(node.value, mode="eval").body)
        return self._name(node.value) or node

    def _name(self, name: str) -> ast.Name | None:
        part = self.known.get(name)
        return (
            ast.Name(self.public[part]) if inspect.isclass(part) and part in self.public else None
        )


def _definition(function: Any) -> ast.FunctionDef | None:
    try:
        source = textwrap.dedent(inspect.getsource(function))
        (node,) = ast.parse(source).body
    except (OSError, TypeError, SyntaxError, ValueError):
        return None
    return node if isinstance(node, ast.FunctionDef) else None


def _of_function(
    node: ast.FunctionDef, text: Callable[[ast.AST], str], bound: bool
) -> tuple[str, str | None]:
    arguments = node.args
    positional = arguments.posonlyargs or arguments.args
    if bound and positional:
        del positional[0]
    # Types of what comes in any number say nothing.
    for several in (arguments.vararg, arguments.kwarg):
        if several is not None and several.annotation is not None:
            several.annotation = None if _text(several.annotation) == "Any" else several.annotation
    return f"({text(arguments)})", text(node.returns) if node.returns else None


def _of_fields(cls: type, text: Callable[[ast.AST], str]) -> str:
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
        words.append(f"{field.name}: {text(_without_converter(node.annotation))}{default}")
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
