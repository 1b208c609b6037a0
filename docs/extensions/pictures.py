"""Pictures of the tutorials, for the page that lists them: the first figure of each notebook."""

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import nbformat

import notebooks

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "tutorials" / "pictures"


def figures(notebook: nbformat.NotebookNode) -> Iterator[bytes]:
    """The figures that an executed notebook shows, as PNG."""
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            content = output.get("data", {}).get("image/png")
            if content:
                yield base64.b64decode(content)


def write(app: "Sphinx") -> None:
    """Those that changed; a notebook without a figure has none, which ends a build with `-W`."""
    FOLDER.mkdir(exist_ok=True)
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        content = next(figures(notebooks.executed_one(path)), None)
        target = FOLDER / f"{path.stem}.png"
        if content and not (target.exists() and target.read_bytes() == content):
            target.write_bytes(content)


def setup(app: "Sphinx") -> dict[str, Any]:
    # After the notebooks, which other functions of this event execute.
    app.connect("builder-inited", write, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
