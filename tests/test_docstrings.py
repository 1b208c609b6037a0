"""Docstrings and signatures name the same parameters."""

import inspect
import re
from typing import Any

import pytest
from names import MODULES, PARTS, parameters, public
from signatures import signature_text

import romjax as rj

pytestmark = pytest.mark.instant

BULLET = re.compile(r"^- .*?(?=^- |^$|\Z)", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"`([^`]+)`")
WORD = re.compile(r"\w+")
# What a bullet explains, such as "- `ts` (k,): ...", "- `q0`, `v0`: ..." or "...; `tol`: ...".
HEAD = re.compile(r"(?:^- |[.;] )((?:`\w+[^`]*`(?: ?[(\[][^)\]]*[)\]])*(?:, | and (?:the )?)?)+):")

# Made by functions of their own, or with parameters of Python's.
INTERNAL = {"PodStream", "Status", "Flag"}


def own(part: Any) -> str:
    """The docstring of a function or class, with none that is inherited."""
    return inspect.cleandoc(part.__doc__ or "")


def documented() -> dict[str, Any]:
    """Functions and classes of the package, with their methods, by where they are."""
    found = {}
    for module in MODULES:
        for name, part in vars(module).items():
            if getattr(part, "__module__", None) != module.__name__ or not callable(part):
                continue
            found[f"{module.__name__}.{name}"] = part
            if inspect.isclass(part):
                members = {key: getattr(part, key) for key in vars(part) if key[0] != "_"}
                methods = {key: value for key, value in members.items() if callable(value)}
                found |= {f"{module.__name__}.{name}.{key}": x for key, x in methods.items()}
    return found


def explained(text: str) -> list[str]:
    """The names that the bullets of a docstring explain."""
    heads = [
        head for bullet in BULLET.findall(text) for head in HEAD.findall(" ".join(bullet.split()))
    ]
    return [WORD.search(span)[0] for head in heads for span in SPAN.findall(head)]


def named(text: str) -> set[str]:
    """All words in the code spans of a docstring, and of those it refers to, as in "as `pod`"."""
    found = {word for span in SPAN.findall(text) for word in WORD.findall(span)}
    others = [PARTS[name] for name in re.findall(r"as `(\w+)`", text) if name in PARTS]
    return found.union(*(named(own(part)) for part in others))


def test_explained_parameters_exist():
    """What a docstring explains is a parameter, or for a class a field or an attribute."""
    wrong = {}
    for place, part in documented().items():
        known = set(parameters(part))
        if inspect.isclass(part):
            known |= set(dir(part)).union(*map(inspect.get_annotations, part.__mro__))
        wrong[place] = set(explained(own(part))) - known
    assert {place: names for place, names in wrong.items() if names} == {}


def test_parameters_are_named():
    """What is exported names all its parameters, and so does what lists any of them.

    The docstring of a class may leave some to those of its bases.
    """
    listed = {place: part for place, part in documented().items() if "**Arguments" in own(part)}
    exported = {name: part for name, part in public().items() if name not in INTERNAL}
    missing = {}
    for place, part in (exported | listed).items():
        bases = part.__mro__ if inspect.isclass(part) else [part]
        text = "\n".join(own(base) for base in bases if base.__module__.startswith("romjax"))
        missing[place] = set(parameters(part)) - named(text) - {"self"}
    assert len(missing) > 100
    assert {place: names for place, names in missing.items() if names} == {}


def test_signatures_have_no_types_as_strings():
    """A union with a class that is not defined yet is a string in the source."""
    shown = signature_text(rj.AbstractMarkerEffect.acting, {})
    assert shown == ("(self, acts: Bool[Array, ''])", "AbstractMarkerEffect | None")
