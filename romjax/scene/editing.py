"""Transfer of the markers of a body to another one that takes its place."""

from collections.abc import Callable, Sequence
from typing import Any

import jax.tree_util as jtu

from ..common.arrays import as_array, namespace, untraced
from ..common.checks import unknown_name
from ..common.errors import SceneError
from ..linalg import quaternions
from .body.base import AbstractBody
from .marker import Marker, Pose
from .placing import start_pose


def find_body(bodies: Sequence[AbstractBody], owner: str, name: str) -> int:
    """The number of the body of a name; raises SceneError, with the names that there are."""
    names = [body.name for body in bodies]
    if name not in names:
        raise SceneError(str(unknown_name(owner, "body", name, names)))
    return names.index(name)


def moved_markers(part: Any, name: str, change: Callable[[Marker], Marker]) -> Any:
    """A part with other markers for those that are on the body of a name."""

    def one(x: Any) -> Any:
        return change(x) if isinstance(x, Marker) and x.body == name else x

    return jtu.tree_map(one, part, is_leaf=lambda x: isinstance(x, Marker))


def carried_over(old: AbstractBody, new: AbstractBody) -> Callable[[Marker], Marker]:
    """Return a function that moves markers from one body to another, so that at the start they
    stay.

    The old one is as it is there, bent if it bends, the new one undeformed.
    """
    if old.dimension != new.dimension:
        raise SceneError(
            f"replace: body '{old.name}' has {old.dimension} dimensions, but the new one has "
            f"{new.dimension}; give one of the same."
        )
    d = old.dimension
    (q,) = untraced(new.start()[0])
    frame = Pose(q[:d], q[2] if d == 2 else q[d:7])

    def change(marker: Marker) -> Marker:
        before = start_pose(old, marker.point)
        local = against(before, frame)
        turn = composed(local.turn, marker.turn, d)
        place = local.position if new.centre is None else local.position + new.centre
        return Marker(new.name, as_array(place), as_array(turn))

    return change


def composed(turn: Any, own: Any, dimension: int) -> Any:
    """The turn of what is turned by its `own` turn in what is turned by the other."""
    turn, own = untraced(turn, own)
    return turn + own if dimension == 2 else quaternions.product(turn, own)


def against(pose: Pose, other: Pose) -> Pose:
    """The pose in the frame of the other; by NumPy where JAX does not trace."""
    position, turn, origin, axes = untraced(pose.position, pose.turn, other.position, other.turn)
    arm = position - origin
    if pose.dimension == 3:
        back = quaternions.conjugate(axes)
        return Pose(quaternions.rotate(back, arm), quaternions.product(back, turn))
    xp = namespace(arm)
    c, s = xp.cos(axes), xp.sin(axes)
    return Pose(xp.stack([c * arm[0] + s * arm[1], c * arm[1] - s * arm[0]]), turn - axes)
