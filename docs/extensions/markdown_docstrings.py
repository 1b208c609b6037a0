"""Docstrings in Markdown, and signatures with the names of types, for autodoc."""

import inspect
from typing import Any

import api
from docutils import nodes
from docutils.utils import new_document
from myst_parser.parsers.sphinx_ import MystParser
from signatures import signature_text
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

PUBLIC = {part: name for name, part in api.everything().items() if inspect.isclass(part)}


class Markdown(SphinxDirective):
    """Content in Markdown within reStructuredText, which is what autodoc writes."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        source, _ = self.get_source_info()
        document = new_document(source, self.state.document.settings)
        MystParser().parse("\n".join(self.content), document)
        return list(document.children)


def wrap(app: Sphinx, what: str, name: str, part: Any, options: Any, lines: list[str]) -> None:
    """A docstring becomes the content of the directive."""
    if any(lines):
        lines[:] = [".. markdown::", "", *(f"   {line}" for line in lines)]


def sign(
    app: Sphinx, what: str, name: str, part: Any, options: Any, arguments: str, result: str
) -> tuple[str, str | None] | None:
    """A signature as the source has it."""
    return signature_text(part, PUBLIC, bound=what == "method") if callable(part) else None


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_directive("markdown", Markdown)
    app.connect("autodoc-process-docstring", wrap)
    app.connect("autodoc-process-signature", sign)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
