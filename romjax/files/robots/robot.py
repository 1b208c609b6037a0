"""Robots of MJCF and URDF files as scenes."""

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...common.checks import unknown_name
from ...common.errors import SceneError
from ...common.extras import extra
from ...scene.effect.gravity import Gravity
from ...scene.scene import Scene
from ...scene.signal import AbstractSignal
from .actuators import actuators
from .connections import equalities, tendons
from .contacts import contacts, contacts_left_out
from .joints import Joints
from .model import Model, read_model
from .passive import passive
from .tree import Tree

# Constraints that are violated by less hold [m], [rad].
_HOLDS = 1e-9


class Robot(NamedTuple):
    """A robot of a file.

    - `scene`, `title`: as the file places it, and what it is called.
    - `closed`: whether the constraints besides its joints hold there.
    - `size`: of its largest link [m].
    - `left_out`: what the scene has not, in words.
    """

    scene: Scene
    title: str
    closed: bool
    size: float
    left_out: tuple[str, ...]


def read_robot(
    path: Path,
    start: str = "",
    signals: Mapping[str, AbstractSignal] | None = None,
    touching: bool = False,
) -> Robot:
    """The robot of an MJCF or URDF file, with the contacts of its geoms if they are `touching`; see
    `load_scene`.

    Raises SceneFileError for what is refused, and SceneError for an unknown start or signal.
    """
    with _heard(path) as warned:
        robot = _read(path, start, signals or {}, touching)
    said = (*robot.left_out, *warned)
    return robot._replace(left_out=tuple(dict.fromkeys(said)))


@contextlib.contextmanager
def _heard(path: Path) -> Iterator[list[str]]:
    """Collect what MuJoCo warns of, which it would write to a file in the working directory."""
    mujoco = extra(f"load_scene({str(path)!r})", "mujoco", "robots")
    warned = list[str]()
    mujoco.set_mju_user_warning(lambda words: warned.append(f"{path}: {words}"))
    try:
        yield warned
    finally:
        mujoco.set_mju_user_warning(None)


def _read(path: Path, start: str, signals: Mapping[str, AbstractSignal], touching: bool) -> Robot:
    model = read_model(path)
    data = _started(model, start)
    tree = Tree(model, data)
    if not tree.bodies:
        raise model.refuse("body", 0, "no body can move; give one a joint.")
    joints = Joints(model, tree, data.qpos)
    joined = [*joints.joints, *equalities(model, tree, joints.measured)]
    effects = [
        *_gravity(model),
        *passive(model, joints.measured),
        *tendons(model, tree),
        *actuators(model, tree, joints.measured, signals, data),
        *(contacts(model, tree) if touching else ()),
    ]
    if not touching:
        model.left_out.extend(contacts_left_out(model, asked=False))
    scene = Scene(tree.bodies, joined, effects)
    title = model.root.attributes.get("model") or model.root.attributes.get("name") or path.stem
    return Robot(scene, title, _holds(model, data), model.size, tuple(model.left_out))


def _started(model: Model, start: str) -> Any:
    """MuJoCo's data at the start, a keyframe or the configuration of the file."""
    mujoco, arrays = model.mujoco, model.arrays
    data = mujoco.MjData(arrays)
    known = {model.numbered("key", i): i for i in range(arrays.nkey)}
    if start and start not in known:
        raise SceneError(str(unknown_name(str(model.root.path), "keyframe", start, list(known))))
    if start:
        mujoco.mj_resetDataKeyframe(arrays, data, known[start])
    mujoco.mj_fwdPosition(arrays, data)
    mujoco.mj_comVel(arrays, data)
    return data


def _holds(model: Model, data: Any) -> bool:
    """Whether the equality constraints hold."""
    equality = np.asarray(data.efc_type) == int(model.mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    return not np.any(np.abs(np.asarray(data.efc_pos)[equality]) > _HOLDS)


def _gravity(model: Model) -> list[Gravity]:
    arrays = model.arrays
    off = arrays.opt.disableflags & int(model.mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    down = np.array(arrays.opt.gravity)
    return [] if off or not np.any(down) else [Gravity(tuple(float(x) for x in down))]
