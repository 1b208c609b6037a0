"""Contact of a point with a curve, with friction if asked for."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...arrays import Time
from ...errors import SceneError
from ..curve import AbstractCurve
from ..drawing import placed
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Twist, Wrench
from ..outline import Outline
from .base import AbstractMarkerEffect, check_markers, displacement


class Friction(eqx.Module):
    """Coulomb's friction, smooth at rest, with Stribeck's effect if asked for.

    The coefficient is μ(v) tanh(v / `creep`): what sticks creeps with less than about `creep`.
    With `static`, μ(v) = μ + (μ_s − μ) exp(−(v / `stribeck`)²).

    **Arguments:**

    - `coefficient`: μ of sliding.
    - `creep`: [m/s].
    - `static`: μ_s of slow motion, and `stribeck`: up to which speed [m/s]; none unless given.
    """

    coefficient: Converted[Float[Array, ""]] = number()
    creep: Converted[Float[Array, ""]] = number(default=1e-3)
    static: Converted[Float[Array, ""] | None] = number(default=None)
    stribeck: Converted[Float[Array, ""] | None] = number(default=None)

    def __call__(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """Tangential force over normal force, with the sign of the speed [m/s]."""
        coefficient = self.coefficient
        if self.static is not None and self.stribeck is not None:
            slow = jnp.exp(-((speed / self.stribeck) ** 2))
            coefficient = coefficient + (self.static - coefficient) * slow
        return coefficient * jnp.tanh(speed / self.creep)

    def check(self, owner: str) -> None:
        """Raise a SceneError that names owner, field, value and remedy."""
        if (self.static is None) != (self.stribeck is None):
            raise SceneError(f"{owner}: Friction needs both static and stribeck, or none of them.")
        fields = ("coefficient", "creep", "static", "stribeck")
        check_numbers(owner, self, *fields, sign="not negative", prefix="Friction.")
        check_numbers(owner, self, "creep", "stribeck", sign="positive", prefix="Friction.")


class Contact(AbstractMarkerEffect):
    """A point that is pushed out of a curve where it is inside, by a force that penalises depth.

    The normal force at the depth δ is k δ^(3/2) (1 + D δ'), never negative: Hertz's law with Hunt
    and Crossley's damping ("Coefficient of restitution interpreted as damping in vibroimpact",
    J. Appl. Mech. 42, 1975), for which slow impacts at speed v have a restitution of 1 − 2 D v / 3.

    **Arguments:**

    - `a`: the point. `b`: carries the curve; a `Line` is its x axis, and the inside below.
    - `curve`: a `Line`, a `Circle` or another, negative inside.
    - `stiffness`: k [N/m^(3/2)].
    - `dissipation`: D [s/m]; none unless given.
    - `friction`: a `Friction`; none unless given.
    """

    a: Marker
    b: Marker
    curve: AbstractCurve
    stiffness: Converted[Float[Array, ""]] = number()
    dissipation: Converted[Float[Array, ""] | None] = number(default=None)
    friction: Friction | None = None
    stores: ClassVar[bool] = True
    begins: ClassVar[bool] = True

    @property
    def needs_twists(self) -> bool:  # type: ignore[override]
        return self.dissipation is not None or self.friction is not None

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        """⅖ k δ^(5/2) of the depth: that of the normal force where the curve is a line. On curved
        ones δ is no distance, and what remains counts as power.
        """
        del t
        depth, inside, _ = self._depth(_local_point(*poses))
        return jnp.where(inside, 0.4 * self.stiffness * depth**2.5, 0.0)

    def wrenches(
        self, t: Time, poses: tuple[Pose, ...], twists: tuple[Twist, ...]
    ) -> tuple[Wrench, ...]:
        del t
        point, rate, wrenches = displacement(_local_point, poses, twists)
        depth, inside, normal = self._depth(point)
        push = self.stiffness * depth**1.5
        if self.dissipation is not None:
            push *= jnp.maximum(1 - self.dissipation * (normal @ rate()), 0)
        force = push * normal
        if self.friction is not None:
            tangent = jnp.stack([normal[1], -normal[0]])
            force -= push * self.friction(tangent @ rate()) * tangent
        return wrenches(jnp.where(inside, force, 0))

    def _depth(
        self, point: Float[Array, "2"]
    ) -> tuple[Float[Array, ""], Bool[Array, ""], Float[Array, "2"]]:
        """How deep a point in the frame of `b` is inside, whether it is, and the way out."""
        gap, slope = jax.value_and_grad(self.curve)(point)
        squared = slope @ slope
        # The centre of a circle has no direction out of it, and no force.
        steepness = jnp.sqrt(jnp.where(squared > 0, squared, 1.0))
        # Outside, a depth of one stands in: the power of a negative depth is NaN, which derivatives
        # pass through `where`.
        inside = gap < 0
        return jnp.where(inside, -gap / steepness, 1.0), inside, slope / steepness

    def outline(
        self, t: Time, poses: tuple[Pose, ...], size: Float[Array, ""]
    ) -> tuple[Outline, ...]:
        """The curve, and the point that it stops."""
        del t
        a, b = poses
        surface = placed(b, self.curve.outline(b.local(a.position), size))
        return (
            Outline(surface, "surface", endless=self.curve.endless),
            Outline(a.position[None], "point"),
        )

    def check(self) -> None:
        owner = check_markers(self)
        self.curve.check(owner)
        check_numbers(owner, self, "stiffness", "dissipation", sign="not negative")
        if self.friction is not None:
            self.friction.check(owner)


def _local_point(a: Pose, b: Pose) -> Float[Array, "2"]:
    """The position of `a` in the frame of `b` [m]."""
    return b.local(a.position)
