"""From a scene to its system."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import jax.tree_util as jtu

from ..scene.effect.base import AbstractField, AbstractMarkerEffect
from ..scene.fields import SceneError, as_array
from ..scene.marker import Marker
from ..scene.scene import Scene
from .assembled import AssembledSystem, BodyGroup, EffectGroup, JointGroup
from .grouping import Index, group
from .kinematics import Markers, Slots, place_markers


def assemble(scene: Scene) -> AssembledSystem:
    """The system of a scene.

    Equal elements are stacked and traced once, whatever their number. Works under `jit`, `grad`
    and `vmap`, with respect to every number of the scene.

    Raises SceneError, naming the part and the remedy, for an empty scene, duplicate names, a
    marker on an unknown body, impossible numbers, or more constraints than coordinates.
    """
    scene.check()
    # A Python number that was put in by hand would be static and recompile at every change.
    scene = jtu.tree_map(as_array, scene)

    offsets, coordinates = 0, {}
    for body in scene.bodies:
        coordinates[body.name] = tuple(range(offsets, offsets + body.size))
        offsets += body.size
    bodies = []
    for stacked, places in group(scene.bodies):
        names = [scene.bodies[i].name for i in places]
        bodies.append(BodyGroup(stacked, Index.of([coordinates[name] for name in names])))

    named = {body.name: body for body in scene.bodies}

    def arrange(
        elements: Sequence[Any],
    ) -> tuple[list[tuple[Any, Slots, list[int]]], Markers | None]:
        """Groups of equal elements with the places of their markers, and all the markers."""
        groups, markers = [], list[Marker]()
        for stacked, places in group(elements):
            sides = list(zip(*(elements[i].markers for i in places), strict=True))
            groups.append((stacked, Slots(len(markers), len(places), len(sides)), places))
            markers += [marker for side in sides for marker in side]
        return groups, place_markers(markers, named, coordinates, offsets) if markers else None

    first_row = [0]
    for joint in scene.joints:
        first_row.append(first_row[-1] + joint.rows)
    joints, joint_markers = arrange(scene.joints)
    effects, effect_markers = arrange(
        [e for e in scene.effects if isinstance(e, AbstractMarkerEffect)]
    )
    starts = [body.start() for body in scene.bodies]
    if first_row[-1] > offsets:
        raise SceneError(
            f"The joints make {first_row[-1]} constraints on {offsets} coordinates: nothing could "
            "move. Take out the joints that repeat others."
        )
    return AssembledSystem(
        bodies=tuple(bodies),
        joints=tuple(
            JointGroup(stacked, slots, Index.of([range(*first_row[i : i + 2]) for i in places]))
            for stacked, slots, places in joints
        ),
        joint_markers=joint_markers,
        effects=tuple(EffectGroup(stacked, slots) for stacked, slots, _ in effects),
        effect_markers=effect_markers,
        fields=tuple(e for e in scene.effects if isinstance(e, AbstractField)),
        q0=jnp.concatenate([q for q, _ in starts]),
        v0=jnp.concatenate([v for _, v in starts]),
        labels=tuple(label for body in scene.bodies for label in body.labels()),
        modal=tuple(i >= 3 for body in scene.bodies for i in range(body.size)),
        constraint_labels=tuple(j.label() for j in scene.joints for _ in range(j.rows)),
    )
