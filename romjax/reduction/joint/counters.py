"""Which joints of a tree turn the angles that count full turns."""

import numpy as np

from ...assembly.assembled import AssembledSystem
from ...common.arrays import as_array
from ...common.errors import ReductionError
from ...scene.effect.joint_inertia import JointInertia
from ...scene.turn_counter import CounterJoint, TurnCounter
from .closing import some_joints
from .lift import Counters
from .spanning import GROUND, Spanning, frames_of
from .tree import Tree


def counters_of(
    full: AssembledSystem, tree: Tree, spanning: Spanning, before: Counters | None
) -> Counters | None:
    """The counters of a system, with the signs and offsets that they had `before`, if it has any.

    Raises ReductionError for an angle that no joint of the tree turns, and for counters that are
    the inertia of joints, which a tree of bodies has not.
    """
    if any(isinstance(group.effects, JointInertia) for group in full.effects):
        raise ReductionError(
            "reduce: JointCoordinates does not have the inertia of joints that JointInertia gives "
            "(the armature of robots): simulate the assembled system as it is, or reduce it by "
            "Minimal."
        )
    holding = [g for g, group in enumerate(full.joints) if isinstance(group.joints, CounterJoint)]
    if not holding:
        return None
    rows = tuple((g, row) for g in holding for row in range(len(full.joints[g].rows.rows)))
    counting = [x for x in full.bodies if isinstance(x.bodies, TurnCounter)]
    columns = [row[0] for group in counting for row in group.coordinates.rows]
    joints = some_joints(full, rows)
    assert joints.markers is not None
    numbers = {first: number for first, (number, _, _) in frames_of(full).items()}
    frames, angles = joints.markers.frames.array[:, 0].astype(int), list[int]()
    turning = _turning(tree, spanning)
    sides = [group.markers.take(frames)[:2] for group in joints.groups]
    pairs = [pair for a, b in sides for pair in zip(a.tolist(), b.tolist(), strict=True)]
    for pair, column in zip(pairs, columns, strict=True):
        bodies = frozenset(numbers.get(i, GROUND) for i in pair)
        if bodies not in turning:
            raise ReductionError(
                f"reduce: JointCoordinates cannot follow {full.structure.labels[column]}, which "
                "counts full turns between bodies that no hinge of the tree joins: simulate the "
                "assembled system as it is, or give the part a bearing between these bodies."
            )
        angles.append(turning[bodies])
    if before is not None:
        return Counters(joints, tuple(columns), tuple(angles), before.signs, before.offsets)
    ones = as_array(np.ones(len(columns)))
    return Counters(joints, tuple(columns), tuple(angles), ones, as_array(np.zeros(len(columns))))


def _turning(tree: Tree, spanning: Spanning) -> dict[frozenset[int], int]:
    """The coordinates that are angles about the z axes of joints, by the bodies that these join."""
    angles = {}
    for link in tree.links:
        names = [name for name, _ in link.joints.freedoms]
        if "angle" not in names:
            continue
        for place, row in zip(link.bodies, link.coordinates.rows, strict=True):
            branch = spanning.branches[place]
            angles[frozenset((branch.body, branch.parent))] = row[names.index("angle")]
    return angles
