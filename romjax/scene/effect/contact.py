"""Contact of a point with a curve, with friction if asked for."""

import abc
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...common.arrays import Time
from ...common.errors import SceneError
from ..curve import AbstractCurve
from ..drawing import placed
from ..fields import Converted, check_numbers, number
from ..marker import Marker, Pose, Poses, Twists, Wrenches
from ..outline import Outline, Outlines
from .base import AbstractMarkerEffect, check_markers, displacement

# A depth at which contacts are as stiff as those that bodies rest on, within factors that count by
# their fourth root [m].
_DEPTH = 1e-3


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

    def against(
        self, normal: Float[Array, " d"], velocity: Float[Array, " d"]
    ) -> Float[Array, " d"]:
        """Return the tangential over the normal force of a point on a surface with this `normal`.

        It points along the velocity: the force of the surface on the point is the opposite.
        """
        if normal.shape == (2,):
            tangent = jnp.stack([normal[1], -normal[0]])
            return self(tangent @ velocity) * tangent
        sliding = velocity - jnp.sum(normal * velocity) * normal
        # A length has no derivative at zero; a trillionth more of the creep changes no digit.
        speed = jnp.sqrt(jnp.sum(sliding**2) + (1e-6 * self.creep) ** 2)
        return self(speed) / speed * sliding

    def check(self, owner: str) -> None:
        """Raise a SceneError that names owner, field, value and remedy."""
        if (self.static is None) != (self.stribeck is None):
            raise SceneError(
                f"{owner}: Friction needs both static and stribeck, or none of them.",
            )
        fields = ("coefficient", "creep", "static", "stribeck")
        check_numbers(owner, self, *fields, sign="not negative", prefix="Friction.")
        check_numbers(owner, self, "creep", "stribeck", sign="positive", prefix="Friction.")


class AbstractContact(AbstractMarkerEffect):
    """A force that pushes marker `a` out of what marker `b` carries, and rubs, as in `Contact`.

    A contact of one's own says by `gap` where the inside is, and by `wrenches` at which point the
    force acts.
    """

    if TYPE_CHECKING:
        # As fields of this class they would come before those of contacts to type checkers.
        @property
        def stiffness(self) -> Float[Array, ""]: ...
        @property
        def dissipation(self) -> Float[Array, ""] | None: ...
        @property
        def friction(self) -> Friction | None: ...
    else:
        stiffness: eqx.AbstractVar[Float[Array, ""]]
        dissipation: eqx.AbstractVar[Float[Array, ""] | None]
        friction: eqx.AbstractVar[Friction | None]
    stores: ClassVar[bool] = True
    begins: ClassVar[bool] = True

    @property
    def needs_twists(self) -> bool:  # type: ignore[override]
        return self.dissipation is not None or self.friction is not None

    @abc.abstractmethod
    def gap(self, point: Float[Array, " d"]) -> Float[Array, ""]:
        """How far `a`, at a point in the frame of `b`, is outside [m]; negative inside."""

    def room(self, *poses: Pose) -> Float[Array, ""]:
        return self.gap(local_point(*poses))

    def acting(self, acts: Bool[Array, ""]) -> "AbstractMarkerEffect | None":
        """Return the contact as the spring that it is about a depth of a millimetre, if it is to
        act, else as it is; None with friction, which sticks as fast as its creep is slow.
        """
        if self.friction is not None or self.held(jnp.zeros(())) is None:
            return None
        return _Pressed(self, jnp.broadcast_to(acts, jnp.shape(self.stiffness)))

    def held(self, side: Float[Array, ""]) -> "AbstractContact":
        """Return the contact without its force, or as it is: no law goes on smoothly outside."""
        held: AbstractContact = eqx.tree_at(
            lambda x: x.stiffness, self, jnp.where(side > 0, 0.0, self.stiffness)
        )
        return held

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        """⅖ k δ^(5/2) of the depth: that of the normal force where δ is a distance, as for all
        curves and surfaces of romjax. On curved ones of your own that say none it is an estimate,
        and what remains counts as power.
        """
        del t
        depth, inside, _ = self.depth(local_point(*poses))
        return jnp.where(inside, 0.4 * self.stiffness * depth**2.5, 0.0)

    def force(
        self,
        depth: Float[Array, ""],
        inside: Bool[Array, ""],
        normal: Float[Array, " d"],
        rate: Callable[[], Float[Array, " d"]],
    ) -> Float[Array, " d"]:
        """Return the force on `a` in the frame of `b` [N].

        `depth`: that of `a` in the surface; `rate`: the velocity of the touching point.
        """
        push = self.stiffness * depth**1.5
        if self.dissipation is not None:
            push *= jnp.maximum(1 - self.dissipation * (normal @ rate()), 0)
        force = push * normal
        if self.friction is not None:
            force -= push * self.friction.against(normal, rate())
        return jnp.where(inside, force, 0)

    def depth(
        self, point: Float[Array, " d"]
    ) -> tuple[Float[Array, ""], Bool[Array, ""], Float[Array, " d"]]:
        """How deep a point in the frame of `b` is inside, whether it is, and the way out."""
        gap, slope = jax.value_and_grad(self.gap)(point)
        squared = slope @ slope
        # The centre of a circle has no direction out of it, and no force.
        steepness = jnp.sqrt(jnp.where(squared > 0, squared, 1.0))
        # Outside, a depth of one stands in: the power of a negative depth is NaN, which derivatives
        # pass through `where`.
        inside = gap < 0
        return jnp.where(inside, -gap / steepness, 1.0), inside, slope / steepness


class _Pressed(AbstractMarkerEffect):
    """A contact that may be a spring, along its gap, at any state."""

    contact: AbstractContact
    pressed: Bool[Array, ""]

    @property
    def markers(self) -> tuple[Marker, ...]:
        return self.contact.markers

    @property
    def needs_twists(self) -> bool:  # type: ignore[override]
        return self.contact.needs_twists

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        gap, _, wrenches = displacement(self.contact.room, poses, ())
        # A law of one's own may have another exponent, so that the force itself is asked. Hertz's
        # is 1.2 times as fast where it is twice as deep.
        spring = wrenches(-self._stiffness(poses[0].position) * gap)
        own = self.contact.wrenches(t, poses, twists)
        chosen: Wrenches = jax.tree.map(partial(jnp.where, self.pressed), spring, own)
        return chosen

    def _stiffness(self, like: Float[Array, " d"]) -> Float[Array, ""]:
        """The slope of the normal force at rest over the depth [N/m], at that of `_DEPTH`."""
        still = jnp.zeros_like(like)
        normal = still.at[0].set(1)

        def push(depth: Float[Array, ""]) -> Float[Array, ""]:
            return self.contact.force(depth, jnp.ones((), bool), normal, lambda: still)[0]

        slope: Float[Array, ""] = jax.grad(push)(jnp.asarray(_DEPTH, like.dtype))
        return slope

    def check(self) -> None:
        """Nothing: the contact has been checked."""


class Contact(AbstractContact):
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
    at_points: ClassVar[tuple[int, ...]] = (0,)

    def gap(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        return self.curve.distance(point)

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del t
        point, rate, wrenches = displacement(local_point, poses, twists)
        return wrenches(self.force(*self.depth(point), rate))

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """The curve, and the point that it stops."""
        del t
        a, b = poses
        surface = placed(b, self.curve.outline(b.local(a.position), size))
        return (
            Outline(surface, "surface", endless=self.curve.endless),
            Outline(a.position[None], "point"),
        )

    def check(self) -> None:
        self.curve.check(check_contact(self))


def local_point(a: Pose, b: Pose) -> Float[Array, " d"]:
    """The position of `a` in the frame of `b` [m]."""
    return b.local(a.position)


def check_contact(contact: AbstractContact) -> str:
    """Check what all contacts have; returns how messages call one."""
    owner = check_markers(contact)
    check_numbers(owner, contact, "stiffness", "dissipation", sign="not negative")
    if contact.friction is not None:
        contact.friction.check(owner)
    return owner
