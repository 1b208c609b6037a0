"""Arrays in files beside the scene file: of NumPy (.npz, .npy), SciPy (.npz) or Matrix Market."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..common.errors import SceneError
from .problems import unknown

_SPARSE = "format"  # what SciPy's files of a sparse matrix have among their arrays


def read_array(folder: Path, table: Mapping[str, str]) -> Any:
    """The array that a table { file = "…", array = "…" } names; the path is relative to `folder`.

    Raises SceneError, with the remedy, where there is none.
    """
    path = folder / table["file"]
    if not path.is_file():
        raise SceneError(f"There is no file {path}; paths are relative to the scene file.")
    try:
        return _read(path, table.get("array"))
    except SceneError:
        raise
    except Exception as error:  # whatever a broken file makes a reader do
        words = str(error).split("\n")[0]
        raise SceneError(f"The file {path} cannot be read: {words}. Write it again.") from error


def _read(path: Path, name: str | None) -> Any:
    if path.suffix == ".mtx":
        import scipy.io  # here, since few ask for it

        return scipy.io.mmread(path, spmatrix=False)
    if path.suffix == ".npy":
        return np.load(path, allow_pickle=False)
    with np.load(path, allow_pickle=False) as arrays:
        if name is None and _SPARSE in arrays:
            import scipy.sparse  # here, since few ask for it

            return scipy.sparse.load_npz(path)
        if name is None:
            raise SceneError(f"Which array of {path.name}? Add array = …: {', '.join(arrays)}.")
        if name not in arrays:
            raise SceneError(f"In {path.name}: {unknown('array', name, list(arrays))}")
        return arrays[name]
