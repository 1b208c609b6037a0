"""Effects along the coordinates of joints, which act there without poses and wrenches."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...assembly.groups import EffectGroup
from ...assembly.kinematics import Markers
from ...common.arrays import Time, concrete
from ...common.inheritance import goes_with
from ...scene.effect.along_motion import AbstractMotionEffect
from ...system.state import Power
from .spanning import Spanning
from .tree import Tree

# Motions of effects, by those of joints between the same markers; angles in space that count full
# turns have more markers.
_COORDINATES = {"angle": "angle", "bounded angle": "angle", "travel": "travel"}


class OnCoordinate(NamedTuple):
    """The effects of one group: of each the coordinate among z that is its motion, and the sign."""

    group: int
    coordinates: tuple[int, ...]
    signs: tuple[int, ...]

    @property
    def sign(self) -> np.ndarray:
        return np.array(self.signs)

    def of(self, state: Any) -> tuple[Any, Array, Array]:
        """The effects at a `state` of joint coordinates, their motions and the rates of these."""
        full: AssembledSystem = state.system.full
        # What controllers set is among the velocities of q.
        now = full.now(state.v) if full.controllers else full
        group: Any = now.effects[self.group].effects
        columns, sign = np.array(self.coordinates), jnp.asarray(self.sign, state.z.dtype)
        motion, rate = sign * state.z[columns], sign * state.w[columns]
        if group.motion == "bounded angle" and group.a.dimension == 3:
            motion -= 2 * np.pi * jnp.round(motion / (2 * np.pi))
        return group, motion, rate


class AlongJoints(eqx.Module):
    """The effects of a system that act along coordinates of its tree, by their groups.

    An effect whose markers are those of a joint has the motion ± z of the joint's coordinate, and
    its force does the work of the same force on z. Nothing else of the mechanism enters.
    """

    groups: tuple[OnCoordinate, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, full: AssembledSystem, tree: Tree, spanning: Spanning) -> "AlongJoints":
        """Return the effects of which all of a group are along coordinates, as far as the numbers
        of markers are known.
        """
        places = dict(_coordinates(full, tree, spanning))
        found = list[OnCoordinate]()
        for number, group in enumerate(full.effects):
            name = _coordinate(group.effects)
            if name is None or full.effect_markers is None:
                continue
            sides = [_keys(full.effect_markers, rows) for rows in _rows(group)[:2]]
            own = [places.get((*ends, name)) for ends in zip(*sides, strict=True)]
            if all(own):
                coordinates, signs = zip(*(x for x in own if x is not None), strict=True)
                found.append(OnCoordinate(number, coordinates, signs))
        return cls(tuple(found))

    @property
    def numbers(self) -> frozenset[int]:
        """The numbers of the groups."""
        return frozenset(each.group for each in self.groups)

    def forces(self, state: Any) -> Float[Array, " n"]:
        """The forces on z at a `state` of joint coordinates."""
        total = jnp.zeros_like(state.z)
        for each in self.groups:
            group, motion, rate = each.of(state)
            push = each.sign * _pushes(group, state.t, motion, rate)
            total = total.at[np.array(each.coordinates)].add(push)
        return total

    def power(self, state: Any) -> Power | None:
        """The power of all forces of the mechanism that have no potential energy; None where all
        have one. A force along a coordinate that has one, and another part, has that at rest alone.
        """
        full: AssembledSystem = state.system.full
        others = full.power(state.t, state.q, state.v, self.numbers)
        working = [each for each in self.groups if _works(full.effects[each.group].effects)]
        if not working:
            return others
        taken, given = others or Power(*[jnp.zeros((), state.z.dtype)] * 2)
        for each in working:
            group, motion, rate = each.of(state)
            push = _pushes(group, state.t, motion, rate)
            if group.stores:
                # The part that a motion at rest has too is that of the potential energy.
                push -= _pushes(group, state.t, motion, jnp.zeros_like(rate))
            power = jnp.sum(push * rate)
            if group.supplies:
                given += power
            else:
                taken += power
        return Power(taken, given)


def _works(effect: Any) -> bool:
    return bool(effect.supplies or effect.dissipates)


def _pushes(group: Any, t: Time, motion: Array, rate: Array) -> Float[Array, " count"]:
    """The forces of the effects of a group along their motions."""
    each: Array = jax.vmap(lambda effect, s, r: effect.along(t, s, lambda: r))(group, motion, rate)
    return each


def _coordinate(effect: Any) -> str | None:
    """The name of the coordinate that may be the motion of an effect; None where nothing is."""
    along = getattr(type(effect), "along", AbstractMotionEffect.along)
    if along is AbstractMotionEffect.along or effect.motion not in _COORDINATES or effect.states:
        return None
    known = all(goes_with(effect, "along", other) for other in ("wrenches", "energy"))
    counts = effect.counted and effect.a.dimension == 3
    return _COORDINATES[effect.motion] if known and not counts else None


def _coordinates(
    full: AssembledSystem, tree: Tree, spanning: Spanning
) -> Iterator[tuple[tuple[Any, Any, str], tuple[int, int]]]:
    """The coordinates of joints of the tree and their signs, by both markers and the name."""
    if full.joint_markers is None:
        return
    for link in tree.links:
        joints: Any = link.joints
        if not joints.motions or not goes_with(joints, "motions", "read"):
            continue
        straight = _straight(joints, len(link.bodies))
        for i, (place, row) in enumerate(zip(link.bodies, link.coordinates.rows, strict=True)):
            held = spanning.branches[place].link
            assert held is not None
            blocks = full.joints[held.group].markers
            rows = [blocks.start + side * blocks.count + held.row for side in (0, 1)]
            a, b = _keys(full.joint_markers, rows)
            if a is None or b is None:
                continue
            for name, column in zip(joints.motions, row, strict=True):
                yield (a, b, name), (column, 1)
                if name != "travel" or straight[i]:
                    yield (b, a, name), (column, -1)


def _straight(joints: Any, count: int) -> np.ndarray:
    """Whether each joint has both x axes in one direction, so that the travel of `b` against `a` is
    that of `a` against `b` backwards. In space they slide along their common z axis.
    """
    angle = getattr(joints, "value", None)
    if angle is None:
        return np.ones(count, bool)
    known = concrete(angle)
    return np.zeros(count, bool) if known is None else np.equal(known, 0)


def _rows(group: EffectGroup) -> list[list[int]]:
    """The numbers of the markers of each side."""
    blocks = group.markers
    firsts = [blocks.start + side * blocks.count for side in range(blocks.sides)]
    return [list(range(first, first + blocks.count)) for first in firsts]


def _keys(markers: Markers, rows: list[int]) -> list[Any]:
    """Return keys that tell markers apart; None of those whose numbers are unknown, or on bodies
    with poses of their own.
    """
    given = markers.points, markers.turns, markers.shapes, markers.foreshortening
    known = [concrete(x) for x in given if x is not None]
    if markers.bending or any(x is None for x in known):
        return [None] * len(rows)
    numbers = [x for x in known if x is not None]
    return [(markers.frames.rows[row], *(_bytes(x[row]) for x in numbers)) for row in rows]


def _bytes(numbers: Any) -> bytes:
    """Numbers without the zeros at the ends of their axes, with which those of fewer modes are
    padded.
    """
    # Adding zero makes minus zero, whose bytes are others, a zero.
    x = np.atleast_1d(numbers) + 0.0
    places = np.nonzero(x)
    sizes = tuple(int(np.max(own, initial=-1)) + 1 for own in places)
    return x[tuple(slice(size) for size in sizes)].tobytes() + bytes(str(sizes), "ascii")
