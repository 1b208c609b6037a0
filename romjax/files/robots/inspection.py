"""Parts of a file that are not understood: refused with their lines, or listed as left out."""

import math
from collections.abc import Mapping

from ...common.errors import SceneFileError
from .markup import Element
from .vocabulary import ALL, Words, key

# Values of attributes that ask for nothing.
_NONE = {"", "auto", "enable", "false", "none"}
# What attributes of ranges and of limits have in their names: these may be infinite.
_ENDS = ("range", "effort", "velocity", "lower", "upper")


def inspect(root: Element, table: Mapping[str, Words], extensible: bool) -> list[str]:
    """List what is left out of a file, in words with lines; `extensible`: whether others may add
    elements, as to URDF, which are then listed.

    Raises SceneFileError, with a line for each element and attribute that is refused.
    """
    visitor = _Inspector(table, extensible)
    visitor.visit((), root)
    if visitor.refused:
        raise SceneFileError("\n".join(visitor.refused))
    return visitor.left_out


class _Inspector:
    """The findings so far on the way through a file."""

    def __init__(self, table: Mapping[str, Words], extensible: bool):
        self.table, self.extensible = table, extensible
        self.refused, self.left_out = list[str](), list[str]()

    def visit(self, parents: tuple[str, ...], element: Element) -> None:
        words = self.table.get(key(parents, element.tag))
        if words is None:
            if self.extensible:
                self._leave(element, "")
            # Else MuJoCo says that its schema does not have it.
            return
        default = "default" in parents
        if ALL in (words.refused, words.left_out, words.ignored):
            if words.refused and not default:
                self._refuse(element, "", words.remedy)
            elif words.left_out and not default:
                self._leave(element, "")
            return
        for name, value in element.attributes.items():
            kind = words.kind(name)
            if kind == "refused" and _asks(value):
                self._refuse(element, f" {name}={value!r}", words.remedy)
            elif kind == "taken" and (wrong := _wrong(name, value)):
                self.refused.append(
                    f"{element.place}: {element.called()} {name}={value!r}: {wrong}."
                )
            elif kind == "left_out" or (kind is None and self.extensible):
                self._leave(element, f" {name}={value!r}")
        for child in element.children:
            if words.taken != ALL or key((*parents, element.tag), child.tag) in self.table:
                self.visit((*parents, element.tag), child)

    def _refuse(self, element: Element, attribute: str, remedy: str) -> None:
        self.refused.append(
            f"{element.place}: {element.called()}{attribute}: romjax has nothing that does this; "
            f"{remedy}."
        )

    def _leave(self, element: Element, attribute: str) -> None:
        words = f"{element.place}: {element.called()}{attribute}"
        if words not in self.left_out:
            self.left_out.append(words)


def _wrong(name: str, value: str) -> str:
    """Say what is wrong with the numbers of an attribute, with a remedy; "" if nothing is."""
    numbers = _numbers(value)
    if any(math.isnan(x) for x in numbers):
        return "a number is none; give a finite one"
    if any(math.isinf(x) for x in numbers) and not any(word in name for word in _ENDS):
        return "a number is infinite; give a finite one"
    if name.endswith("range") and len(numbers) == 2 and numbers[0] > numbers[1]:
        return "the lower end is above the upper one; exchange them"
    return ""


def _numbers(value: str) -> list[float]:
    """The numbers that a value consists of, none if it has anything else."""
    try:
        return [float(number) for number in value.split()]
    except ValueError:
        return []


def _asks(value: str) -> bool:
    """Whether the value of an attribute asks for anything."""
    if value.strip().lower() in _NONE:
        return False
    numbers = _numbers(value)
    return not numbers or any(number != 0 for number in numbers)
