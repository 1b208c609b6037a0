"""Joints and effects of equal structure: stacked, and mapped over once."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common import compat
from ..common.arrays import Time
from ..linalg.indexing import Index
from ..scene.effect.base import AbstractMarkerEffect
from ..scene.joint.base import AbstractJoint
from ..scene.marker import Pose, Poses, Twist, Wrench, Wrenches
from ..system.schedule import AbstractStack
from ..system.standing import AbstractConstrained
from .grouping import T
from .kinematics import MarkerBlocks
from .pose_gradient import PoseGradient


class JointGroup(AbstractStack, AbstractConstrained):
    """Joints of equal structure; those that move with time stand as at `stands_at`, unless None."""

    joints: AbstractJoint  # stacked
    markers: MarkerBlocks
    rows: Index = eqx.field(static=True)  # among the constraints, (count, rows)
    stands_at: Time | None = None

    @property
    def kind(self) -> type:
        return type(self.joints)

    def standing_at(self, t: Time) -> "JointGroup":
        return dataclasses.replace(self, stands_at=t)

    def time(self, t: Time) -> Time:
        """The time that the residuals are taken at, when it is `t`."""
        return t if self.stands_at is None else self.stands_at

    def residual(self, t: Time, poses: Pose) -> Float[Array, "count rows"]:
        t = self.time(t)
        residuals: Float[Array, "count rows"]
        residuals = jax.vmap(lambda joint, poses: joint.residual(t, *poses))(
            self.joints, self.markers.take(poses)
        )
        return residuals

    def jacobian(
        self, t: Time, poses: Pose, motion: PoseGradient
    ) -> Float[Array, "side count rows size"]:
        """Derivatives with respect to the coordinates of the bodies on all sides."""
        t = self.time(t)

        def slopes(joint: AbstractJoint, poses: Poses) -> Poses:
            own, counters = self.bodies_of(poses), poses[len(self.bodies_of(poses)) :]
            sides: Poses
            sides = jax.jacrev(lambda own: joint.residual(t, *own, *counters))(own)
            return sides

        sides = jax.vmap(slopes)(self.joints, self.markers.take(poses))
        turns = self._depends_on_turns(t, poses)
        return jnp.stack(
            [
                gradient.chain(side, turns)
                for side, gradient in zip(
                    sides, self.bodies_of(self.markers.take(motion)), strict=True
                )
            ]
        )

    def _depends_on_turns(self, t: Time, poses: Pose) -> bool:
        """Whether the residuals depend on how the markers are turned, not only on where."""

        def residual(turns: Array, positions: Array) -> Array:
            return self.residual(t, Pose(positions, turns))

        slips = bool(self.joints.slips)  # their residual is zero, and depends on nothing
        return slips or compat.depends_on_first(residual, poses.turn, poses.position)

    def bodies_of(self, sides: tuple[T, ...]) -> tuple[T, ...]:
        """The sides without those of counters, on which the residual does not depend."""
        return sides[: len(self.joints.markers)]

    def wrenches(self, t: Time, poses: Pose, multipliers: Float[Array, " m"]) -> Wrenches:
        """Return the wrenches of the joints on all of their markers, one row per joint.

        The constraint forces −C_qᵀ λ, as wrenches at the poses that the residual is a function of.
        """
        t = self.time(t)

        def react(joint: AbstractJoint, own: Array, poses: Poses) -> Wrenches:
            # −(∂C/∂x)ᵀ λ, by the virtual work of the constraint forces.
            _, transpose = jax.vjp(lambda *poses: joint.residual(t, *poses), *poses)
            return tuple(p.wrench(force) for p, force in zip(poses, transpose(-own), strict=True))

        own, sides = self.rows.take(multipliers), self.markers.take(poses)
        wrenches: Wrenches = jax.vmap(react)(self.joints, own, sides)
        return wrenches


class EffectGroup(AbstractStack):
    """Effects of equal structure."""

    effects: AbstractMarkerEffect  # stacked
    markers: MarkerBlocks

    @property
    def kind(self) -> type:
        return type(self.effects)

    def wrenches(self, t: Time, poses: Pose, twists: Twist | None) -> list[Wrench]:
        """Wrenches on each side, one row per effect."""
        rates = self.markers.take(twists) if self.effects.needs_twists else ()
        return list(
            jax.vmap(lambda effect, poses, twists: effect.wrenches(t, poses, twists))(
                self.effects, self.markers.take(poses), rates
            )
        )

    def energy(self, t: Time, poses: Pose) -> Float[Array, " count"]:
        """The potential energy of each."""
        return self._each(lambda effect, sides: effect.energy(t, *sides), poses)

    def gaps(self, poses: Pose) -> Float[Array, " count"]:
        """How far each is from where it begins."""
        return self._each(lambda effect, sides: effect.room(*sides), poses)

    def limits(self, poses: Pose) -> Float[Array, " count"]:
        """The limit of each."""
        return self._each(lambda effect, sides: effect.limit(*sides), poses)

    def power(self, t: Time, poses: Pose, twists: Twist) -> Float[Array, " count"]:
        """The power of the forces of each that have no potential energy."""
        return self._each(lambda effect, *sides: effect.power(t, *sides), poses, twists)

    def _each(self, number: Callable[..., Array], *motions: Pose | Twist) -> Float[Array, " count"]:
        """A `number` of each effect, by the poses, and perhaps the twists, of its markers."""
        sides = [self.markers.take(motion) for motion in motions]
        each: Array = jax.vmap(number)(self.effects, *sides)
        return each

    def works(self, poses: Pose) -> bool:
        """Whether that is more than zero by definition."""
        if self.effects.supplies or self.effects.dissipates:
            return True
        return self.effects.stores and compat.depends_on_first(
            self.energy, jnp.zeros((), poses.position.dtype), poses
        )
