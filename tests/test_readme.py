"""The README's example and the notebooks run as they stand."""

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def example() -> str:
    text = (ROOT / "README.md").read_text()
    return re.search(r"<!-- example -->\n```python\n(.*?)```", text, re.DOTALL)[1]


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook(path):
    """Executed from top to bottom; the cells assert their facts."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": path.parent}}).execute()


def test_first_steps_runs_the_readme_example():
    """The README's example is short, and it is the first cell of a notebook that runs."""
    notebook = nbformat.read(ROOT / "notebooks" / "first_steps.ipynb", as_version=4)
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    assert code[0] == example().strip()
    assert len([line for line in code[0].splitlines() if line.strip()]) <= 20
