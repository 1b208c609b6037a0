"""Pages, notebooks and docstrings: what they name exists, and the code of docstrings runs."""

import ast
import inspect
import re
import tomllib

import nbformat
import numpy as np
import pytest
from documents import (
    BLOCK,
    DOCSTRINGS,
    DOCUMENTS,
    INDENTED,
    NOTEBOOKS,
    PAGES,
    ROOT,
    blocks,
    marked,
    spans,
)
from names import mistakes

import romjax as rj

PATH = re.compile(r"(?<![\w/-])(?:notebooks|benchmarks|romjax|tests)/(?:[\w./-]*\w)?")
NAME = re.compile(r"\b(?:rj|romjax)(?:\.[A-Za-z]\w*)+")
LINK = re.compile(r"\]\(([^):#]+\.md)[)#]")
EXTRA = re.compile(r"extra `(\w+)`")


@pytest.mark.instant
def test_first_steps_runs_the_readme_example():
    """The README's example is short, and it is the first cell of a notebook that runs."""
    notebook = nbformat.read(ROOT / "notebooks" / "first_steps.ipynb", as_version=4)
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    assert code[0] == marked("example").strip()
    assert len([line for line in code[0].splitlines() if line.strip()]) <= 12
    assert marked("robot") in blocks(PAGES["docs/howto/robots.md"], "python")


def is_python(block: str) -> bool:
    """Whether a block is code, not an equation."""
    try:
        ast.parse(inspect.cleandoc(block))
    except SyntaxError:
        return False
    return True


def test_docstring_snippets():
    """The code in docstrings: that of PodStream, as it stands."""
    snippets = [block for text in DOCSTRINGS.values() for block in INDENTED.findall(text)]
    found = [block for block in snippets if is_python(block)]
    assert len(found) == 1
    t = np.linspace(0.0, 1.0, 30)
    q = np.sin(np.outer(t, np.arange(1.0, 7.0)))
    names = {"PodStream": rj.PodStream, "metric": np.eye(6), "offset": np.zeros(6)}
    names |= {"t": t, "q": q, "v": q}
    exec(inspect.cleandoc(found[0]), names)
    assert names["basis"].rank == 5


@pytest.mark.instant
def test_names():
    """Classes, functions, fields and arguments in code spans exist, as they are written there."""
    wrong = [
        (place, span, mistake)
        for place, text in DOCUMENTS.items()
        for span in spans(text)
        if not PATH.fullmatch(span) and not (ROOT / span).is_file()
        for mistake in mistakes(span)
    ]
    assert wrong == []


@pytest.mark.instant
@pytest.mark.parametrize(
    "span",
    [
        "RigidBodies",
        "Beam.of_sections",
        "trajectory.doubting()",
        "trajectory.warnings(1)",
        "rj.tune_baumgarten(system, ts)",
        "rj.reduce_to(system, truth, tolerance=1e-4)",
        "print(rj.check_gradient(f))",
        "with rj.forwards():",
        "adjoint=diffrax.Forward()",
        "stabilisation=rj.Projection()",
        "paths=",
    ],
)
def test_mistakes_are_seen(span):
    assert list(mistakes(span))


@pytest.mark.instant
def test_names_in_messages():
    """So do those that messages and help texts give as a remedy, such as romjax.consistent."""
    wrong = []
    for path in (ROOT / "romjax").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                named = NAME.findall(node.value)
                wrong += [(path.name, mistake) for name in named for mistake in mistakes(name)]
    assert wrong == []


@pytest.mark.instant
def test_paths():
    """Files that the documents name are there."""
    named = {path for text in DOCUMENTS.values() for path in PATH.findall(BLOCK.sub("", text))}
    assert len(named) > 10
    assert [path for path in sorted(named) if not (ROOT / path).exists()] == []


@pytest.mark.instant
def test_notebooks_link_to_pages():
    """From where the site has them."""
    folder = ROOT / "docs" / "tutorials" / "notebooks"
    linked = [
        (path.name, page)
        for path in NOTEBOOKS
        for cell in nbformat.read(path, 4).cells
        if cell.cell_type == "markdown"
        for page in LINK.findall(cell.source)
    ]
    assert linked
    assert [link for link in linked if not (folder / link[1]).resolve().exists()] == []


@pytest.mark.instant
def test_extras():
    """The extras that the documents ask for are in pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    named = {extra for text in DOCUMENTS.values() for extra in EXTRA.findall(text)}
    assert named <= set(project["optional-dependencies"])
