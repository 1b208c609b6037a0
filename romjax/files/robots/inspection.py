"""What of a file is not understood: refused with its line, or listed as left out."""

from collections.abc import Mapping

from ...common.errors import SceneFileError
from .markup import Element
from .vocabulary import ALL, Words, key

# Values of attributes that ask for nothing.
_NONE = {"", "auto", "enable", "false", "none"}


def inspect(root: Element, table: Mapping[str, Words], extensible: bool) -> list[str]:
    """What is left out of a file, in words with lines; `extensible`: whether others may add
    elements, as to URDF, which are then listed.

    Raises SceneFileError, with a line for each element and attribute that is refused.
    """
    found = _Found(table, extensible)
    found.visit((), root)
    if found.refused:
        raise SceneFileError("\n".join(found.refused))
    return found.left_out


class _Found:
    """What has been found so far on the way through a file."""

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


def _asks(value: str) -> bool:
    """Whether the value of an attribute asks for anything."""
    if value.strip().lower() in _NONE:
        return False
    try:
        return any(float(number) != 0 for number in value.split())
    except ValueError:
        return True
