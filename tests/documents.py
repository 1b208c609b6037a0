"""What README, notebooks, docstrings and help texts say in code: spans, blocks and commands."""

import argparse
import ast
import functools
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import nbformat

from romjax.command_parser import parser


class Read(Mapping[str, Any]):
    """A mapping that is made when somebody looks into it: all processes import this module, and one
    of them runs the tests that read it.
    """

    def __init__(self, make: Callable[[], Mapping[str, Any]]):
        self._made = functools.cache(make)

    def __getitem__(self, name):
        return self._made()[name]

    def __iter__(self):
        return iter(self._made())

    def __len__(self):
        return len(self._made())


ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
# Half of the time of all.
LONG = ("flexible_robot_arm", "reduction_that_pays", "what_accuracy_costs")
README = (ROOT / "README.md").read_text()

# Pages of the site that its build writes are ignored by git.
GENERATED = tuple(
    line for line in (ROOT / ".gitignore").read_text().splitlines() if line.startswith("docs/")
)
# Of changes, old names are a part.
PAGES = {
    name: path.read_text()
    for path in sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
    if not (name := str(path.relative_to(ROOT))).startswith((*GENERATED, "CHANGELOG.md"))
}

# The sources of the package, by their paths in it, parsed once for all who look at them.
PACKAGE = ROOT / "romjax"
FILES = {path.relative_to(PACKAGE).as_posix(): path for path in sorted(PACKAGE.rglob("*.py"))}
TREES = Read(lambda: {name: ast.parse(path.read_text()) for name, path in FILES.items()})

BLOCK = re.compile(r"^```([^`\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)  # language, content
SPAN = re.compile(r"`([^`]+)`")
INDENTED = re.compile(r"(?:^ {4}.*\n?)+", re.MULTILINE)  # a block of code in a docstring
COMMAND = re.compile(r"(?:\.venv/bin/)?(?:romjax|python3?|pip|pytest) \S.*")


def spans(text: str) -> list[str]:
    """The code within lines, each on one line; what stands in blocks is left out."""
    return [" ".join(span.split()) for span in SPAN.findall(BLOCK.sub("", text))]


def commands(text: str) -> list[str]:
    """What one would type into a shell: in blocks, after a `$` or without a language; spans, and
    indented lines.
    """
    found = BLOCK.findall(text)
    lines = [line for language, block in found if not language for line in block.splitlines()]
    for language, block in found:
        if language == "console":
            lines += [line[2:] for line in block.splitlines() if line.startswith("$ ")]
    typed = [part for line in lines for part in line.split(" && ")]
    indented = "".join(INDENTED.findall(BLOCK.sub("", text))).splitlines()
    quoted = [line.strip() for line in spans(text) + indented]
    return typed + [line for line in quoted if COMMAND.fullmatch(line)]


def marked(name: str) -> str:
    """The README's block that follows the comment <!-- name -->."""
    return re.search(rf"<!-- {name} -->\n```\w*\n(.*?)```", README, re.DOTALL)[1]


def blocks(text: str, language: str) -> list[str]:
    """The contents of all blocks of a language."""
    return [content for own, content in BLOCK.findall(text) if own == language]


def verbs() -> dict[str, argparse.ArgumentParser]:
    """The parsers of the command line's verbs."""
    return parser()._subparsers._group_actions[0].choices


def options(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    return {name: action for action in parser._actions for name in action.option_strings}


def _docstrings() -> dict[str, str]:
    found = {}
    for name, tree in TREES.items():
        found[f"romjax/{name}"] = ast.get_docstring(tree) or ""
        for node in _definitions(tree):
            found[f"romjax/{name}:{node.lineno}"] = ast.get_docstring(node) or ""
    return found


def _definitions(node: ast.AST) -> Iterator[ast.ClassDef | ast.FunctionDef]:
    """The classes and functions within a statement, which no expression holds."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef | ast.FunctionDef):
            yield child
        if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield from _definitions(child)


def _markdown(path: Path) -> str:
    cells = nbformat.read(path, as_version=4).cells
    return "\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown")


def _help_texts() -> dict[str, str]:
    found = {}
    for name, own in {"": parser(), **verbs()}.items():
        words = [action.help for action in own._actions]
        said = [own.description, inspect.cleandoc(own.epilog or ""), *words]
        found[f"romjax {name} --help"] = "\n".join(filter(None, said))
    return found


def _documents() -> dict[str, str]:
    notebooks = {str(path.relative_to(ROOT)): _markdown(path) for path in NOTEBOOKS}
    return {**PAGES, **notebooks, **DOCSTRINGS, **_help_texts()}


DOCSTRINGS, DOCUMENTS = Read(_docstrings), Read(_documents)
