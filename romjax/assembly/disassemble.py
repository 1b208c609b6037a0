"""The scene that a system was assembled from, with the numbers of the system."""

import itertools
from collections.abc import Callable
from typing import Any

import jax.tree_util as jtu

from ..common.arrays import as_arrays, pick
from ..scene.marker import GROUND, Marker
from ..scene.placing import from_centre
from ..scene.scene import Scene
from .assembled import AssembledSystem
from .counting import without_counters
from .grouping import member, with_name, with_points
from .groups import EffectGroup, JointGroup
from .kinematics import Markers


def disassemble(system: AssembledSystem) -> Scene:
    """The bodies, joints and effects of a system, with the numbers that it holds.

    `assemble` makes the same system of them, but for a start (`q0`, `v0`) that was set since.
    """
    labels = [coordinate.owner for coordinate in system.structure.coordinates]
    bodies = {}
    for group in without_counters(system.bodies):
        for row, columns in enumerate(group.coordinates.rows):
            # Inside compiled programs nothing has a name.
            name = labels[columns[0]] or f"body {columns[0]}"
            bodies[columns[0]] = with_name(member(group.bodies, row), name)

    for key, points in zip(sorted(bodies), system.points, strict=False):
        bodies[key] = with_points(bodies[key], points)

    # Joints and effects are named in the order of their groups.
    joints, effects = {}, list[Any](system.fields)
    names = itertools.chain(system.structure.joints, itertools.repeat(""))
    for joined in without_counters(system.joints):
        mark = _marking(joined, system.joint_markers, bodies)
        for row, rows in enumerate(joined.rows.rows):
            joints[rows[0]] = _named(mark(member(joined.joints, row), row), next(names))
    names = itertools.chain(system.structure.effects, itertools.repeat(""))
    for acting in system.effects:
        mark = _marking(acting, system.effect_markers, bodies)
        for row in range(acting.markers.count):
            effects.append(_named(mark(member(acting.effects, row), row), next(names)))
    effects += [controller.sampled for controller in system.controllers]
    scene = Scene(_in_order(bodies), _in_order(joints), effects)
    return as_arrays(scene)


def _in_order(parts: dict[int, Any]) -> list[Any]:
    return [parts[key] for key in sorted(parts)]


def _marking(
    group: JointGroup | EffectGroup, markers: Markers | None, bodies: dict[int, Any]
) -> Callable[[Any, int], Any]:
    """Return a function that puts the markers of an element of a group on their `bodies`, which are
    by their first coordinates.
    """
    assert markers is not None
    blocks, known = group.markers, markers

    def mark(element: Any, row: int) -> Any:
        numbers = iter(range(blocks.start + row, len(known.turns), blocks.count))

        def put(leaf: Any) -> Any:
            if not isinstance(leaf, Marker):
                return leaf
            number = next(numbers)
            body = bodies.get(known.frames.rows[number][0])
            point, turn = pick(known.points, number), pick(known.turns, number)
            # Points are kept from the origin of the coordinates, markers give them in the frame.
            if body is not None and body.centre is not None:
                point = from_centre(point, body.centre, sign=-1)
            return Marker(GROUND if body is None else body.name, point, turn)

        return jtu.tree_map(put, element, is_leaf=lambda x: isinstance(x, Marker))

    return mark


def _named(element: Any, name: str) -> Any:
    return with_name(element, name) if hasattr(element, "name") else element
