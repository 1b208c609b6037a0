"""Scenes: bodies, joints and effects."""

import os
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import equinox as eqx

from ..common import files
from ..common.checks import unknown_name
from ..common.errors import SceneError
from ..common.pictures import inline, picture_of
from .body.base import AbstractBody
from .body.sections import AbstractSection
from .editing import carried_over, find_body, moved_markers
from .effect.base import AbstractEffect
from .fields import Converted, parts
from .flexible import flexible_body, on_beam, warn_of_other_inertia
from .joint.base import AbstractJoint
from .marker import GROUND, Marker


class Scene(eqx.Module):
    """A mechanism as one would draw it, and the pytree of its parameters: a gradient is a Scene.

    **Arguments:**

    - `bodies`, `joints`, `effects`: sequences of the parts, in any order; the order of the bodies
      is the order of the coordinates, that of the joints the order of the constraints.
    """

    bodies: Converted[tuple[AbstractBody, ...], Iterable[AbstractBody]] = parts()
    joints: Converted[tuple[AbstractJoint, ...], Iterable[AbstractJoint]] = parts(default=())
    effects: Converted[tuple[AbstractEffect, ...], Iterable[AbstractEffect]] = parts(default=())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the scene to a file in TOML, which `load_scene` reads: every number to the bit; or,
        where the `path` ends with .xml, in MJCF, of what that can hold.

        Arrays of more than a thousand numbers go to a file of NumPy beside, whose name begins like
        that of the scene. What is there is replaced once all is written.

        MJCF takes rigid bodies in space at rest, hinges, slides, balls, welds and loops of these,
        springs, damping, friction, inertia and stops in joints, actuators and gravity. Stops and
        loops are as soft there as MuJoCo makes them.

        Raises SceneError for a part of one's own that has what no file can hold, and for each part
        that MJCF does not hold, by name.
        """
        files.save(self, path)

    def replace(self, name: str, body: AbstractBody) -> "Scene":
        """The scene with a `body` in the place of that of a `name`: markers are, at the start,
        where they were, so that the new body has to be placed where the old one is.

        Raises SceneError for a name that the scene does not have.
        """
        number = find_body(self.bodies, "replace", name)
        change = carried_over(self.bodies[number], body)
        return self._changed(number, body, lambda part, marker: change(marker))

    def flexible(
        self,
        name: str,
        *,
        modes: int = 3,
        ends: Sequence[Any] | None = None,
        section: AbstractSection | None = None,
        **options: Any,
    ) -> "Scene":
        """The scene with a rigid link as an elastic beam between its joints: a `Beam`, in space a
        `spatial.Beam`.

        The mass of the link is kept and spread evenly between the ends, and in space the moment of
        inertia about their line is kept; centre and other moments are those of the beam, and a
        warning says by how much they change. With a `section` all are those of the prism. Joints
        and effects stay where they are, and named points between the ends keep their names.

        **Arguments:**

        - `name`: of the link.
        - `modes`: of bending, in space in each plane, and of torsion or extension where `GJ` or
          `EA` is given.
        - `ends`: two points of the link, or their names; unless given the two points of joints that
          are furthest apart, or that of its joint and the named point furthest from it.
        - `section`: such as `sections.Tube(0.06, 0.003)`, with `density` and `modulus`.
        - `options`: `EI` [N m²] without a section, and what a beam takes besides, such as
          `damping` and `stiffening`. In space local x goes from the first end to the second, and
          local z is as near to that of the link as can be.

        Raises SceneError for a name that the scene does not have, for a body that is no rigid one,
        and for a part that holds it beyond the ends.

        ```python
        arm = rj.load_scene("arm.xml").flexible("forearm", EI=800.0, modes=2)
        ```
        """
        number = find_body(self.bodies, "flexible", name)
        old = self.bodies[number]
        markers = [m for joint in self.joints for m in joint.markers if m.body == name]
        beam = flexible_body(old, markers, modes=modes, ends=ends, section=section, options=options)
        change = carried_over(old, beam)
        changed = self._changed(
            number, beam, lambda part, m: on_beam(beam, f"flexible: '{part.label()}'", change(m))
        )
        if section is None:
            warn_of_other_inertia(old, beam)
        return changed

    def without(self, *names: str) -> "Scene":
        """The scene without the bodies, joints and effects of some `names`, and without what is
        held by these bodies. Joints and effects without a name have their label, such as
        "Spring(cart, ground)".

        Raises SceneError for a name that the scene does not have.
        """
        parts: list[Any] = [*self.joints, *self.effects]
        known = [*(b.name for b in self.bodies), *(part.label() for part in parts)]
        for name in names:
            if name not in known:
                raise SceneError(str(unknown_name("without", "part", name, known)))

        def stays(part: Any) -> bool:
            on = {marker.body for marker, _ in markers_of(part)}
            return part.label() not in names and not on.intersection(names)

        return Scene(
            [body for body in self.bodies if body.name not in names],
            [joint for joint in self.joints if stays(joint)],
            [effect for effect in self.effects if stays(effect)],
        )

    def _changed(
        self, number: int, body: AbstractBody, change: Callable[[Any, Marker], Marker]
    ) -> "Scene":
        """The scene with another body, and with what becomes of the markers on it in each part."""
        name = self.bodies[number].name

        def moved(part: Any) -> Any:
            return moved_markers(part, name, lambda marker: change(part, marker))

        bodies = (*self.bodies[:number], body, *self.bodies[number + 1 :])
        return Scene(bodies, [moved(j) for j in self.joints], [moved(e) for e in self.effects])

    def check(self) -> None:
        """Raise a SceneError that names the first part that makes no sense."""
        if not self.bodies:
            raise SceneError("The scene has no bodies; add at least one, such as a RigidBody.")
        _check_kinds("bodies", self.bodies, AbstractBody)
        _check_kinds("joints", self.joints, AbstractJoint)
        _check_kinds("effects", self.effects, AbstractEffect)
        names = [body.name for body in self.bodies]
        for name in names:
            if names.count(name) > 1:
                raise SceneError(f"Two bodies are named '{name}'; every body needs its own name.")
        connected: tuple[AbstractJoint | AbstractEffect, ...] = (*self.joints, *self.effects)
        bodies = {body.name: body for body in self.bodies}
        for part in connected:
            for marker, turning in markers_of(part):
                if marker.body == GROUND:
                    continue
                if marker.body not in bodies:
                    raise SceneError(
                        f"'{part.label()}': its marker is on the body '{marker.body}', which the "
                        f"scene does not have. It has: {', '.join(names)}."
                    )
                bodies[marker.body].check_marker(f"'{part.label()}'", marker, turning)
        self._check_dimensions()
        # Again, since numbers may have been replaced since the parts were made.
        for body in self.bodies:
            body.check()
        for part in connected:
            part.check()
        for joint in self.joints:
            joint.check_among(self.joints)

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space: that of the first body."""
        return self.bodies[0].dimension

    def _check_dimensions(self) -> None:
        words = {2: "in the plane", 3: "in space"}
        given = [(f"body '{body.name}'", body.dimension) for body in self.bodies]
        parts: tuple[AbstractJoint | AbstractEffect, ...] = (*self.joints, *self.effects)
        for part in parts:
            given += [(f"'{part.label()}'", marker.dimension) for marker in part.markers]
            if hasattr(part, "dimension"):
                given.append((f"effect '{part.label().rstrip('()')}'", part.dimension))
        for owner, dimension in given:
            if dimension != self.dimension:
                needed = f" Its vector needs {self.dimension} numbers." * owner.startswith("effect")
                raise SceneError(
                    f"{owner} is {words[dimension]}, but {given[0][0]} is {words[self.dimension]}; "
                    f"a scene is in the plane as a whole, or in space.{needed}"
                )

    def _repr_html_(self) -> str | None:
        """Return the picture of the scene at the start, which notebooks show."""
        return inline(lambda: picture_of(self))


def _check_kinds(field: str, parts: Sequence[Any], kind: type) -> None:
    for part in parts:
        if not isinstance(part, kind):
            raise SceneError(f"Scene.{field} holds {part!r}, which is no {kind.__name__}.")


def markers_of(part: Any) -> list[tuple[Marker, bool]]:
    """The markers of a joint or an effect, if it has any, each with whether it asks how the marker
    is turned, or turns it.
    """
    points = getattr(part, "at_points", ())
    return [(marker, i not in points) for i, marker in enumerate(getattr(part, "markers", ()))]
