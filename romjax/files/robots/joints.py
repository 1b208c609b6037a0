"""The joints of a robot, and by what motion of which markers each is measured."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ...scene.effect.joint_damper import ANY
from ...scene.joint.point_on_line import PointOnLine
from ...scene.joint.prismatic import Prismatic
from ...scene.joint.revolute import Revolute
from ...scene.joint.spatial.aligned import ParallelAxes, RightAngle, Untwisted
from ...scene.joint.spatial.cylindrical import Cylindrical
from ...scene.joint.spatial.planar import Planar
from ...scene.joint.spatial.point_on_plane import PointOnPlane
from ...scene.joint.spatial.spherical import Spherical
from ...scene.joint.spatial.universal import Universal
from ...scene.marker import Marker
from ...scene.orientation import quaternion_of, rotation
from ...scene.placement import Placement
from .model import Model
from .tree import Tree

FREE, BALL, SLIDE, HINGE = 0, 1, 2, 3
# Directions and points that differ by less are the same.
_SAME = 1e-9
# Between stops that are closer than this to zero, no angle passes a half turn [rad].
_WITHIN = 3.0
# What rounding adds to an angle that begins at a half turn [rad].
_ROUNDING = 1e-9
_APART = "give the link between the two joints a body of its own, with a mass"


class Measured(NamedTuple):
    """How a joint of a file is measured: by the `motion` of marker `a` against `b`, times `sign`;
    "" for a free joint.
    """

    name: str
    link: int
    a: Marker
    b: Marker
    motion: str
    sign: float = 1.0


class Joints:
    """The joints of a model between the bodies of its tree: `joints`, and how each joint of
    the file is `measured`, by its number.
    """

    joints: list[Any]
    measured: dict[int, Measured]

    def __init__(self, model: Model, tree: Tree, starts: Any):
        """`starts` are the positions at which the joints of the model begin."""
        self.model, self.tree, self._arrays = model, tree, model.arrays
        self._starts = starts
        self.joints, self.measured = [], {}
        for link in range(1, self._arrays.nbody):
            if tree.root[link] == link:
                self._connect(link)

    def _connect(self, link: int) -> None:
        first = int(self._arrays.body_jntadr[link])
        numbers = list(range(first, first + int(self._arrays.body_jntnum[link])))
        kinds = [int(self._arrays.jnt_type[i]) for i in numbers]
        if kinds == [FREE]:
            self._measure_free(link, numbers[0])
        elif kinds == [SLIDE, HINGE] or kinds == [HINGE, SLIDE]:
            slide, hinge = (numbers[kinds.index(kind)] for kind in (SLIDE, HINGE))
            if _parallel(self._axis(slide), self._axis(hinge)):
                self._cylinder(link, slide, hinge)
            else:
                self._several(link, numbers, kinds)
        else:
            self._several(link, numbers, kinds)
        for number, kind in zip(numbers, kinds, strict=True):
            if kind == HINGE:
                self._check_start(number)

    def _several(self, link: int, numbers: list[int], kinds: list[int]) -> None:
        """Slides, and then hinges about one point, or a ball joint."""
        slides = [i for i, kind in zip(numbers, kinds, strict=True) if kind == SLIDE]
        turns = numbers[len(slides) :]
        if any(kind == SLIDE for kind in kinds[len(slides) :]):
            raise self.model.refuse(
                "joint", numbers[-1], f"it slides along an axis that turns; {_APART}."
            )
        self._check(slides, turns)
        point = self._arrays.jnt_pos[turns[0]] if turns else np.zeros(3)
        ball = [i for i in turns if int(self._arrays.jnt_type[i]) == BALL]
        self._measure_slides(link, slides, point)
        marks = self._measure_turns(link, turns, point, bool(ball))
        where = self._position(link, slides, point)
        if len(slides) == 1 and not turns:
            where = self.measured[slides[0]].a, self.measured[slides[0]].b
        free = 3 if ball else len(turns)
        self.joints += _joined(where, marks, len(slides), free, self._names(numbers))

    def _check(self, slides: list[int], turns: list[int]) -> None:
        """Refuse axes that are not at right angles, and hinges about several points."""
        for group in (slides, [i for i in turns if int(self._arrays.jnt_type[i]) == HINGE]):
            for k, i in enumerate(group):
                for j in group[:k]:
                    if abs(self._axis(i) @ self._axis(j)) > _SAME:
                        raise self.model.refuse(
                            "joint",
                            i,
                            f"its axis is not at a right angle to another one; {_APART}.",
                        )
        for i in turns[1:]:
            if not _same(self._arrays.jnt_pos[i], self._arrays.jnt_pos[turns[0]]):
                raise self.model.refuse(
                    "joint", i, f"it turns about another point than the one before; {_APART}."
                )
            if self._reference(i) or self._reference(turns[0]):
                raise self.model.refuse(
                    "joint", i, "one of several hinges of a body has ref; take it out."
                )

    def _check_start(self, number: int) -> None:
        """Refuse a hinge that begins beyond a half turn where its angle is read: poses do not tell
        how often it has turned by then.
        """
        start = float(self._starts[self._arrays.jnt_qposadr[number]])
        if abs(start) > np.pi + _ROUNDING and self._is_read(number):
            raise self.model.refuse(
                "joint",
                number,
                f"it begins at {start:.6g} rad, but angles count from between -π and π at the "
                "start; take full turns off its start or its ref, its range and springref, and "
                "the targets of its actuators.",
            )

    def _is_read(self, number: int) -> bool:
        """Whether a spring, a stop, an actuator or an equality depends on the angle of a hinge."""
        arrays = self._arrays
        # These of MuJoCo's types act on joints: 0 and 1 for actuators, 2 for equalities.
        drives = (arrays.actuator_trntype <= 1) & (arrays.actuator_trnid[:, 0] == number)
        feedback = np.any(arrays.actuator_biasprm[drives, 1])
        ends = (arrays.eq_obj1id == number) | (arrays.eq_obj2id == number)
        tied = np.any(ends & (arrays.eq_type == 2))
        held = arrays.jnt_stiffness[number] or arrays.jnt_limited[number]
        return bool(held or feedback or tied)

    # Markers.

    def _pair(
        self, link: int, point: Any, turn: Any, slid: float = 0.0, turned: float = 0.0
    ) -> tuple[Marker, Marker]:
        """A marker at a point of a link, with its axes turned, and the one of the body before that
        it meets at zero; they are apart by what the joint has moved where the file shows it: by
        `slid` [m] along z, or `turned` [rad] about it.
        """
        tree = self.tree
        frame = Placement(point, turn)
        a = frame.then(Placement(np.zeros(3), rotation((0.0, 0.0, 1.0), turned)))
        b = tree.zero_place(link).then(frame).then(Placement(np.array([0.0, 0.0, -slid])))
        return tree.marker(link, a), tree.body_marker(tree.carrier(link), b)

    def _measure_free(self, link: int, number: int) -> None:
        arrays = self._arrays
        at = int(arrays.jnt_qposadr[number])
        origin = Placement(np.zeros(3), np.array([1.0, 0, 0, 0]))
        rest = arrays.qpos_spring[at : at + 7]
        a = self.tree.marker(link, origin)
        b = self.tree.body_marker(0, Placement(rest[:3], rest[3:]))
        self.measured[number] = Measured(self._name(number), link, a, b, "")

    def _measure_slides(self, link: int, slides: list[int], point: Any) -> None:
        for i in slides:
            a, b = self._pair(link, point, _toward(self._axis(i)), slid=self._reference(i))
            self.measured[i] = Measured(self._name(i), link, a, b, "travel")

    def _measure_turns(
        self, link: int, turns: list[int], point: Any, ball: bool
    ) -> tuple[Marker, Marker]:
        """Measure hinges or a ball joint; returns the markers by which they are joined."""
        if ball and len(turns) > 1:
            raise self.model.refuse("joint", turns[-1], f"a ball joint has more axes; {_APART}.")
        if ball or not turns:
            pair = self._pair(link, point, np.array([1.0, 0, 0, 0]))
            for i in turns:
                self.measured[i] = Measured(self._name(i), link, *pair, ANY)
            return pair
        axes = [self._axis(i) for i in turns]
        if len(turns) == 1:
            pair = self._pair(link, point, _toward(axes[0]), turned=self._reference(turns[0]))
            self.measured[turns[0]] = Measured(
                self._name(turns[0]), link, *pair, self._angle(turns[0])
            )
            return pair
        # The axes of several hinges stay at right angles in pairs: the markers have them for x, y
        # and z.
        third = np.cross(axes[0], axes[1])
        frame = np.asarray(quaternion_of("joint", given=np.stack([axes[0], axes[1], third], 1)))
        pair = self._pair(link, point, frame)
        for k, i in enumerate(turns):
            sign = -1.0 if k == 2 and axes[2] @ third < 0 else 1.0
            motion = f"{k + 1} of {len(turns)}"
            self.measured[i] = Measured(self._name(i), link, *pair, motion, sign)
        if len(turns) == 3:
            return pair
        a, _ = self._pair(link, point, _toward(axes[1]))
        _, b = self._pair(link, point, _toward(axes[0]))
        return a, b

    def _cylinder(self, link: int, slide: int, hinge: int) -> None:
        """A hinge and a slide along one axis, in any order."""
        # Both axes are parallel: one cylindrical joint stands for the two.
        point, axis = self._arrays.jnt_pos[hinge], self._axis(hinge)
        turn, sign = _toward(axis), float(np.sign(axis @ self._axis(slide)))
        turned = self._reference(hinge)
        a, b = self._pair(link, point, turn, sign * self._reference(slide), turned)
        self.measured[hinge] = Measured(self._name(hinge), link, a, b, self._angle(hinge))
        self.measured[slide] = Measured(self._name(slide), link, a, b, "travel", sign)
        self.joints.append(Cylindrical(a, b, name=self._names([slide, hinge])))

    def _position(self, link: int, slides: list[int], point: Any) -> tuple[Marker, Marker]:
        """Markers of what the slides leave of a position: on a line, or on a plane, along z."""
        axes = [self._axis(i) for i in slides]
        z = np.array([0.0, 0.0, 1.0])
        if len(axes) == 2:
            z = np.cross(*axes)
        elif axes:
            z = axes[0]
        return self._pair(link, point, _toward(z))

    # Numbers of the file.

    def _angle(self, number: int) -> str:
        limited = bool(self._arrays.jnt_limited[number])
        near = bool(np.all(np.abs(self._arrays.jnt_range[number]) < _WITHIN))
        return "bounded angle" if limited and near else "angle"

    def _axis(self, number: int) -> Any:
        return np.array(self._arrays.jnt_axis[number])

    def _reference(self, number: int) -> float:
        return float(self._arrays.qpos0[self._arrays.jnt_qposadr[number]])

    def _name(self, number: int) -> str:
        return self.model.numbered("joint", number)

    def _names(self, numbers: list[int]) -> str:
        return ", ".join(self._name(i) for i in numbers)


def _joined(
    where: tuple[Marker, Marker],
    turned: tuple[Marker, Marker],
    slides: int,
    turns: int,
    name: str,
) -> Iterator[Any]:
    """The joints of so many slides and turns: one where there is one, else one for the position
    and one for the directions.
    """
    whole: dict[tuple[int, int], Any] = {
        (0, 1): Revolute,
        (0, 2): Universal,
        (0, 3): Spherical,
        (1, 0): Prismatic,
    }
    if (slides, turns) in whole:
        yield whole[slides, turns](*(where if slides else turned), name=name)
        return
    if (slides, turns) == (2, 1) and _parallel(_z(where[0]), _z(turned[0])):
        yield Planar(*where, name=name)
        return
    # Any other joint is one of positions and one of directions, each by what it leaves free.
    positions: dict[int, Any] = {0: Spherical, 1: PointOnLine, 2: PointOnPlane}
    directions: dict[int, Any] = {0: Untwisted, 1: ParallelAxes, 2: RightAngle}
    position, direction = positions.get(slides), directions.get(turns)
    if position:
        yield position(*where, name=name)
    if direction:
        yield direction(*turned, name=f"{name}: directions" if position else name)


def _z(marker: Marker) -> Any:
    return Placement(np.zeros(3), marker.turn).axes[:, 2]


def _toward(axis: Any) -> Any:
    """The shortest turn of z to an axis."""
    return np.asarray(quaternion_of("joint", axis=tuple(float(x) for x in axis)))


def _parallel(a: Any, b: Any) -> bool:
    return bool(np.all(np.abs(np.cross(a, b)) < _SAME))


def _same(a: Any, b: Any) -> bool:
    return bool(np.all(np.abs(a - b) < _SAME))
