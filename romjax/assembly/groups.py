"""Groups of equal elements: stacked, and each mapped over once."""

import functools
import operator
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..common import compat
from ..common.arrays import Time
from ..linalg.dense import multiply
from ..linalg.indexing import Index
from ..linalg.inverse_mass import AbstractBodyInverse
from ..scene.body.base import AbstractBody
from ..scene.effect.base import AbstractField, AbstractMarkerEffect
from ..scene.joint.base import AbstractJoint
from ..scene.marker import Pose, Poses, Twist, Wrench, Wrenches
from ..system.dynamics import quadratic_velocity_force
from ..system.schedule import AbstractStack
from .grouping import T
from .kinematics import MarkerBlocks
from .pose_gradient import PoseGradient


class BodyGroup(AbstractStack):
    """Bodies of equal structure; `weights` multiply the Lagrangian of each, and what follows."""

    bodies: AbstractBody  # stacked
    coordinates: Index = eqx.field(static=True)  # (count, size)
    weights: Float[Array, " count"] | None = None  # None: all are one

    @property
    def kind(self) -> type:
        return type(self.bodies)

    def mass(self, q: Float[Array, " n"]) -> Float[Array, "count size *size"]:
        """Mass matrices, or their diagonals where the bodies give these."""
        masses: Float[Array, "count size *size"]
        masses = jax.vmap(lambda body, q: body.mass_matrix(q))(
            self.bodies, self.coordinates.take(q)
        )
        return self.weighted(masses)

    def inverse_mass(self, q: Float[Array, " n"]) -> AbstractBodyInverse | None:
        """Inverses of the mass matrices; None where bodies know none."""
        if not self.bodies.inverts_mass or self.weights is not None:
            return None
        inverses: AbstractBodyInverse = jax.vmap(lambda body, q: body.inverse_mass(q))(
            self.bodies, self.coordinates.take(q)
        )
        return inverses

    def force(
        self,
        fields: tuple[AbstractField, ...],
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        quadratic: bool = True,
    ) -> Float[Array, "count size"] | None:
        """Elastic, damping, field and `quadratic` velocity forces; None where there are none."""
        if (total := self._total(fields, quadratic)) is None:
            return None
        own = [self.coordinates.take(x) for x in (q, v)[: 1 + self._moving]]
        return self.weighted(jax.vmap(total)(self.bodies, *own))

    def acts(self, fields: tuple[AbstractField, ...], quadratic: bool) -> bool:
        """Whether there is a `force` of these."""
        return self._total(fields, quadratic) is not None

    def slopes(
        self,
        fields: tuple[AbstractField, ...],
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        a: Float[Array, " n"],
    ) -> tuple[Float[Array, "count size size"] | None, Float[Array, "count size size"] | None]:
        """∂/∂q and ∂/∂v of M a − Q of each, with the `force` for Q; None where it is zero."""
        total, constant = self._total(fields), self.bodies.constant_mass
        if total is None and constant:
            return None, None

        def residual(body: AbstractBody, a: Array, q: Array, *v: Array) -> Array:
            force = jnp.zeros_like(q) if total is None else -total(body, q, *v)
            if constant:
                return force
            mass = body.mass_matrix(q)
            return force + (mass * a if mass.ndim == 1 else multiply(mass, a))

        own = [self.coordinates.take(x) for x in (a, q, v)[: 2 + self._moving]]
        by_state = jax.jacfwd(residual, argnums=tuple(range(2, len(own) + 1)))
        slopes = [self.weighted(x) for x in jax.vmap(by_state)(self.bodies, *own)]
        return slopes[0], slopes[1] if self._moving else None

    @property
    def _moving(self) -> bool:
        """Whether forces of the bodies depend on velocities."""
        return self.bodies.damped or not self.bodies.constant_mass

    def _total(
        self, fields: tuple[AbstractField, ...], quadratic: bool = True
    ) -> Callable[..., Array] | None:
        """The `force` of one body as a function of it, q and, if it is moving, v."""
        still: list[Callable[..., Float[Array, " size"]]] = [
            lambda body, q, field=field: field.force(body, q) for field in fields
        ]
        moving: list[Callable[..., Float[Array, " size"]]] = []
        if self.bodies.modes:
            still.append(lambda body, q: -jax.grad(body.elastic_energy)(q))
        if self.bodies.damped:
            moving.append(lambda body, q, v: body.damping_force(v))
        if quadratic and not self.bodies.constant_mass:
            moving.append(_quadratic_velocity_force)
        if not still and not moving:
            return None

        def total(body: AbstractBody, q: Array, *v: Array) -> Array:
            terms = [term(body, q) for term in still] + [term(body, q, *v) for term in moving]
            return functools.reduce(operator.add, terms)

        return total

    def kinetic_energy(
        self, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Float[Array, " count"]:
        """The kinetic energy of each."""
        mass, own = self.mass(q), self.coordinates.take(v)
        momentum = mass * own if mass.ndim == 2 else jax.vmap(multiply)(mass, own)
        return 0.5 * jnp.sum(own * momentum, axis=1)

    def elastic_energy(self, q: Float[Array, " n"]) -> Float[Array, " count"] | None:
        """The strain energy of each; None of bodies that do not deform."""
        if not self.bodies.modes:
            return None
        own = self.coordinates.take(q)
        each: Array = jax.vmap(lambda body, q: body.elastic_energy(q))(self.bodies, own)
        return self.weighted(each)

    def field_energy(
        self, fields: tuple[AbstractField, ...], q: Float[Array, " n"]
    ) -> Float[Array, " count"] | None:
        """The energy of each in all fields; None without fields."""
        if not fields:
            return None
        own = self.coordinates.take(q)
        each = [jax.vmap(field.energy)(self.bodies, own) for field in fields]
        return self.weighted(functools.reduce(operator.add, each))

    def damping_power(self, v: Float[Array, " n"]) -> Float[Array, " count"] | None:
        """The power of the own damping of each; None where there is none."""
        if not self.bodies.damped:
            return None
        own = self.coordinates.take(v)
        damping = jax.vmap(lambda body, v: body.damping_force(v))(self.bodies, own)
        return self.weighted(jnp.sum(own * damping, axis=1))

    def weighted(self, x: Float[Array, "count *k"]) -> Float[Array, "count *k"]:
        """Terms of the Lagrangian of each body, times its weight."""
        if self.weights is None:
            return x
        return x * self.weights.reshape(self.weights.shape + (1,) * (x.ndim - 1))


def _quadratic_velocity_force(
    body: AbstractBody, q: Float[Array, " size"], v: Float[Array, " size"]
) -> Float[Array, " size"]:
    """Return the force that the body defines, or else that from its mass matrix by autodiff."""
    own = body.quadratic_velocity_force(q, v)
    force: Array = quadratic_velocity_force(body.mass_matrix)(q, v) if own is None else own
    return force


class JointGroup(AbstractStack):
    """Joints of equal structure."""

    joints: AbstractJoint  # stacked
    markers: MarkerBlocks
    rows: Index = eqx.field(static=True)  # among the constraints, (count, rows)

    @property
    def kind(self) -> type:
        return type(self.joints)

    def residual(self, t: Time, poses: Pose) -> Float[Array, "count rows"]:
        residuals: Float[Array, "count rows"]
        residuals = jax.vmap(lambda joint, poses: joint.residual(t, *poses))(
            self.joints, self.markers.take(poses)
        )
        return residuals

    def jacobian(
        self, t: Time, poses: Pose, motion: PoseGradient
    ) -> Float[Array, "side count rows size"]:
        """Derivatives with respect to the coordinates of the bodies on all sides."""

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
