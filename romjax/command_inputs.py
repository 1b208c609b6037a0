"""Inputs of commands: scenes by name or file, and folders to write to."""

import runpy
import tempfile
from pathlib import Path

from .common import writing
from .common.errors import SceneError
from .files.scene_file import SUFFIXES, SceneFile, scene_file
from .files.settings import solver_of
from .gallery.catalogue import Example, find
from .scene.scene import Scene


def load(name: str) -> Example:
    """A ready scene by name, a scene file, or the `scene` that a Python file defines."""
    if name.lower().endswith((".toml", *SUFFIXES)):
        return _of_file(scene_file(name))
    if not name.endswith(".py"):
        return find(name)
    path = Path(name)
    if not path.is_file():
        raise SceneError(f"There is no file {path}; give a Python file that defines `scene`.")
    scene = runpy.run_path(str(path)).get("scene")
    if callable(scene) and not isinstance(scene, Scene):
        scene = scene()
    if not isinstance(scene, Scene):
        raise SceneError(
            f"{path} defines no `scene`; it must hold a romjax.Scene of that name, or a function "
            "of that name that returns one."
        )
    return Example(path.stem, f"from {path}", lambda: scene)


def _of_file(file: SceneFile) -> Example:
    run = file.settings
    return Example(
        file.path.stem,
        file.title,
        file,
        end=run.end,
        rate=run.rate,
        pod_rank=run.pod_rank,
        sod_rank=run.sod_rank,
        rtol=run.rtol,
        solver=solver_of(run.solver),
    )


def writable(folder: Path) -> Path:
    """The folder, made if need be, without what commands that were killed have left of their files;
    raises OSError with a remedy before any work is done.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        writing.forget_parts(folder)
    except OSError as error:
        raise OSError(
            f"Cannot write to the folder {folder}: {error.strerror}; choose another with --out."
        ) from error
    return folder
