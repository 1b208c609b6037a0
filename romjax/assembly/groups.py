"""Groups of equal elements: stacked, and each mapped over once."""

import functools
import operator
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..arrays import Time
from ..linalg.indexing import Index
from ..scene.body.base import AbstractBody
from ..scene.effect.base import AbstractField, AbstractMarkerEffect
from ..scene.joint.base import AbstractJoint
from ..scene.marker import Pose, Twist, Wrench
from ..system.dynamics import quadratic_velocity_force
from .kinematics import MarkerBlocks, PoseGradient


class BodyGroup(eqx.Module):
    """Bodies of equal structure."""

    bodies: AbstractBody  # stacked
    coordinates: Index = eqx.field(static=True)  # (count, size)

    def mass(self, q: Float[Array, " n"]) -> Float[Array, "count size *size"]:
        """Mass matrices, or their diagonals where the bodies give these."""
        masses: Float[Array, "count size *size"]
        masses = jax.vmap(lambda body, q: body.mass_matrix(q))(
            self.bodies, self.coordinates.take(q)
        )
        return masses

    def force(
        self, fields: tuple[AbstractField, ...], q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Float[Array, "count size"] | None:
        """Elastic, damping, field and quadratic-velocity forces; None where there are none."""
        still: list[Callable[..., Float[Array, " size"]]] = [
            lambda body, q, field=field: -jax.grad(field.energy, argnums=1)(body, q)
            for field in fields
        ]
        moving: list[Callable[..., Float[Array, " size"]]] = []
        if self.bodies.modes:
            still.append(lambda body, q: -jax.grad(body.elastic_energy)(q))
        if self.bodies.damped:
            moving.append(lambda body, q, v: body.damping_force(v))
        if not self.bodies.constant_mass:
            moving.append(lambda body, q, v: quadratic_velocity_force(body.mass_matrix)(q, v))
        if not still and not moving:
            return None

        def total(body: AbstractBody, q: Array, *v: Array) -> Array:
            terms = [term(body, q) for term in still] + [term(body, q, *v) for term in moving]
            return functools.reduce(operator.add, terms)

        rates = [self.coordinates.take(v)] if moving else []
        return jax.vmap(total)(self.bodies, self.coordinates.take(q), *rates)


class JointGroup(eqx.Module):
    """Joints of equal structure."""

    joints: AbstractJoint  # stacked
    markers: MarkerBlocks
    rows: Index = eqx.field(static=True)  # among the constraints, (count, rows)

    def residual(self, t: Time, poses: Pose) -> Float[Array, "count rows"]:
        residuals: Float[Array, "count rows"]
        residuals = jax.vmap(lambda joint, a, b: joint.residual(t, a, b))(
            self.joints, *self.markers.take(poses)
        )
        return residuals

    def jacobian(
        self, t: Time, poses: Pose, motion: PoseGradient
    ) -> Float[Array, "side count rows size"]:
        """Derivatives with respect to the coordinates of the bodies on both sides."""

        def gradient(joint: AbstractJoint, a: Pose, b: Pose) -> tuple[Pose, Pose]:
            sides: tuple[Pose, Pose]
            sides = jax.jacrev(lambda a, b: joint.residual(t, a, b), argnums=(0, 1))(a, b)
            return sides

        sides = jax.vmap(gradient)(self.joints, *self.markers.take(poses))
        return jnp.stack(
            [
                side.position @ pose.position + side.angle[:, :, None] * pose.angle[:, None]
                for side, pose in zip(sides, self.markers.take(motion), strict=True)
            ]
        )


class EffectGroup(eqx.Module):
    """Effects of equal structure."""

    effects: AbstractMarkerEffect  # stacked
    markers: MarkerBlocks

    def wrenches(self, t: Time, poses: Pose, twists: Twist | None) -> list[Wrench]:
        """Wrenches on each side, one row per effect."""
        rates = self.markers.take(twists) if self.effects.needs_twists else ()
        return list(
            jax.vmap(lambda effect, poses, twists: effect.wrenches(t, poses, twists))(
                self.effects, self.markers.take(poses), rates
            )
        )
