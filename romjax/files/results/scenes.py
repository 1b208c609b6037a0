"""The scene of a run, and its text in a file of results."""

from typing import Any

from ...assembly.disassemble import disassemble
from ...assembly.locate import assembled
from ...integrate.trajectory import Trajectory
from ...scene.scene import Scene
from ...system.base import AbstractSystem


def scene_of(run: Trajectory) -> Scene:
    """The scene of the system that moved."""
    return disassemble(assembled("Trajectory.scene", run.system))


def text_of(run: Trajectory, scene: Scene | None) -> str:
    """The text of the scene; empty where there is none."""
    del run, scene
    return ""


def system_of(dataset: Any) -> AbstractSystem | None:
    """The system of the text in a dataset; None without one."""
    del dataset
    return None
