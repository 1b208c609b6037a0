"""The model of a robot file as MuJoCo's own parser reads it, and what it leaves out."""

import re
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...common.errors import SceneFileError
from ...common.extras import extra
from .inspection import inspect
from .markup import Element, read
from .urdf import check_urdf
from .vocabulary import MJCF, URDF

# What to do, by what MuJoCo says.
_REMEDIES = {
    "must be larger than mjMINVAL": (
        "a joint moves what has no mass or no inertia; give it an <inertial>, or take its joint "
        "out, so that it is a part of the link before"
    ),
    "Error opening file": (
        "give the file, or an <inertial> to the link: then its mesh is a picture, and not read"
    ),
}


class Model(NamedTuple):
    """A robot file: MuJoCo's arrays, the elements of the file, what is left out, in words, and how
    many meshes that may touch something are pictures only.
    """

    mujoco: Any
    arrays: Any
    root: Element
    left_out: list[str]
    meshes: int

    @property
    def size(self) -> float:
        """The largest arm or radius of gyration of a link, in the file's unit of length, whichever
        that is; where the robot stands, and what stands there with it, does not count.
        """
        a = self.arrays
        moves = a.body_weldid > 0
        inertia, mass = np.max(a.body_inertia[moves], axis=1), a.body_mass[moves]
        gyration = np.sqrt(np.divide(inertia, mass, out=0 * mass, where=mass > 0))
        arms = np.concatenate([a.body_pos[moves[a.body_parentid]], a.body_ipos[moves]])
        return float(max(np.max(gyration), np.max(np.linalg.norm(arms, axis=1))))

    def name(self, kind: str, number: int) -> str:
        """The name of the body, joint, … of a number, "" if it has none."""
        name: str | None = self.mujoco.mj_id2name(
            self.arrays, getattr(self.mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), number
        )
        return name or ""

    def numbered(self, kind: str, number: int) -> str:
        """The name, or the kind with the number where there is none."""
        return self.name(kind, number) or f"{kind}{number}"

    def called(self, kind: str, number: int) -> str:
        """One of the elements as messages begin, with its line if it has a name."""
        name = self.name(kind, number)
        element = next((x for x in self.root.walk() if name and _is(x, kind, name)), None)
        place = element.place if element else str(self.root.path)
        return f"{place}: {kind} '{name or number}'"

    def refuse(self, kind: str, number: int, words: str) -> SceneFileError:
        """The error that one of the elements cannot be read."""
        return SceneFileError(f"{self.called(kind, number)}: {words}")


def _is(element: Element, kind: str, name: str) -> bool:
    kinds = {"body": ("body", "link"), "joint": ("joint", "freejoint")}.get(kind)
    wanted = kinds is None or element.tag in kinds
    return wanted and element.attributes.get("name") == name


def read_model(path: Path) -> Model:
    """The model of an MJCF or URDF file.

    Raises SceneFileError with file, line, element and remedy, and ImportError without MuJoCo.
    """
    mujoco = extra(f"load_scene({str(path)!r})", "mujoco", "robots")
    root = read(path)
    urdf = root.tag == "robot"
    if not urdf and root.tag != "mujoco":
        raise SceneFileError(
            f"{root.place}: {root.called()} begins neither MJCF (<mujoco>) nor URDF (<robot>); "
            "scene files of romjax end with .toml."
        )
    left_out = inspect(root, URDF if urdf else MJCF, extensible=urdf)
    if urdf:
        check_urdf(root)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        # Links that are fixed to others would lose their names.
        spec.compiler.fusestatic = False
        meshes = _drop_pictures(mujoco, spec)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            arrays = spec.compile()
        left_out += [f"{path}: {warning.message}" for warning in said]
    except ValueError as error:
        raise SceneFileError(_said(path, root, str(error))) from error
    return Model(mujoco, arrays, root, left_out, meshes)


def _drop_pictures(mujoco: Any, spec: Any) -> int:
    """Take out meshes of links that have their inertia by numbers: then they are pictures only,
    which take long to read, and often are not there. Returns how many of them may touch something.
    """
    if int(spec.compiler.inertiafromgeom) == int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE):
        return 0
    meshes = [
        geom
        for geom in spec.geoms
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH
        and (geom.parent.explicitinertial or geom.parent.name == "world")
    ]
    dropped = {geom.meshname for geom in meshes}
    touching = sum(bool(geom.contype or geom.conaffinity) for geom in meshes)
    for geom in meshes:
        spec.delete(geom)
    kept = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name in dropped - kept:
            spec.delete(mesh)
    return touching


def _said(path: Path, root: Element, words: str) -> str:
    """MuJoCo's message as one of romjax, with the line that it names."""
    text = " ".join(words.split()).removeprefix("XML Error: ").removeprefix("Error: ")
    line = re.search(r"line (\d+)", text)
    element = None if line else _named(root, text)
    place = f"{path}:{line[1]}" if line else element.place if element else str(path)
    end = "MuJoCo's reader says so, see its reference of the format"
    end = next((remedy for begin, remedy in _REMEDIES.items() if begin in text), end)
    return f"{place}: {text}; {end}."


def _named(root: Element, text: str) -> Element | None:
    """The element of the name, or with the file, that a message names."""
    named = re.search(r"[Ee]lement name '([^']+)'|joint '([^']+)'|file '([^']+)'", text)
    if not named:
        return None
    name = named[1] or named[2] or named[3]
    keys = ("file", "filename") if named[3] else ("name",)
    for element in root.walk():
        values = [element.attributes[key] for key in keys if key in element.attributes]
        # A message may say the whole path of a file.
        if name in values or (named[3] and any(name.endswith(Path(x).name) for x in values if x)):
            return element
    return None
