"""Markers that are in no joint or effect: where they are in a system that is assembled already."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import pick
from ..common.checks import check_kind, unknown_name
from ..common.errors import InputError
from ..scene.body.base import AbstractBody
from ..scene.marker import GROUND, Marker, Pose, Twist, Wrench
from ..system.base import AbstractSystem, check_system
from .assembled import AssembledSystem, mechanism_of
from .grouping import member, stack, with_name
from .kinematics import Markers, prepare_points


class Located(eqx.Module):
    """Markers on some bodies of a system.

    - `columns`: those of q that belong to the bodies, in the order in which the markers name them.
    - `markers`: on q[columns], so that their program is the same for any bodies of equal structure.
    """

    columns: tuple[int, ...] = eqx.field(static=True)
    markers: Markers

    def own(self, x: Float[Array, "*k n"]) -> Float[Array, "*k own"]:
        """The bodies' own entries of coordinates or of their rates."""
        return pick(x, np.s_[..., np.array(self.columns, int)])

    def poses(self, q: Float[Array, " n"]) -> Pose:
        """Return the poses of the markers at the coordinates `q` of the whole system."""
        return self.markers.poses(self.own(q))

    def motion(self, q: Float[Array, " n"], v: Float[Array, " n"]) -> tuple[Pose, Twist]:
        """Return the poses and the twists of the markers."""
        return self.markers.motion(self.own(q), self.own(v))

    def pull_back(self, q: Float[Array, " n"], wrenches: Wrench) -> Float[Array, " n"]:
        """The generalized force of wrenches on the markers, on all coordinates `q`."""
        force = self.markers.pull_back(self.own(q), wrenches)
        return jnp.zeros_like(q).at[np.array(self.columns, int)].set(force)


def assembled(owner: str, system: AbstractSystem) -> AssembledSystem:
    """The system of bodies that a full or reduced `system` stands for.

    Raises InputError, beginning with `owner`, if there is none.
    """
    check_system(owner, system)
    mechanism = mechanism_of(system)
    if mechanism is None:
        raise InputError(
            f"{owner}: a {type(system.full).__name__} has coordinates, but no bodies that carry "
            "markers, joints or effects; assemble a Scene, or evaluate functions of q and v."
        )
    return mechanism


def locate(owner: str, system: AbstractSystem, markers: Sequence[Marker]) -> Located:
    """Prepare `markers` on the bodies of a `system`, full or reduced.

    Raises InputError, beginning with `owner`, for a marker on a body that the system lacks, or at a
    point that its body does not know.
    """
    for marker in markers:
        check_kind(
            owner, "the marker", marker, Marker, "a marker of a body, such as body.at(point)"
        )
        marker.check(owner)
    names = [marker.body for marker in markers]
    columns, bodies = bodies_of(owner, system, names)
    for marker in markers:
        if marker.body != GROUND:
            bodies[marker.body].check_marker(owner, marker)
    points, turns = stack([(marker.point, marker.turn) for marker in markers])
    return located(names, points, turns, columns, bodies)


def located(
    names: Sequence[str],
    points: Float[Array, "count d"],
    turns: Float[Array, "count *turn"],
    columns: dict[str, tuple[int, ...]],
    bodies: dict[str, AbstractBody],
) -> Located:
    """Prepare markers at the material `points` of the bodies `names`; the other arguments are what
    `bodies_of` gives.
    """
    own, count = {}, 0
    for name in bodies:
        own[name] = tuple(range(count, count + len(columns[name])))
        count += len(columns[name])
    used = tuple(i for name in bodies for i in columns[name])
    return Located(used, prepare_points(names, points, turns, bodies, own, count))


def bodies_of(
    owner: str, system: AbstractSystem, names: Sequence[str]
) -> tuple[dict[str, tuple[int, ...]], dict[str, AbstractBody]]:
    """The columns of q that belong to each body of a system, and the bodies of some `names`."""
    full = assembled(owner, system)
    columns: dict[str, tuple[int, ...]] = {}
    for i, coordinate in enumerate(full.structure.coordinates):
        columns[coordinate.owner] = (*columns.get(coordinate.owner, ()), i)
    bodies: dict[str, AbstractBody] = {}
    for name in names:
        if name == GROUND or name in bodies:
            continue
        if name not in columns:
            raise unknown_name(owner, "body", name, columns)
        for group in full.bodies:
            for row, own in enumerate(group.coordinates.rows):
                if own[0] == columns[name][0]:
                    bodies[name] = with_name(member(group.bodies, row), name)
    return columns, bodies
