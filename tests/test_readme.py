"""The README's example and the notebooks run as they stand."""

import re
from pathlib import Path

import nbformat
import pytest
from matplotlib.figure import Figure
from nbclient import NotebookClient

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def example() -> str:
    text = (ROOT / "README.md").read_text()
    return re.search(r"<!-- example -->\n```python\n(.*?)```", text, re.DOTALL)[1]


@pytest.mark.slow
def test_readme_example(capsys):
    """It is short, it runs, and its last line is a figure."""
    lines = [line for line in example().splitlines() if line.strip()]
    assert len(lines) <= 20
    names = {}
    exec("\n".join(lines[:-1]), names)
    assert isinstance(eval(lines[-1], names), Figure)
    assert names["report"].error < 2e-6
    assert "degrees of freedom" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook(path):
    """Executed from top to bottom; the cells assert their facts."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": path.parent}}).execute()


def test_first_steps_shows_the_readme_example():
    notebook = nbformat.read(ROOT / "notebooks" / "first_steps.ipynb", as_version=4)
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    assert example().strip() in code[0]
