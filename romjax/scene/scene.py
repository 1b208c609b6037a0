"""What is there: bodies, joints and effects."""

import os
from collections.abc import Iterable, Sequence
from typing import Any

import equinox as eqx

from ..common.errors import SceneError
from ..common.extras import lazy_import
from ..common.pictures import inline, still
from .body.base import AbstractBody
from .effect.base import AbstractEffect
from .fields import Converted, parts
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
        """Write the scene to a file in TOML, which `load_scene` reads: every number to the bit.

        Arrays of more than a thousand numbers go to a file of NumPy beside, whose name begins like
        that of the scene. What is there is replaced once all is written.

        Raises SceneError for a part of one's own that has what no file can hold.
        """
        lazy_import("files.write", "save")(self, path)

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
                raise SceneError(
                    f"{owner} is {words[dimension]}, but {given[0][0]} is {words[self.dimension]}; "
                    "a scene is in the plane as a whole, or in space."
                )

    def _repr_html_(self) -> str | None:
        """Return the picture of the scene at the start, which notebooks show."""
        return inline(lambda: still(self))


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
