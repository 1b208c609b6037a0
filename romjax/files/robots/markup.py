"""Files in XML as trees of elements that know where they stand."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from ...common.errors import SceneFileError

INCLUDE = "include"
# Includes may be nested so deep: a file that includes itself never ends.
_DEEPEST = 20
# Elements may be nested so deep: no robot has chains of so many links, and each takes a call to be
# read.
_NESTED = 400
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


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
        elements = (x for x in self.walk() if x.tag == tag and x.attributes.get("name") == name)
        return next(elements, None)

    def walk(self) -> Iterator["Element"]:
        """All elements from this one on, as they stand in the file."""
        yield self
        for child in self.children:
            yield from child.walk()


def read(path: Path, depth: int = 0) -> Element:
    """The root element of a file; elements of files that it includes stand where it does so.

    Raises SceneFileError for what is no XML, for entities, which can make a file endless, and for a
    file that is not there.
    """
    parser, stack = expat.ParserCreate(), [Element("", {}, path, 1)]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, path, parser.CurrentLineNumber)
        if len(stack) > _NESTED:
            raise SceneFileError(
                f"{element.place}: {element.called()} stands in {_NESTED} others; write fewer."
            )
        stack[-1].children.append(element)
        stack.append(element)

    def declare(name: str, *_: object) -> None:
        raise SceneFileError(
            f"{path}:{parser.CurrentLineNumber}: <!ENTITY {name}>: entities are not read; write "
            "out what it stands for, or use <include>."
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.EntityDeclHandler = declare
    data = _bytes(path)
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        words = expat.ErrorString(error.code)
        remedy = "close every element that is begun"
        if error.code == expat.errors.codes[expat.errors.XML_ERROR_INVALID_TOKEN]:
            remedy = "look for a stray sign, or save the file in UTF-8"
        raise SceneFileError(
            f"{path}:{error.lineno}: this is no XML, {words}; {remedy}."
        ) from error
    (root,) = stack[0].children
    _include(root, depth)
    return root


def _bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SceneFileError(f"{path}: {error.strerror}; give a file that can be read.") from error
    if data.startswith(_UTF_16):
        raise SceneFileError(f"{path}:1: the file is in UTF-16; save it in UTF-8.")
    return data


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
        file = child.path.parent / child.attributes.get("file", "")
        if not file.is_file():
            raise SceneFileError(
                f"{child.place}: {child.called()}: there is no file {str(file)!r}; give one, by "
                "its place from here."
            )
        other = read(file, depth + 1)
        held += other.children
    element.children = held
