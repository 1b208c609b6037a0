"""Export of scenes in space to MJCF, of what that can hold."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ...common import writing
from ...common.errors import SceneError
from ...scene.body.spatial.rigid import RigidBody
from ...scene.effect.actuator import Actuator
from ...scene.effect.gravity import Gravity
from ...scene.effect.joint_damper import ANY
from ...scene.joint.prismatic import Prismatic
from ...scene.joint.revolute import Revolute
from ...scene.joint.spatial.spherical import Spherical
from ...scene.joint.weld import Weld
from ...scene.marker import GROUND, Marker
from ...scene.motion import TURN, moved
from ...scene.placement import Placement
from ...scene.placing import marker_start
from ...scene.scene import Scene
from .attributes import activated, attributes, box, limits, motion_of, words

# The kind of a joint in MJCF by the joint of a body, and the motions that it measures.
_KINDS: dict[type, tuple[str, tuple[str, ...]]] = {
    Revolute: ("hinge", ("angle", "bounded angle")),
    Prismatic: ("slide", ("travel",)),
    Spherical: ("ball", (ANY, TURN)),
    Weld: ("", ()),
}
# Places [m] and components of axes that differ by less are the same but for rounding.
_SAME = 1e-9


def save_mjcf(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write a scene to a file in MJCF; see `Scene.save`."""
    scene.check()
    writing.write(Path(path), mjcf_of(scene, Path(path).stem))


def mjcf_of(scene: Scene, name: str) -> str:
    """A scene in MJCF.

    Raises SceneError for each part that MJCF cannot hold, by name.
    """
    return _Writer(scene).document(name)


class _Writer:
    """Writes the bodies of a scene as a tree of joints, and closes its loops by equalities."""

    def __init__(self, scene: Scene):
        self.scene = scene
        self._refuse_bodies()
        self.bodies = {body.name: body for body in scene.bodies}
        self.places = {GROUND: Placement(np.zeros(3))}
        rigid: tuple[Any, ...] = scene.bodies
        for body in rigid:
            turn = np.asarray(body.orientation, float)
            place = np.asarray(body.position, float)
            self.places[body.name] = Placement(place, turn / np.linalg.norm(turn))
        self.carrying = self._tree()
        self.used = set[int]()
        self.attributes = {
            name: "".join(self._passive(joint)) for name, (_, joint) in self.carrying.items()
        }

    def _refuse_bodies(self) -> None:
        wrong = [
            f"body '{body.name}' is a {type(body).__name__}"
            for body in self.scene.bodies
            if not isinstance(body, RigidBody)
        ]
        wrong += [
            f"body '{body.name}' moves at the start"
            for body in self.scene.bodies
            if not wrong and np.any(np.asarray(body.start()[1]))
        ]
        if wrong:
            raise SceneError(
                "save: MJCF holds rigid bodies in space that are at rest at first, but "
                f"{', '.join(wrong)}; save the scene as TOML, or change that by scene.replace."
            )

    def _tree(self) -> dict[str, tuple[str, Any]]:
        """The parent of each body that a joint carries, and the joint."""
        parents = dict[str, tuple[str, Any]]()
        reached, grown = {GROUND}, True
        roots = [body.name for body in self.scene.bodies]
        while grown or roots:
            grown = False
            for joint in self.scene.joints:
                a, b = joint.a.body, joint.b.body
                child, parent = (a, b) if b in reached else (b, a)
                if type(joint) in _KINDS and parent in reached and child not in reached:
                    parents[child], grown = (parent, joint), True
                    reached.add(child)
            roots = [name for name in roots if name not in reached]
            if not grown and roots:
                # Where nothing ties bodies to the ground, one of them is free.
                reached.add(roots[0])
                grown = True
        return parents

    def document(self, name: str) -> str:
        """The file."""
        gravity = [e for e in self.scene.effects if isinstance(e, Gravity)]
        down = sum((np.asarray(e.acceleration) for e in gravity), np.zeros(3))
        tops = [n for n in self.bodies if self.carrying.get(n, (GROUND, None))[0] == GROUND]
        bodies = "".join(self._body(name, 2) for name in tops)
        closing = "".join(self._loops())
        motors = "".join(self._motors())
        self._refuse_rest()
        sections = [("worldbody", bodies), ("equality", closing), ("actuator", motors)]
        text = "".join(f"  <{tag}>\n{own}  </{tag}>\n" for tag, own in sections if own)
        return (
            f"<mujoco model={quoteattr(name)}>\n"
            '  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>\n'
            f'  <option gravity="{words(down)}"/>\n{text}</mujoco>\n'
        )

    def _body(self, name: str, depth: int) -> str:
        body: Any = self.bodies[name]
        parent, joint = self.carrying.get(name, (GROUND, None))
        place, pad = _within(self.places[name], self.places[parent]), "  " * depth
        inertia, centre = np.asarray(body.inertia, float), body.com
        centre = np.zeros(3) if centre is None else centre
        tensor = inertia if inertia.ndim == 2 else np.diag(inertia)
        six = [tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        lines = [
            f'{pad}  <inertial pos="{words(centre)}" mass="{float(body.mass)!r}" '
            f'fullinertia="{words(six)}"/>\n'
        ]
        if joint is None:
            lines.insert(0, f"{pad}  <freejoint/>\n")
        elif text := self._joint(name, joint):
            lines.insert(0, f"{pad}  {text}\n")
        lines.append(box(body, pad))
        for point, at in body.named_points().items():
            title = quoteattr(f"{name}.{point}")
            lines.append(f'{pad}  <site name={title} pos="{words(at)}"/>\n')
        held = [child for child, (carrier, _) in self.carrying.items() if carrier == name]
        inner = "".join(self._body(child, depth + 1) for child in held)
        return (
            f'{pad}<body name={quoteattr(name)} pos="{words(place.position)}" '
            f'quat="{words(place.turn)}">\n{"".join(lines)}{inner}{pad}</body>\n'
        )

    def _joint(self, child: str, joint: Any) -> str:
        """The joint of a body; its value is the one that the scene gives to it."""
        kind, motions = _KINDS[type(joint)]
        if not kind:
            return ""
        own = joint.a if joint.a.body == child else joint.b
        text = f'<joint name={quoteattr(joint.label())} type="{kind}" pos="{words(own.point)}"'
        if kind == "ball":
            return f"{text}{self.attributes[child]}/>"
        # The scene measures a against b: from the other side the axis is turned round.
        axis = Placement(np.zeros(3), own.turn).axes[:, 2] * (1 if own is joint.a else -1)
        value = float(self._measure(motions[0], joint.a, joint.b))
        return f'{text} axis="{words(axis)}" ref="{value!r}"{self.attributes[child]}/>'

    def _measure(self, motion: str, a: Marker, b: Marker) -> Any:
        poses = (marker_start(self.bodies, marker) for marker in (a, b))
        plain = "bounded angle" if motion == "angle" else motion
        return moved(plain, *poses)

    def _passive(self, joint: Any) -> Iterator[str]:
        """The attributes of what acts in a joint that carries a body."""
        _, motions = _KINDS[type(joint)]
        said = set[str]()
        for number, part in enumerate(self.scene.effects):
            motion = motion_of(part)
            if not self._acts_in(joint, part) or motion not in motions:
                continue
            text = attributes(part)
            # A joint of MJCF has one spring, one damper and so on; the others are refused.
            what = text.partition("=")[0]
            if text and what not in said:
                said.add(what)
                self.used.add(number)
                yield text

    def _acts_in(self, joint: Any, part: Any) -> bool:
        """Whether an effect measures by the markers of a joint, or by others of the same frames."""
        markers = getattr(part, "markers", ())
        if len(markers) != 2:
            return False
        return all(
            own.body == other.body
            and _same(own.point, other.point)
            and _same_turn(own.turn, other.turn)
            for own, other in zip(markers, joint.markers, strict=True)
        )

    def _loops(self) -> Iterator[str]:
        """The joints that carry no body."""
        carrying = [id(joint) for _, joint in self.carrying.values()]
        for joint in self.scene.joints:
            if id(joint) in carrying:
                continue
            kind = {Spherical: "connect", Weld: "weld"}.get(type(joint))
            if kind is None:
                raise SceneError(
                    f"save: MJCF holds no {type(joint).__name__} such as '{joint.label()}' "
                    "between these bodies; save the scene as TOML."
                )
            one, other = joint.a, joint.b
            if one.body == GROUND:
                one, other = other, one
            second = "" if other.body == GROUND else f" body2={quoteattr(other.body)}"
            text = (
                f"    <{kind} name={quoteattr(joint.label())} body1={quoteattr(one.body)}{second}"
            )
            if kind == "connect":
                yield f'{text} anchor="{words(one.point)}"/>\n'
            else:
                yield f"{text}/>\n"

    def _motors(self) -> Iterator[str]:
        for number, part in enumerate(self.scene.effects):
            if not isinstance(part, Actuator):
                continue
            joints = [j for _, j in self.carrying.values() if self._acts_in(j, part)]
            if not joints:
                continue
            self.used.add(number)
            bias = [part.offset, -part.proportional, -part.derivative]
            yield (
                f"    <general name={quoteattr(part.label())} "
                f'joint={quoteattr(joints[0].label())} gear="{words(part.gear)}" '
                f'gainprm="{words(part.gain)}" biastype="affine" biasprm="{words(bias)}"'
                + activated(part)
                + limits("force", part.least, part.largest)
                + limits("ctrl", part.least_signal, part.largest_signal)
                + "/>\n"
            )

    def _refuse_rest(self) -> None:
        """Refuse effects that have not been written."""
        left = [
            part.label()
            for number, part in enumerate(self.scene.effects)
            if number not in self.used and not isinstance(part, Gravity)
        ]
        if left:
            raise SceneError(
                f"save: MJCF as romjax writes it does not hold {', '.join(left)}; take them out by "
                "scene.without, or save the scene as TOML."
            )


def _within(place: Placement, other: Placement) -> Placement:
    """A place in the frame of another, both of them in space."""
    back = other.turn * np.array([1.0, -1.0, -1.0, -1.0])
    away = Placement(np.zeros(3), back)
    return away.then(Placement(place.position - other.position, place.turn))


def _same(a: Any, b: Any) -> bool:
    return bool(np.all(np.abs(np.asarray(a) - np.asarray(b)) < _SAME))


def _same_turn(a: Any, b: Any) -> bool:
    return _same(Placement(np.zeros(3), a).axes, Placement(np.zeros(3), b).axes)
