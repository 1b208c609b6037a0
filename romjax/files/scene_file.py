"""Scene files: read once, they make scenes of any values of their parameters; and robot files."""

import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..assembly.closing import consistent_scene
from ..common import files
from ..common.errors import InputError, SceneFileError
from ..scene.scene import Scene
from ..scene.signal import AbstractSignal
from .build import Builder
from .parameters import check_given, free_parameters, resolve_parameters
from .problems import Problems
from .schema import validate
from .settings import Settings
from .starts import moves
from .toml import read_tables
from .versions import check_version

__all__ = ["SceneFile", "load_scene", "scene_file"]

# Files of robots.
SUFFIXES = (".xml", ".mjcf", ".urdf")
# A warning has so many lines at most: more hide what comes before.
_LISTED = 8


@files.save.register(Scene)
def _save_scene(scene: Scene, path: str | os.PathLike[str]) -> None:
    # Here, since most runs load nothing that writes TOML or MJCF.
    from .robots.export import save_mjcf
    from .write import save

    is_robot = Path(path).suffix.lower() in (".xml", ".mjcf")
    (save_mjcf if is_robot else save)(scene, path)


class SceneFile:
    """A scene file that was read: a function of its parameters, by name, that returns a `Scene`.

    **Arguments:** the `path` of the file; of a robot file, which has no parameters, also `start`,
    `signals` and `contacts` as in `load_scene`. Attributes:

    - `parameters`: the values in the file, floats or arrays.
    - `title`, `settings`: what it says of itself and of its run. `text`: all of it.
    - `left_out`: what a robot file has and the scene has not, in words with lines.
    """

    path: Path
    text: str
    title: str
    parameters: dict[str, Any]
    settings: Settings
    left_out: tuple[str, ...]

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        start: str = "",
        signals: Mapping[str, AbstractSignal] | None = None,
        contacts: bool = False,
    ):
        self.path, self.left_out = Path(path), ()
        self._size: float | None = None
        if self.path.suffix.lower() in SUFFIXES:
            # Here, since few scenes are robots.
            from .robots.robot import read_robot

            robot = read_robot(self.path, start, signals, contacts)
            self._tables: dict[str, Any] = {"title": robot.title, "consistent": not robot.closed}
            self._scene, self._size, self.text = robot.scene, robot.size, ""
            self.left_out = robot.left_out
        elif start or signals or contacts:
            raise InputError(
                f"{self.path}: start, signals and contacts are those of robot files "
                f"({', '.join(SUFFIXES)}); a scene file has them in itself."
            )
        else:
            problems = Problems(self.path)
            self._tables, self._scene = _checked(problems)
            self.text = problems.text
        self.title = self._tables.get("title", f"from {self.path}")
        self.parameters = free_parameters(self._tables.get("parameters", {}))
        self.settings = Settings.of(self._tables.get("run", {}))

    def __call__(self, **parameters: Any) -> Scene:
        """The scene of some parameters, those of the file unless given; they may be traced.

        Of a robot whose loops do not hold where it begins, a warning tells what moves.

        Raises InputError for a parameter that the file does not have or of another shape, and
        SceneFileError for values that make no scene.
        """
        return self._made(**parameters)

    def _made(self, **parameters: Any) -> Scene:
        placed = self.placed(**parameters)
        if not self.consistent:
            return placed
        scene = self.closed(placed)
        # A scene file says itself that bodies may move.
        if self._size is not None and (told := moves(placed, scene, self._size)):
            warnings.warn(
                f"{self.path}: its loops do not hold where it begins, so that bodies have moved: "
                f"{told}. Give a start at which they hold, unless this is the one that you mean.",
                stacklevel=3,
            )
        return scene

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
        kind, _, name = error.part.removesuffix("'").partition(" '")
        place = {"joint": ("joints", name), "body": ("bodies", name, error.field)}.get(kind)
        problems = Problems(self.path, self.text)
        problems.add(place or ("joints",), str(error))
        return SceneFileError("\n".join(problems.lines()))

    def __repr__(self) -> str:
        return f"SceneFile({str(self.path)!r}, parameters={self.parameters})"


def scene_file(
    path: str | os.PathLike[str],
    *,
    start: str = "",
    signals: Mapping[str, AbstractSignal] | None = None,
    contacts: bool = False,
) -> SceneFile:
    """The function of parameters that the scene file of a `path` is: for `Box`, `fit`, `grad`, …

    **Arguments:**

    - `path`: of the file; that of a robot (.xml, .mjcf, .urdf) makes a function without parameters,
      whose `left_out` lists what the scene has not.
    - `start`, `signals`, `contacts`: of a robot, as in `load_scene`.

    ```python
    make = rj.scene_file("crank.toml")
    box = rj.Box(make, length=(0.2, 0.4))
    slope = jax.grad(lambda p: loss(make(**p)))(make.parameters)
    ```

    Raises SceneFileError, with all mistakes of the file, each with its line, key and remedy.
    """
    return SceneFile(path, start=start, signals=signals, contacts=contacts)


def load_scene(
    path: str | os.PathLike[str],
    *,
    start: str = "",
    signals: Mapping[str, AbstractSignal] | None = None,
    contacts: bool = False,
) -> Scene:
    """The scene of the file of a `path`, such as one that `scene.save` has written, or of a robot
    in MJCF or URDF (.xml, .mjcf, .urdf; extra `robots`).

    Of robots all is exact: loops are closed by constraints, mimicking joints by a `Coupling`. A
    body has the frame of its link, with the centre of mass at `com`; sites and links that are fixed
    to it are points by name. What the scene cannot have is refused with its line, or listed by a
    warning where it can be left out.

    **Arguments:**

    - `path`: of the file.
    - `start`: the name of a keyframe of a robot, at which it begins; as the file places it unless
      given. Where loops do not hold there, a warning tells what moves to close them.
    - `signals`: of a robot, by the names of its actuators, or of joints without one, which then
      have a motor; constant at the control of the start, or at zero, unless given.
    - `contacts`: whether spheres and capsules of a robot touch planes and spheres, where the file
      lets them; no geom touches anything unless it says so.

    Raises SceneFileError, with all mistakes of the file, each with its line, key and remedy, and
    ImportError for a robot where MuJoCo is not installed.
    """
    file = SceneFile(path, start=start, signals=signals, contacts=contacts)
    if file.left_out:
        _warn_of(file)
    return file._made()


def _warn_of(file: SceneFile) -> None:
    """Say what is left out, in one warning."""
    shown = list(file.left_out[:_LISTED])
    if len(file.left_out) > _LISTED:
        shown.append(f"and {len(file.left_out) - _LISTED} more, see `romjax check {file.path}`")
    warnings.warn(f"load_scene: left out: {'; '.join(shown)}.", stacklevel=3)


def _checked(problems: Problems) -> tuple[dict[str, Any], Scene]:
    """The tables of a file and their scene; raises for what the schema or the parts refuse."""
    tables = read_tables(problems)
    check_version(tables, problems)
    problems.raise_any()
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
