"""The system of a scene: groups of equal elements, each mapped over once."""

import dataclasses
import functools
import operator
from collections.abc import Collection, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..linalg.indexing import spread
from ..linalg.inverse_mass import InverseMass
from ..linalg.pattern import Pattern
from ..scene.body.capped import CappedBody
from ..scene.effect.base import AbstractField
from ..scene.points import NamedPoints
from ..system.base import AbstractSystem
from ..system.state import FullState, Power
from ..system.structure import Structure
from .body_group import BodyGroup
from .controllers import Controller, told
from .groups import EffectGroup, JointGroup
from .kinematics import Markers
from .slopes import slopes
from .slow_modes import SlowModes
from .wrenches import effect_wrenches


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
    structure: Structure = eqx.field(static=True)
    pattern: Pattern = eqx.field(static=True)
    controllers: tuple[Controller, ...] = ()
    points: tuple[NamedPoints, ...] = ()  # of the bodies of the scene, in its order

    @property
    def full(self) -> AbstractSystem:
        return self

    @property
    def validity(self) -> SlowModes | None:
        # A run is doubtful where capped modes are excited, which only the scene's bodies know.
        capped = any(isinstance(group.bodies, CappedBody) for group in self.bodies)
        return SlowModes() if capped else None

    def state(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> FullState:
        now = self.now(v)
        # Functions, each called once when something asks for it: what nobody uses is not traced.
        return FullState(
            q,
            v,
            now.pattern,
            lambda: now.mass_blocks(q),
            lambda: now.jacobian_blocks(t, q),
            lambda: now.force(t, q, v),
            lambda q: now.stored(t, q),
            lambda: now.power(t, q, v),
            lambda: now._force(t, q, v, quadratic=False),
            lambda: now.inverse_mass(q),
            lambda: now.gaps(q),
            lambda: now.limits(q),
            lambda *solved: slopes(now, t, q, v, *solved) if now.structure.by_parts else None,
            now.structure.without_states(v) if now.structure.states else None,
        )

    def now(self, v: Float[Array, " n"]) -> "AssembledSystem":
        """The system with the values that its controllers have set, which velocities have."""
        if not self.controllers:
            return self
        return dataclasses.replace(self, effects=told(self.controllers, self.effects, v))

    def stored(self, t: Time, q: Float[Array, " n"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """The elastic energy of the bodies, and that of fields and effects [J]."""
        elastic = [group.elastic_energy(q) for group in self.bodies]
        other = [group.field_energy(self.fields, q) for group in self.bodies]
        storing = [group for group in self.effects if group.effects.stores]
        if storing and self.effect_markers is not None:
            poses = self.effect_markers.poses(q)
            other += [group.energy(t, poses) for group in storing]
        zero = jnp.zeros((), q.dtype)
        return _total(elastic, zero), _total(other, zero)

    def power(
        self,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        without: Collection[int] = (),
    ) -> Power | None:
        """The power of the forces that have no potential energy, but for the groups of effects
        `without`; None where all have one.
        """
        taken = [group.damping_power(v) for group in self.bodies]
        given = list[Array | None]()
        if self.effect_markers is not None:
            poses, twists = self.effect_markers.motion(q, v)
            for group, acts in zip(self.now(v).effects, self.acting(without), strict=True):
                if acts and group.works(poses):
                    # What only takes energy is kept apart: dampers that gave some would be an error
                    # of the run, and the audit looks for it.
                    only_taken = group.effects.dissipates and not group.effects.supplies
                    (taken if only_taken else given).append(group.power(t, poses, twists))
        if all(term is None for term in taken + given):
            return None
        zero = jnp.zeros((), q.dtype)
        return Power(_total(taken, zero), _total(given, zero))

    def gaps(self, q: Float[Array, " n"]) -> Float[Array, " contacts"] | None:
        """How far all effects that may begin are from that; None where none may."""
        groups = [group for group in self.effects if group.effects.begins]
        if self.effect_markers is None or not groups:
            return None
        poses = self.effect_markers.poses(q)
        return jnp.concatenate([group.gaps(poses) for group in groups])

    def limits(self, q: Float[Array, " n"]) -> Float[Array, " effects"] | None:
        """Return numbers that change sign where effects pass their limits; None without limits."""
        groups = [group for group in self.effects if group.effects.limited]
        if self.effect_markers is None or not groups:
            return None
        poses = self.effect_markers.poses(q)
        return jnp.concatenate([group.limits(poses) for group in groups])

    def mass_blocks(self, q: Float[Array, " n"]) -> Float[Array, "bodies size *size"]:
        """Mass matrices of the bodies, padded to one size by ones on the diagonal; the diagonals
        alone where all are diagonal.
        """
        blocks = [group.mass(q) for group in self.bodies]
        size, dtype = self.pattern.coordinates.width, blocks[0].dtype
        # Rigid bodies about their centres of mass have diagonal matrices, held as vectors: their
        # inverse is then a division.
        diagonal = all(block.ndim == 2 for block in blocks)
        padded = []
        for block in blocks:
            more = size - block.shape[1]
            if diagonal:
                padded.append(jnp.pad(block, ((0, 0), (0, more)), constant_values=1))
            else:
                full = jax.vmap(jnp.diag)(block) if block.ndim == 2 else block
                ones = np.diag(np.arange(size) >= block.shape[1]).astype(dtype)
                padded.append(jnp.pad(full, ((0, 0), (0, more), (0, more))) + ones[None])
        return jnp.concatenate(padded)

    def inverse_mass(self, q: Float[Array, " n"]) -> InverseMass | None:
        """Inverse of `mass_blocks`; None where not all bodies know theirs."""
        inverses = [group.inverse_mass(q) for group in self.bodies]
        known = tuple(inverse for inverse in inverses if inverse is not None)
        return InverseMass(known) if len(known) == len(inverses) else None

    def mass(self, q: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Mass matrix M, block-diagonal by body."""
        return self.pattern.apply_mass(self.mass_blocks(q), jnp.eye(self.n, dtype=q.dtype))

    def force(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
        return self._force(t, q, v)

    def _force(
        self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"], quadratic: bool = True
    ) -> Float[Array, " n"]:
        own = [group.force(self.fields, q, v, quadratic) for group in self.bodies]
        total = self.body_force(own, q)
        return total if self.effect_markers is None else total + self.effect_force(t, q, v)

    def body_force(
        self, own: Sequence[Float[Array, "_ _"] | None], q: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Q of the forces on the bodies of each group."""
        acting = [(g, x) for g, x in zip(self.bodies, own, strict=True) if x is not None]
        if not acting:
            # Zeros made from q have its type and its batch.
            return 0 * q
        columns = [group.coordinates.array for group, _ in acting]
        return spread([force for _, force in acting], columns, (self.n,))

    def acting(self, without: Collection[int] = ()) -> list[bool]:
        """Return the groups of effects that have wrenches, but for those `without`."""
        return [group.effects.acts and i not in without for i, group in enumerate(self.effects)]

    def effect_force(
        self,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        without: Collection[int] = (),
    ) -> Float[Array, " n"]:
        """Q of all effects on markers, but for the groups `without`."""
        acting = self.acting(without)
        if self.effect_markers is None or not any(acting):
            return 0 * q
        wrenches = effect_wrenches(self.now(v).effects, self.effect_markers, t, q, v, acting)
        return self.effect_markers.pull_back(q, wrenches)

    def constraint(self, t: Time, q: Float[Array, " n"]) -> Float[Array, " m"]:
        if self.joint_markers is None:
            return jnp.zeros(0, q.dtype)
        poses = self.joint_markers.poses(q)
        blocks = [group.residual(t, poses) for group in self.joints]
        return spread(blocks, [group.rows.array for group in self.joints], (self.m,))

    def jacobian_blocks(self, t: Time, q: Float[Array, " n"]) -> Float[Array, "sides height size"]:
        """The blocks of C_q: one for each joint and body, by the chain rule."""
        pattern = self.pattern
        shape = (len(pattern.nodes), pattern.rows.width, pattern.coordinates.width)
        if self.joint_markers is None:
            return jnp.zeros(shape, q.dtype)
        # C_q = ∂C/∂(poses) · ∂(poses)/∂q: both factors are small and equal for equal joints.
        poses, motion = self.joint_markers.poses(q), self.joint_markers.jacobian(q)
        columns = self.joint_markers.coordinates()
        blocks, indices = [], []
        for group in self.joints:
            blocks.append(group.jacobian(t, poses, motion))
            rows = group.rows.array
            indices.append(
                pattern.flat_indices(rows, np.stack(group.bodies_of(group.markers.take(columns))))
            )
        return spread(blocks, indices, shape)


def _total(parts: Sequence[Array | None], zero: Array) -> Float[Array, ""]:
    """The sum over all parts of all groups, a vector for each group."""
    return functools.reduce(operator.add, [jnp.sum(x) for x in parts if x is not None], zero)


def mechanism_of(system: AbstractSystem) -> AssembledSystem | None:
    """The system of bodies that a full or reduced one stands for; None of one without bodies."""
    full = system.full
    return full if isinstance(full, AssembledSystem) else None


def groups_of(system: AbstractSystem) -> tuple[BodyGroup, ...]:
    """The bodies of a full or reduced system, in groups."""
    mechanism = mechanism_of(system)
    return () if mechanism is None else mechanism.bodies


def controllers_of(system: AbstractSystem) -> tuple[Controller, ...]:
    """The controllers with a clock of a full or reduced system."""
    mechanism = mechanism_of(system)
    return () if mechanism is None else mechanism.controllers
