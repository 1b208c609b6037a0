"""Scene files: read once, they make scenes of any values of their parameters."""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..assembly.closing import consistent_scene
from ..common.errors import InputError, SceneFileError
from ..scene.scene import Scene
from .build import Builder
from .parameters import check_given, free_parameters, resolve_parameters
from .problems import Problems
from .settings import Settings
from .toml import read_tables
from .versions import check_version

__all__ = ["SceneFile", "load_scene", "scene_file"]


class SceneFile:
    """A scene file that was read: a function of its parameters, by name, that returns a `Scene`.

    **Arguments:** the `path` of the file. Attributes:

    - `parameters`: the values in the file, floats or arrays.
    - `title`, `settings`: what it says of itself and of its run. `text`: all of it.
    """

    path: Path
    text: str
    title: str
    parameters: dict[str, Any]
    settings: Settings

    def __init__(self, path: str | os.PathLike[str]):
        self.path = Path(path)
        problems = Problems(self.path)
        self._tables, self._scene = _checked(problems)
        self.text = problems.text
        self.title = self._tables.get("title", f"from {self.path}")
        self.parameters = free_parameters(self._tables.get("parameters", {}))
        self.settings = Settings.of(self._tables.get("run", {}))

    def __call__(self, **parameters: Any) -> Scene:
        """The scene of some parameters, those of the file unless given; they may be traced.

        Raises InputError for a parameter that the file does not have or of another shape, and
        SceneFileError for values that make no scene.
        """
        scene = self.placed(**parameters)
        return self.closed(scene) if self.consistent else scene

    @property
    def consistent(self) -> bool:
        """Whether the file says `consistent = true`."""
        return bool(self._tables.get("consistent"))

    def placed(self, **parameters: Any) -> Scene:
        """The scene with its bodies where the file places them, whether all joints hold there or
        not; else as by a call.
        """
        wrong = check_given(str(self.path), parameters, self.parameters)
        if wrong:
            raise InputError(wrong)
        if not parameters:
            return self._scene
        problems = Problems(self.path, self.text)
        scene = _build(self._tables, problems, self.parameters | parameters)
        problems.raise_any()
        return scene

    def closed(self, scene: Scene) -> Scene:
        """`consistent_scene` of a scene of this file; raises SceneFileError where it fails."""
        try:
            return consistent_scene(scene)
        except InputError as error:
            raise self.wrong(error) from error

    def wrong(self, error: InputError) -> SceneFileError:
        """The error of joints or speeds that do not fit each other, with the line of one."""
        place: tuple[str, ...] = ("joints",)
        if joint := re.search(r"joint '(.*?)' is still", str(error)):
            place = ("joints", joint[1])
        elif speed := re.search(r"(\w+) of body '(.*?)' is", str(error)):
            place = ("bodies", speed[2], speed[1])
        problems = Problems(self.path, self.text)
        problems.add(place, str(error))
        return SceneFileError("\n".join(problems.lines()))

    def __repr__(self) -> str:
        return f"SceneFile({str(self.path)!r}, parameters={self.parameters})"


def scene_file(path: str | os.PathLike[str]) -> SceneFile:
    """The function of parameters that the scene file of a `path` is: for `Box`, `fit`, `grad`, …

    ```python
    make = rj.scene_file("crank.toml")
    box = rj.Box(make, length=(0.2, 0.4))
    slope = jax.grad(lambda p: loss(make(**p)))(make.parameters)
    ```

    Raises SceneFileError, with all mistakes of the file, each with its line, key and remedy.
    """
    return SceneFile(path)


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """The scene of the file of a `path`, such as one that `scene.save` has written.

    Raises SceneFileError, with all mistakes of the file, each with its line, key and remedy.
    """
    return SceneFile(path)()


def _checked(problems: Problems) -> tuple[dict[str, Any], Scene]:
    """The tables of a file and their scene; raises for what the schema or the parts refuse."""
    tables = read_tables(problems)
    check_version(tables, problems)
    problems.raise_any()
    # Here, since it loads pydantic, which takes longer than a small scene.
    from .schema import validate

    validate(tables, problems)
    wrong = problems.touch(("parameters",))
    free = {} if wrong else free_parameters(tables.get("parameters", {}))
    scene = _build(tables, problems, free)
    if not problems.touch(("run",)):
        try:
            Settings.of(tables.get("run", {}))
        except InputError as error:
            problems.add(("run", str(error).split()[0]), f"{str(error)[0].upper()}{str(error)[1:]}")
    problems.raise_any()
    return tables, scene


def _build(tables: Mapping[str, Any], problems: Problems, given: Mapping[str, Any]) -> Scene:
    """The scene of tables; of no meaning if there are mistakes."""
    wrong = problems.touch(("parameters",))
    values = {} if wrong else resolve_parameters(tables.get("parameters", {}), given, problems)
    return Builder(tables, values, problems).scene()
