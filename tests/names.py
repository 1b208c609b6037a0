"""What a name in a document stands for, and whether a call in it fits."""

import ast
import builtins
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optax

import romjax as rj
from romjax.common import arrays

CLASS = re.compile(r"[A-Z]\w*[a-z]\w*")
KEYWORD = re.compile(r"(\w+)=(?:\S.*)?")

MODULES = [
    importlib.import_module(module.name)
    for module in pkgutil.walk_packages(rj.__path__, "romjax.")
    if not module.name.endswith("__main__")
]
# Every function and class of the package, by name; of several of one name, the public one.
PARTS = {
    name: part
    for module in MODULES
    for name, part in vars(module).items()
    if getattr(part, "__module__", None) == module.__name__ and callable(part)
} | {name: part for name, part in vars(rj).items() if not name.startswith("_")}

ROOTS = {"rj": rj, "romjax": rj, "diffrax": diffrax, "eqx": eqx, "jax": jax, "jnp": jnp}
ROOTS |= {"optax": optax}
# What documents call an instance of a class.
INSTANCES = {
    "arm": rj.Scene,
    "basis": rj.Basis,
    "body": rj.AbstractBody,
    "crank": rj.AbstractBody,
    "ground": rj.Ground,
    "mesh": rj.Mesh,
    "other": rj.AbstractBody,
    "pinion": rj.AbstractBody,
    "rack": rj.AbstractBody,
    "rod": rj.AbstractBody,
    "report": rj.Comparison,
    "rom": rj.ReducedSystem,
    "run": rj.Trajectory,
    "scene": rj.Scene,
    "step": rj.MonitoredStep,
    "system": rj.AbstractSystem,
    "trajectory": rj.Trajectory,
}
CLASSES = {*PARTS, *vars(arrays), *vars(builtins), *vars(diffrax)}
KNOWN = PARTS | INSTANCES | ROOTS
LABELS = {"beam", "cart", "pendulum"}  # bodies, in names of coordinates such as `cart.x`


def parameters(part: Any) -> dict[str, inspect.Parameter]:
    """Those of a function, or of a class that is called; none of what has no signature."""
    try:
        found = inspect.signature(part).parameters
    except (TypeError, ValueError):
        return {}
    return {name: found[name] for name in found if not name.startswith("_")}


def public() -> dict[str, Any]:
    """What `romjax` exports, with the other ways to make its classes, such as `Beam.of_section`."""
    found = {name: part for name, part in vars(rj).items() if callable(part) and name[0] != "_"}
    for name, part in list(found.items()):
        if inspect.isclass(part):
            makers = [key for key, value in vars(part).items() if isinstance(value, classmethod)]
            found |= {f"{name}.{key}": getattr(part, key) for key in makers if key[0] != "_"}
    return found


KEYWORDS = {name for part in public().values() for name in parameters(part)}


def parse(span: str) -> ast.AST | None:
    """A span as Python, if it is: also a signature, a keyword without value, or a `with`."""
    for ending in ("", "...", " pass"):
        try:
            return ast.parse(span.split(" -> ")[0] + ending)
        except SyntaxError:
            continue
    return None


def find(node: ast.expr) -> Any:
    """What a name such as `rj.plot.values` stands for; None for a field, or a local name.

    Raises AttributeError for one that does not exist.
    """
    if isinstance(node, ast.Name):
        # It takes long to import, which each process of the tests would do.
        return importlib.import_module("xarray") if node.id == "xarray" else KNOWN.get(node.id)
    if not isinstance(node, ast.Attribute):
        return None
    owner = find(node.value)
    if owner is None:
        if isinstance(node.value, ast.Name) and node.value.id not in LABELS:
            raise AttributeError(f"unknown: {node.value.id}; is it one for INSTANCES?")
        return None
    bases = owner.__mro__ if inspect.isclass(owner) else ()
    if any(node.attr in inspect.get_annotations(base) for base in bases):
        return None
    return getattr(owner, node.attr)


def bind(call: ast.Call) -> None:
    """Raises TypeError for a call whose arguments do not fit what is called, if that is known."""
    part = find(call.func)
    if part is None:
        return
    method = inspect.isfunction(part) and isinstance(call.func, ast.Attribute)
    own = ["self"] if method and inspect.isclass(find(call.func.value)) else []
    keywords = {keyword.arg: None for keyword in call.keywords}
    inspect.signature(part).bind(*own, *call.args, **keywords)


def mistakes(span: str) -> Iterator[str]:
    """What is wrong with a span of code: unknown names, and arguments that a call does not take."""
    tree = parse(span)
    if tree is None:
        return
    if CLASS.fullmatch(span) and span not in CLASSES:
        yield f"no class {span}"
    keyword = KEYWORD.fullmatch(span)
    if keyword and keyword[1] not in KEYWORDS:
        yield f"nothing takes {keyword[1]}"
    for node in ast.walk(tree):
        try:
            if isinstance(node, ast.Attribute):
                find(node)
            elif isinstance(node, ast.Call):
                bind(node)
        except (AttributeError, TypeError) as error:
            yield str(error)
