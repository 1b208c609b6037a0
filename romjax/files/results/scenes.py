"""The scene of a run, and its text in a file of results."""

import tempfile
import warnings
from pathlib import Path
from typing import Any

from ...assembly.assemble import assemble
from ...common.errors import InputError
from ...integrate.trajectory import Trajectory
from ...scene.scene import Scene
from ...system.base import AbstractSystem
from ..scene_file import load_scene
from .fitting import listed


def scene_words(run: Trajectory, given: Scene | None) -> dict[str, str]:
    """The text of the scene, or why there is none; raises InputError for one that is `given` and is
    not that of the run, whose file could not be read.
    """
    # Here, since it loads what writes TOML, which `import romjax` does without.
    from ..write import text_of

    if given is None and run.t.ndim > 1:
        return {"scene_missing": "Runs of a batch have no scene in common; give one of them."}
    try:
        scene = run.scene if given is None else given
        labels = run.labels if given is None else assemble(given).structure.labels
        text = text_of(scene)
    except InputError as error:
        return {"scene_missing": str(error)}
    if labels != run.labels:
        raise InputError(
            f"Trajectory.to_xarray: scene has the coordinates {listed(labels)}, but the run "
            f"{listed(run.labels)}; give the scene that was simulated, or none."
        )
    return {"scene": text}


def system_of(dataset: Any) -> AbstractSystem | None:
    """The system of the text in a dataset; None without one, and, with a warning, of a text that
    makes no scene here, such as one with parts of one's own that were not imported.
    """
    text = dataset.attrs.get("scene")
    if text is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.toml"
        file.write_text(str(text), encoding="utf-8")
        try:
            return assemble(load_scene(file))
        except InputError as error:
            warnings.warn(f"load: the run has no scene here. {error}", stacklevel=4)
            return None
