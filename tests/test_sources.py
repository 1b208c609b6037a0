"""Which sources a compiled program depends on: an edit elsewhere leaves it as it is."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from programs import compilations
from test_structure import imports, modules

import romjax as rj
from romjax.basis.subspace import singular_values
from romjax.compiling import program_cache, sources

PACKAGE = Path(rj.__file__).parent
# What pictures, files and studies are made of is no part of what a simulation runs.
APART = {"plot", "files", "gallery", "study", "measure", "analysis", "cli"}


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A copy of the package, whose sources count instead."""
    copy = tmp_path / "romjax"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(sources, "_PACKAGE", copy)
    forget()
    yield copy
    forget()


def forget():
    sources._sources.cache_clear()
    sources._digest_of.cache_clear()


def edit(file):
    file.write_text(file.read_text() + "\n# edited\n")
    forget()


@pytest.mark.instant
def test_imports_are_those_that_python_sees():
    for path, parts in modules():
        wanted = {tuple(name) for name, own in imports(path, parts) if own}
        found = {
            each if each in wanted else each[:-1]
            for each in sources._imports(parts, path.read_text())
        }
        assert found == wanted, path


@pytest.mark.instant
def test_an_edit_counts_where_programs_come_from(package):
    def digests():
        return [sources.digest({f"romjax.{name}"}) for name in ("integrate.run", "study.compare")]

    integration, study = digests()
    assert integration != study
    for room in APART:
        edit(next(package.glob(f"{room}*/*.py" if (package / room).is_dir() else f"{room}.py")))
    assert digests()[0] == integration
    assert digests()[1] != study
    for file in ("system/base.py", "linalg/kkt.py", "compiling/program.py"):
        before = digests()
        edit(package / file)
        assert all(old != new for old, new in zip(before, digests(), strict=True)), file


def test_after_an_edit_nothing_is_compiled(package, monkeypatch):
    """Programs that are traced anew lead to a text that is known."""
    monkeypatch.setenv("ROMJAX_CACHE_DIR", str(package.parent / "caches"))
    folder = program_cache.folder()
    matrix = np.diag([3.0, 2.0])

    def call():
        singular_values._compiled.cache_clear()
        return compilations(lambda: singular_values(matrix))

    def files():
        calls = list(folder.glob("*.call"))
        return len(calls), len(list(folder.iterdir())) - len(calls)

    assert call() > 0
    assert files() == (1, 1)
    edit(package / "plot" / "palette.py")
    assert call() == 0
    assert files() == (1, 1)
    edit(package / "basis" / "subspace.py")
    assert call() == 0
    assert files() == (2, 1)
