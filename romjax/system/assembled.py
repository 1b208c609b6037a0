"""The system of a scene: groups of equal elements, each mapped over once."""

import functools
import operator
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..scene.body.base import AbstractBody
from ..scene.effect.base import AbstractField, AbstractMarkerEffect
from ..scene.fields import Time
from ..scene.joint.base import AbstractJoint
from ..scene.marker import Pose, Twist, Wrench
from .base import AbstractSystem, quadratic_velocity_force
from .grouping import Index
from .kinematics import Markers, PoseGradient, Slots


class BodyGroup(eqx.Module):
    """Bodies of equal structure."""

    bodies: AbstractBody  # stacked
    coordinates: Index = eqx.field(static=True)  # (count, size)

    def mass(self, q: Float[Array, " n"]) -> Float[Array, "count size *size"]:
        """Mass matrices, or their diagonals where the bodies give these."""
        return jax.vmap(lambda body, q: body.mass_matrix(q))(self.bodies, self.coordinates.take(q))

    def force(
        self, fields: tuple[AbstractField, ...], q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> Float[Array, "count size"] | None:
        """Elastic, field and quadratic-velocity forces; None where the bodies call for none."""
        terms: list[Callable[..., Float[Array, " size"]]] = [
            lambda body, q, v, field=field: -jax.grad(field.energy, argnums=1)(body, q)
            for field in fields
        ]
        if self.bodies.modes:
            terms.append(lambda body, q, v: -jax.grad(body.elastic_energy)(q))
        if not self.bodies.constant_mass:
            terms.append(lambda body, q, v: quadratic_velocity_force(body.mass_matrix)(q, v))
        if not terms:
            return None

        def total(*arguments):  # type: ignore[no-untyped-def]
            return functools.reduce(operator.add, [term(*arguments) for term in terms])

        return jax.vmap(total)(self.bodies, self.coordinates.take(q), self.coordinates.take(v))


class JointGroup(eqx.Module):
    """Joints of equal structure."""

    joints: AbstractJoint  # stacked
    slots: Slots
    places: Index = eqx.field(static=True)  # of their rows among the constraints, (count, rows)

    def residual(self, t: Time, poses: Pose) -> Float[Array, "count rows"]:
        return jax.vmap(lambda joint, a, b: joint.residual(t, a, b))(
            self.joints, *self.slots.take(poses)
        )

    def jacobian(
        self, t: Time, poses: Pose, motion: PoseGradient
    ) -> Float[Array, "side count rows size"]:
        """Derivatives with respect to the coordinates of the bodies on both sides."""

        def gradient(joint, a, b):  # type: ignore[no-untyped-def]
            return jax.jacrev(lambda a, b: joint.residual(t, a, b), argnums=(0, 1))(a, b)

        sides = jax.vmap(gradient)(self.joints, *self.slots.take(poses))
        return jnp.stack(
            [
                side.position @ moved.position + side.angle[:, :, None] * moved.angle[:, None]
                for side, moved in zip(sides, self.slots.take(motion), strict=True)
            ]
        )


class EffectGroup(eqx.Module):
    """Effects of equal structure."""

    effects: AbstractMarkerEffect  # stacked
    slots: Slots

    def wrenches(self, t: Time, poses: Pose, twists: Twist | None) -> list[Wrench]:
        """Wrenches on each side, one row per effect."""
        rates = self.slots.take(twists) if self.effects.needs_twists else ()
        return list(
            jax.vmap(lambda effect, poses, twists: effect.wrenches(t, poses, twists))(
                self.effects, self.slots.take(poses), rates
            )
        )


class AssembledSystem(AbstractSystem):
    """The equations of motion of a Scene; made by `assemble`."""

    bodies: tuple[BodyGroup, ...]
    joints: tuple[JointGroup, ...]
    joint_markers: Markers | None
    effects: tuple[EffectGroup, ...]
    effect_markers: Markers | None
    fields: tuple[AbstractField, ...]
    q0: Float[Array, " n"]
    v0: Float[Array, " n"]
    labels: tuple[str, ...] = eqx.field(static=True)
    modal: tuple[bool, ...] = eqx.field(static=True)
    constraint_labels: tuple[str, ...] = eqx.field(static=True)

    @property
    def m(self) -> int:
        return len(self.constraint_labels)

    def coordinate_labels(self) -> tuple[str, ...]:
        return self.labels

    def constraint_label(self, row: int) -> str:
        return f"joint '{self.constraint_labels[row]}'"

    def rigid(self) -> Bool[Array, " n"]:
        return ~jnp.array(self.modal)

    def mass_diagonal(self, q: Float[Array, " n"]) -> Float[Array, " n"] | None:
        """Diagonal of M where every body has a diagonal mass matrix, else None."""
        blocks = [group.mass(q) for group in self.bodies]
        if any(block.ndim == 3 for block in blocks):
            return None
        return _spread(blocks, [group.coordinates.array for group in self.bodies], (self.n,))

    def mass(self, q: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Mass matrix M, block-diagonal by body."""
        diagonal = self.mass_diagonal(q)
        if diagonal is not None:
            return jnp.diag(diagonal)
        blocks, places = [], []
        for group in self.bodies:
            block, index = group.mass(q), group.coordinates.array.astype(int)
            blocks.append(jax.vmap(jnp.diag)(block) if block.ndim == 2 else block)
            places.append(index[:, :, None] * self.n + index[:, None, :])
        return _spread(blocks, places, (self.n, self.n))

    def force(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
        own = [(group, group.force(self.fields, q, v)) for group in self.bodies]
        acting = [(group, force) for group, force in own if force is not None]
        places = [group.coordinates.array for group, _ in acting]
        total = _spread([force for _, force in acting], places, (self.n,)) if acting else 0 * q
        if self.effect_markers is None:
            return total
        twists = None
        if any(group.effects.needs_twists for group in self.effects):
            poses, rates = jax.jvp(self.effect_markers.poses, (q,), (v,))
            twists = Twist(rates.position, rates.angle)
        else:
            poses = self.effect_markers.poses(q)
        found = [wrench for group in self.effects for wrench in group.wrenches(t, poses, twists)]
        wrenches = jax.tree.map(lambda *x: jnp.concatenate(x), *found)
        return total + self.effect_markers.pull_back(q, wrenches)

    def constraint(self, t: Time, q: Float[Array, " n"]) -> Float[Array, " m"]:
        if self.joint_markers is None:
            return jnp.zeros(0, q.dtype)
        poses = self.joint_markers.poses(q)
        blocks = [group.residual(t, poses) for group in self.joints]
        return _spread(blocks, [group.places.array for group in self.joints], (self.m,))

    def jacobian(self, t: Time, q: Float[Array, " n"]) -> Float[Array, "m n"]:
        """Constraint Jacobian C_q: one block for each joint and side, by the chain rule."""
        if self.joint_markers is None:
            return jnp.zeros((0, self.n), q.dtype)
        poses, motion = self.joint_markers.poses(q), self.joint_markers.jacobian(q)
        blocks, places = [], []
        for group in self.joints:
            blocks.append(group.jacobian(t, poses, motion))
            columns = np.stack(group.slots.take(self.joint_markers.coordinates()))[:, :, None]
            rows = group.places.array.astype(int)[None, :, :, None]
            places.append(np.where(columns == self.n, -1, rows * self.n + columns))
        return _spread(blocks, places, (self.m, self.n))


def _spread(
    blocks: list[Float[Array, "..."]], places: list[np.ndarray], shape: tuple[int, ...]
) -> Float[Array, "..."]:
    """An array with the entries of `blocks` at flat `places` (−1: nowhere), zero elsewhere.

    A gather with a static index: XLA's CPU scatter runs entry by entry.
    """
    entries = jnp.concatenate([block.reshape(-1) for block in blocks])
    place = np.concatenate([p.reshape(-1) for p in places]).astype(int)
    if np.array_equal(place, np.arange(np.prod(shape))):
        return entries.reshape(shape)
    source = np.full(int(np.prod(shape)), entries.size, dtype=np.uint32)
    source[place[place >= 0]] = np.flatnonzero(place >= 0)
    padded = jnp.concatenate([entries, np.zeros(1, entries.dtype)])
    return padded[source].reshape(shape)
