"""Assembly of the system of a scene."""

import itertools
from collections.abc import Sequence
from typing import Any

from ..common.arrays import as_arrays, concatenate
from ..common.checks import check_kind
from ..common.errors import SceneError
from ..linalg.indexing import Index
from ..linalg.pattern import Pattern
from ..scene.body.base import AbstractBody
from ..scene.effect.base import AbstractField, AbstractMarkerEffect
from ..scene.effect.sampled import Sampled
from ..scene.joint.base import AbstractJoint
from ..scene.marker import GROUND
from ..scene.placing import marker_start
from ..scene.points import NamedPoints
from ..scene.scene import Scene, markers_of
from ..scene.state_carrier import StateCarrier
from ..system.mobility import check_mobility
from ..system.structure import Structure
from .assembled import AssembledSystem
from .body_group import BodyGroup
from .controllers import Controller, check_held, check_measured
from .counting import carriers_of, counters_of, with_counter_starts
from .grouping import group, points_of
from .groups import EffectGroup, JointGroup
from .kinematics import arrange, columns_of
from .names import unique

# Coordinates from which on implicit steps take less time with derivatives by parts: below, a single
# program that is pushed as a whole is as fast as several. Whole / by parts: 0.8 for 18 coordinates
# of beams, 0.95 for 21 of a loop in space, 1.8 for 24 of a chain, 1.4 for 35 of a loop.
_BY_PARTS = 24


def assemble(scene: Scene) -> AssembledSystem:
    """The system of a `scene`.

    Equal elements are stacked and traced once, whatever their number. Works under `jit`, `grad`
    and `vmap`, with respect to every number of the scene.

    Raises SceneError, naming the part and the remedy, for an empty scene, duplicate names, a
    marker on an unknown body, impossible numbers, or joints that leave no motion.
    """
    check_kind("assemble", "the scene", scene, Scene, "a romjax.Scene of bodies and joints")
    scene.check()
    check_held(scene)
    scene = _begun(scene)

    acting = [e for e in scene.effects if isinstance(e, AbstractMarkerEffect)]
    clocks = [e for e in scene.effects if isinstance(e, Sampled)]
    keys = [unique([part.label() for part in parts]) for parts in (scene.joints, acting, clocks)]
    parts, names = (*scene.joints, *acting, *clocks), unique([x for own in keys for x in own])
    carriers, sides = carriers_of(parts, names, scene.dimension)
    counters, holding, sides = counters_of(parts, names, sides)
    every_body, every_joint = (*scene.bodies, *carriers, *counters), (*scene.joints, *holding)
    joined_sides = [*sides[: len(scene.joints)], *(joint.markers for joint in holding)]

    columns, n = columns_of(every_body)
    bodies, order = _groups(every_body, columns)
    named = {body.name: body for body in every_body}
    rows, joined = _connections(every_joint, order)
    joints, joint_markers = arrange(every_joint, joined_sides, named, columns, n)
    effects, effect_markers = arrange(acting, sides[len(scene.joints) :], named, columns, n)
    q0, v0 = (concatenate(each) for each in zip(*(b.start() for b in every_body), strict=True))
    system = AssembledSystem(
        bodies=tuple(bodies),
        joints=tuple(
            JointGroup(stacked, markers, Index.of([rows[i] for i in members]))
            for stacked, markers, members in joints
        ),
        joint_markers=joint_markers,
        effects=tuple(EffectGroup(stacked, markers) for stacked, markers, _ in effects),
        effect_markers=effect_markers,
        fields=tuple(e for e in scene.effects if isinstance(e, AbstractField)),
        q0=q0,
        v0=v0,
        structure=Structure(
            coordinates=tuple(c for body in every_body for c in body.coordinates()),
            constraints=tuple(f"joint '{j.label()}'" for j in every_joint for _ in range(j.rows)),
            rigid=tuple(rigid for body in every_body for rigid in _is_rigid(body)),
            flexible=any(body.modes for body in scene.bodies),
            ringing=all(b.bends and not b.damped for b in scene.bodies if b.modes),
            loops=_merged(scene, scene.joints)[1],
            connected=_merged(scene, [*scene.joints, *scene.effects], without=GROUND)[0] == 1,
            contacts=any(effect.begins for effect in acting),
            by_parts=n >= _BY_PARTS and not _slips(every_joint, rows),
            frames=tuple(columns[body.name][0] for body in scene.bodies),
            quaternions=tuple(columns[b.name][3] for b in scene.bodies if b.dimension == 3),
            counters=tuple(columns[counter.name][0] for counter in counters),
            states=tuple(columns[carrier.name][0] for carrier in carriers),
            slips=_slips(every_joint, rows),
            joints=tuple(keys[0][i] for *_, members in joints for i in members if i < len(keys[0])),
            effects=tuple(keys[1][i] for *_, members in effects for i in members),
        ),
        pattern=Pattern.of([columns[name] for name in order], joined),
        controllers=_controllers(clocks, carriers, columns),
        points=_points(scene.bodies),
    )
    check_measured(system.controllers, system.structure.labels)
    system = with_counter_starts(system) if counters else system
    check_mobility("assemble", system, "Take out the joints that lock the mechanism.", SceneError)
    return system


def _groups(
    bodies: Sequence[AbstractBody], columns: dict[str, tuple[int, ...]]
) -> tuple[list[BodyGroup], list[str]]:
    """Groups of equal bodies, and the names of these in their order."""
    groups, order = [], list[str]()
    for stacked, members in group(bodies):
        names = [bodies[i].name for i in members]
        groups.append(BodyGroup(stacked, Index.of([columns[name] for name in names])))
        order += names
    return groups, order


def _points(bodies: Sequence[AbstractBody]) -> tuple[NamedPoints, ...]:
    """The named points of all bodies; none where no body has any."""
    points = tuple(points_of(body) for body in bodies)
    return points if any(each.names for each in points) else ()


def _controllers(
    clocks: Sequence[Sampled],
    carriers: Sequence[StateCarrier],
    columns: dict[str, tuple[int, ...]],
) -> tuple[Controller, ...]:
    """The controllers, whose carriers come last."""
    controllers, first = [], len(carriers) - sum(len(each.states) for each in clocks)
    for each in clocks:
        own = carriers[first : first + len(each.states)]
        controllers.append(Controller(each, tuple(columns[carrier.name][0] for carrier in own)))
        first += len(own)
    return tuple(controllers)


def _is_rigid(body: AbstractBody) -> list[bool]:
    """Mark the coordinates of a body that describe its rigid motion; a state has none."""
    frame = 0 if isinstance(body, StateCarrier) else body.frame_size
    return [i < frame for i in range(body.size)]


def _begun(scene: Scene) -> Scene:
    """The scene in arrays, with what joints take from where their markers are at the start."""
    # A Python number that was put in by hand would be static and recompile at every change.
    scene = as_arrays(scene)
    bodies = {body.name: body for body in scene.bodies}
    joints = [
        joint.starting_at(*(marker_start(bodies, marker) for marker in joint.markers))
        if joint.takes_start
        else joint
        for joint in scene.joints
    ]
    return Scene(scene.bodies, joints, scene.effects)


def _slips(joints: Sequence[AbstractJoint], rows: Sequence[range]) -> tuple[int, ...]:
    """The constraints that hold velocities. Derivatives of such rows by parts are not those along
    the motion, as they are of functions of positions.
    """
    return tuple(own[k] for joint, own in zip(joints, rows, strict=True) for k in joint.slips)


def _connections(
    joints: Sequence[AbstractJoint], order: list[str]
) -> tuple[list[range], list[tuple[list[int], range]]]:
    """The rows of each joint; and the bodies that it connects, by their place in `order`, with
    them.
    """
    ends = itertools.accumulate((joint.rows for joint in joints), initial=0)
    rows = [range(*pair) for pair in itertools.pairwise(ends)]
    held = [{order.index(m.body) for m in joint.markers if m.body != GROUND} for joint in joints]
    return rows, [(sorted(bodies), own) for bodies, own in zip(held, rows, strict=True)]


def _merged(scene: Scene, parts: Sequence[Any], without: str = "") -> tuple[int, bool]:
    """How many groups of bodies are left, the ground among them unless it is what they are
    `without`, once each of the `parts` links what it is on; and whether one links what others do.
    """
    names = {GROUND, *(body.name for body in scene.bodies)} - {without}
    trees, closes = {name: name for name in names}, False

    def root(name: str) -> str:
        while trees[name] != name:
            name = trees[name]
        return name

    for part in parts:
        on = [marker.body for marker, _ in markers_of(part) if marker.body in names]
        for other in on[1:]:
            a, b = root(on[0]), root(other)
            closes |= a == b
            trees[a] = b
    return sum(trees[name] == name for name in names), closes
