"""Files in XML as trees of elements that know where they stand."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from ...common.errors import SceneFileError

INCLUDE = "include"
# Of an include within an include, and so on: a file that includes itself never ends.
_DEEPEST = 20


@dataclasses.dataclass
class Element:
    """An element of a file: its name, its attributes, what it holds, and its place."""

    tag: str
    attributes: dict[str, str]
    path: Path
    line: int
    children: list["Element"] = dataclasses.field(default_factory=list)

    @property
    def place(self) -> str:
        """The file and the line, as messages begin."""
        return f"{self.path}:{self.line}"

    def called(self) -> str:
        """The element in words, such as <joint name="elbow">."""
        name = self.attributes.get("name")
        return f'<{self.tag} name="{name}">' if name else f"<{self.tag}>"

    def find(self, tag: str, name: str) -> "Element | None":
        """The first element of a tag and a name within this one."""
        found = (x for x in self.walk() if x.tag == tag and x.attributes.get("name") == name)
        return next(found, None)

    def walk(self) -> Iterator["Element"]:
        """All elements from this one on, as they stand in the file."""
        yield self
        for child in self.children:
            yield from child.walk()


def read(path: Path, depth: int = 0) -> Element:
    """The root element of a file; elements of files that it includes stand where it does so.

    Raises SceneFileError for what is no XML, and for a file that is not there.
    """
    parser, stack = expat.ParserCreate(), [Element("", {}, path, 1)]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, path, parser.CurrentLineNumber)
        stack[-1].children.append(element)
        stack.append(element)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    try:
        parser.Parse(path.read_bytes(), True)
    except OSError as error:
        raise SceneFileError(f"{path}: {error.strerror}; give a file that can be read.") from error
    except expat.ExpatError as error:
        words = expat.ErrorString(error.code)
        raise SceneFileError(
            f"{path}:{error.lineno}: this is no XML, {words}; close every element that is begun."
        ) from error
    (root,) = stack[0].children
    _include(root, depth)
    return root


def _include(element: Element, depth: int) -> None:
    """Put what is included in the place of each include within an element."""
    held = list[Element]()
    for child in element.children:
        if child.tag != INCLUDE:
            _include(child, depth)
            held.append(child)
            continue
        if depth >= _DEEPEST:
            raise SceneFileError(
                f"{child.place}: files include each other {_DEEPEST} deep; take one out."
            )
        other = read(child.path.parent / child.attributes.get("file", ""), depth + 1)
        held += other.children
    element.children = held
