"""The joints of a tree that move the counters: angles with full turns, and rotors."""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...common.arrays import as_array, concatenate, concrete, pick
from ...common.errors import ReductionError
from ...compiling.program import program_once
from ...scene.effect.joint_inertia import JointInertia
from ...scene.turn_counter import CounterJoint, TurnCounter
from .closing import some_joints
from .lift import Counters, TreeLift
from .spanning import GROUND, Spanning, frames_of
from .tree import Tree

# Motions that are coordinates of joints, by the names that these give them.
_COORDINATES = {
    "angle": "angle",
    "bounded angle": "angle",
    "travel": "travel",
    "1 of 2": "angle of b",
    "2 of 2": "angle of a",
}
# How far the slope of a rotor's motion may be from that of one coordinate.
_SLOPE = 1e-6


def counters_of(
    full: AssembledSystem, tree: Tree, spanning: Spanning, before: Counters | None
) -> Counters | None:
    """The counters of a system, with the signs and offsets that they had `before`, if it has any.

    Raises ReductionError for one that no joint of the tree moves.
    """
    holding = [g for g, group in enumerate(full.joints) if isinstance(group.joints, CounterJoint)]
    if not holding:
        return None
    rows = tuple((g, row) for g in holding for row in range(len(full.joints[g].rows.rows)))
    joints = some_joints(full, rows)
    assert joints.markers is not None
    frames = joints.markers.frames.array[:, 0].astype(int)
    # A counter follows the joint between the two bodies whose turn it counts.
    moving, numbers = _moving(tree, spanning), _numbers(full)
    columns, followed, turning = list[int](), list[int](), list[bool]()
    for group in joints.groups:
        holder: Any = group.joints
        motion, sides = holder.motion, group.markers.take(frames)
        for a, b, column in zip(*(side.tolist() for side in sides), strict=True):
            bodies = frozenset(numbers.get(i, GROUND) for i in (a, b))
            place = moving.get((bodies, _COORDINATES.get(motion, "")))
            if place is None:
                raise _lost(full, column)
            columns.append(column)
            followed.append(place)
            turning.append(_COORDINATES[motion] == "angle")
    rotors = tuple(i for i, column in enumerate(columns) if column in set(_rotors(full)))
    groups = [group for group in full.bodies if isinstance(group.bodies, TurnCounter)]
    order = [row[0] for group in groups for row in group.coordinates.rows]
    kinds: list[Any] = [group.bodies for group in groups]
    every = concatenate([each.inertia for each in kinds])
    # Counters are stored by groups, and looked up by their column in q.
    inertias = pick(every, np.array([order.index(columns[i]) for i in rotors], int))
    signs, offsets = as_array(np.ones(len(columns))), as_array(np.zeros(len(columns)))
    if before is not None:
        signs, offsets = before.signs, before.offsets
    return Counters(
        joints,
        tuple(columns),
        tuple(followed),
        tuple(turning),
        signs,
        offsets,
        rotors,
        inertias,
    )


def check_rotors(full: AssembledSystem, lift: TreeLift, z: Float[Array, " n"]) -> None:
    """Raise ReductionError where the motion of a rotor depends on more than the coordinate of its
    joint, or not as much as that changes: its inertia would not be that of the coordinate.
    """
    count = lift.counters
    slopes = None if count is None or not count.rotors else concrete(_slopes(lift, z))
    if count is None or slopes is None:
        return
    for i in count.rotors:
        other = np.abs(slopes[i])
        other[count.followed[i]] -= 1
        if np.max(np.abs(other)) > _SLOPE:
            raise _lost(full, count.columns[i])


@program_once
def _slopes(lift: TreeLift, z: Float[Array, " n"]) -> Float[Array, "counters n"]:
    count = lift.counters
    assert count is not None
    slopes: Array = jax.jacfwd(lambda z: count.residual(lift, z))(jnp.asarray(z))
    return slopes


def _lost(full: AssembledSystem, column: int) -> ReductionError:
    part = full.structure.coordinates[column].owner
    return ReductionError(
        f"reduce: JointCoordinates cannot have the {part}, whose motion is the coordinate of no "
        "joint of the tree: not of ball joints, whose coordinates are quaternions, nor of joints "
        "that close loops. Simulate the assembled system as it is, or give the part the markers of "
        "a hinge or a slider of the tree."
    )


def _numbers(full: AssembledSystem) -> dict[int, int]:
    """The bodies by their first coordinates."""
    return {first: number for first, (number, _, _) in frames_of(full).items()}


def _rotors(full: AssembledSystem) -> Iterator[int]:
    """The columns of the counters that are the inertia of joints."""
    for group in full.effects:
        if isinstance(group.effects, JointInertia):
            assert full.effect_markers is not None
            frames = full.effect_markers.frames.array[:, 0].astype(int)
            yield from group.markers.take(frames)[2].tolist()


def _moving(tree: Tree, spanning: Spanning) -> dict[tuple[frozenset[int], str], int]:
    """The coordinates of joints, by the bodies that these join and by their names."""
    places = {}
    for link in tree.links:
        for place, row in zip(link.bodies, link.coordinates.rows, strict=True):
            branch = spanning.branches[place]
            bodies = frozenset((branch.body, branch.parent))
            for (name, _), column in zip(link.joints.freedoms, row, strict=False):
                places[bodies, name] = column
    return places
