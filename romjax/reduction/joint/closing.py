"""Some of the joints of a system, with their markers: those that are cut, and those that count."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...assembly.groups import JointGroup
from ...assembly.kinematics import MarkerBlocks, Markers
from ...common.arrays import Time, pick
from ...linalg.indexing import Index, spread
from ...scene.marker import Pose


class SomeJoints(eqx.Module):
    """Joints of a system, whose rows are numbered anew; `size`: how many coordinates q it has."""

    groups: tuple[JointGroup, ...]
    markers: Markers | None
    size: int = eqx.field(static=True)

    @property
    def m(self) -> int:
        """How many constraints they are."""
        return sum(len(group.rows.rows) * group.rows.width for group in self.groups)

    def residual(self, t: Time, q: Float[Array, " n"]) -> Float[Array, " m"]:
        """The residuals at the coordinates q of the system."""
        if self.markers is None:
            return jnp.zeros(0, q.dtype)
        return self.of_poses(t, self.markers.poses(q))

    def of_poses(self, t: Time, poses: Pose) -> Float[Array, " m"]:
        """The residuals at the poses of the markers."""
        blocks = [group.residual(t, poses) for group in self.groups]
        return spread(blocks, [group.rows.array for group in self.groups], (self.m,))


def some_joints(system: AssembledSystem, chosen: tuple[tuple[int, int], ...]) -> SomeJoints:
    """The joints of a system that are `chosen` by their group and row, in the order of groups."""
    if not chosen:
        return SomeJoints((), None, system.n)
    every = system.joint_markers
    assert every is not None
    groups, taken, first = list[JointGroup](), list[int](), 0
    for g, group in enumerate(system.joints):
        own = np.array([row for number, row in chosen if number == g], int)
        if not own.size:
            continue
        blocks, width = group.markers, group.rows.width
        start = len(taken)
        # Markers are stored side after side of a group: all first ones, then all second ones.
        for side in range(blocks.sides):
            taken += (blocks.start + side * blocks.count + own).tolist()
        # Numbers of the chosen joints alone; their structure is that of the group, which is traced
        # once.
        joints = jax.tree.map(lambda x, own=own: pick(x, own), group.joints)
        rows = Index.of(
            np.arange(first, first + own.size * width).reshape(own.size, width).tolist()
        )
        own_markers = MarkerBlocks(start, own.size, blocks.sides)
        groups.append(JointGroup(joints, own_markers, rows, group.stands_at))
        first += own.size * width
    return SomeJoints(tuple(groups), _taken(every, np.array(taken, int)), system.n)


def _taken(markers: Markers, rows: np.ndarray) -> Markers:
    second: Any = markers.foreshortening
    return Markers(
        pick(markers.points, rows),
        pick(markers.turns, rows),
        pick(markers.shapes, rows),
        None if second is None else pick(second, rows),
        Index.of(markers.frames.array[rows].tolist()),
        Index.of(markers.amplitudes.array[rows].tolist()),
        tuple(few for own in markers.bending if (few := own.among(rows)) is not None),
    )
