"""Contact of a point or a ball with a surface in space."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Time
from ....linalg import quaternions
from ...drawing import placed
from ...fields import Converted, check_numbers, number
from ...marker import Marker, Pose, Poses, Twists, Wrenches
from ...outline import Outline, Outlines
from ...surface import AbstractSurface
from ..base import displacement
from ..contact import AbstractContact, Friction, check_contact, local_point


class Contact(AbstractContact):
    """A point, or a ball, that is pushed out of a solid where it is inside, by a force that
    penalises depth, as `romjax.Contact` does in the plane.

    Friction acts against the velocity at which the surfaces slide, so a ball comes to roll; there
    is none against rolling or pivoting.

    **Arguments:**

    - `a`: the point, or the centre of the ball. `b`: carries the surface.
    - `surface`: a `Plane`, a `Cylinder`, a `Sphere` or another.
    - `stiffness`: k [N/m^(3/2)] of the normal force k δ^(3/2) (1 + D δ') at the depth δ.
    - `radius`: of the ball [m]; a point unless given.
    - `dissipation`: D [s/m]; none unless given.
    - `friction`: a `romjax.Friction`; none unless given.
    """

    a: Marker
    b: Marker
    surface: AbstractSurface
    stiffness: Converted[Float[Array, ""]] = number()
    radius: Converted[Float[Array, ""] | None] = number(default=None)
    dissipation: Converted[Float[Array, ""] | None] = number(default=None)
    friction: Friction | None = None
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    @property
    def at_points(self) -> tuple[int, ...]:  # type: ignore[override]
        return (0,) if self.radius is None else ()  # friction turns balls

    def gap(self, point: Float[Array, "3"]) -> Float[Array, ""]:
        gap = self.surface(point)
        return gap if self.radius is None else gap - self.radius

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del t
        a, b = poses
        depth, inside, normal = self.depth(local_point(a, b))
        arm = jnp.zeros_like(normal)
        if self.radius is not None:
            # The arm of the ball's material point that touches, by the axes of the ball: variations
            # of `point` leave it where it is, derivatives of the force do not.
            arm = quaternions.rotate(quaternions.conjugate(a.turn), b.turned(-self.radius * normal))

        def point(a: Pose, b: Pose) -> Float[Array, "3"]:
            return b.local(a.position + a.turned(arm))

        _, rate, wrenches = displacement(point, poses, twists)
        return wrenches(self.force(depth, inside, normal, rate))

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """The surface at the foot of the point, and the point that it stops."""
        del t
        a, b = poses
        lines = self.surface.outline(b.local(a.position), size)
        shown = [Outline(placed(b, line), "surface") for line in lines]
        return *shown, Outline(a.position[None], "point")

    def check(self) -> None:
        owner = check_contact(self)
        self.surface.check(owner)
        check_numbers(owner, self, "radius", sign="positive")
