"""The notebooks as pages of the site, and their outputs in the cache from which it is built."""

import multiprocessing
import shutil
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import executed
import nbformat

CACHE = executed.FOLDER / "notebooks"
TIMEOUT = 400  # [s] of a cell


def copy(source: Path, target: Path) -> None:
    """All notebooks into a folder of the site; those that did not change keep their time."""
    target.mkdir(parents=True, exist_ok=True)
    wanted = {path.name: path for path in source.glob("*.ipynb")}
    for old in target.glob("*.ipynb"):
        if old.name not in wanted:
            old.unlink()
    for name, path in wanted.items():
        own = target / name
        if not own.exists() or own.read_bytes() != path.read_bytes():
            shutil.copyfile(path, own)


def execute(path: Path, folder: Path) -> None:
    """Execute a notebook in a folder, and keep its outputs for the site.

    Raises nbclient's CellExecutionError at a cell that fails.
    """
    from jupyter_cache.base import CacheBundleIn
    from kernels import ForkedKernel
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    # Without times in the cells: the cache would take them for another notebook.
    settings = {"timeout": TIMEOUT, "record_timing": False, "kernel_manager_class": ForkedKernel}
    resources = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, resources=resources, **settings).execute()
    _cache().cache_notebook_bundle(
        CacheBundleIn(notebook, str(path)), check_validity=False, overwrite=True
    )


def execute_missing(source: Path) -> None:
    """Execute the notebooks of a folder whose outputs are not kept, one on each core at a time."""
    missing = [path for path in source.glob("*.ipynb") if not is_kept(path)]
    # Long ones first, so that none keeps one core busy alone at the end.
    missing.sort(key=lambda path: path.stat().st_size, reverse=True)
    if missing:
        with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
            list(pool.map(_execute_apart, missing))


def _execute_apart(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        execute(path, Path(folder))


def is_kept(path: Path) -> bool:
    """Whether the site finds the outputs of a notebook."""
    try:
        _cache().match_cache_notebook(nbformat.read(path, as_version=4))
    except KeyError:
        return False
    return True


def executed_one(path: Path) -> nbformat.NotebookNode:
    """A notebook with its outputs, which must be kept."""
    cache = _cache()
    found = cache.match_cache_notebook(nbformat.read(path, as_version=4))
    return cache.get_cache_bundle(found.pk).nb


def _cache() -> Any:
    # Here, since it takes long to import: fast tests ask for no notebook.
    from jupyter_cache import get_cache

    return get_cache(CACHE)
