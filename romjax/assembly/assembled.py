"""The system of a scene: groups of equal elements, each mapped over once."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..arrays import Time
from ..linalg.dense import multiply
from ..linalg.indexing import spread
from ..linalg.kkt import Saddle
from ..linalg.pattern import Topology
from ..scene.coordinate import Coordinate
from ..scene.effect.base import AbstractField
from ..scene.marker import Twist
from ..system.base import AbstractSystem
from .groups import BodyGroup, EffectGroup, JointGroup
from .kinematics import Markers


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
    coordinates: tuple[Coordinate, ...] = eqx.field(static=True)
    modal: tuple[bool, ...] = eqx.field(static=True)
    topology: Topology = eqx.field(static=True)
    constraint_labels: tuple[str, ...] = eqx.field(static=True)

    @property
    def m(self) -> int:
        return len(self.constraint_labels)

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(coordinate.label for coordinate in self.coordinates)

    def coordinate_labels(self) -> tuple[str, ...]:
        return self.labels

    def constraint_label(self, row: int) -> str:
        return f"joint '{self.constraint_labels[row]}'"

    @property
    def flexible(self) -> bool:
        return any(self.modal)

    def rigid(self) -> Bool[Array, " n"]:
        return ~jnp.array(self.modal)

    def mass_blocks(self, q: Float[Array, " n"]) -> Float[Array, "bodies size *size"]:
        """Mass matrices of the bodies, padded to one size by ones on the diagonal; the diagonals
        alone where all are diagonal.
        """
        size = self.topology.coordinates.width
        blocks = [group.mass(q) for group in self.bodies]
        diagonal = all(block.ndim == 2 for block in blocks)
        whole = []
        for block in blocks:
            more = size - block.shape[1]
            if diagonal:
                whole.append(jnp.pad(block, ((0, 0), (0, more)), constant_values=1))
            else:
                full = jax.vmap(jnp.diag)(block) if block.ndim == 2 else block
                ones = np.diag(np.arange(size) >= block.shape[1]).astype(q.dtype)
                whole.append(jnp.pad(full, ((0, 0), (0, more), (0, more))) + ones[None])
        return jnp.concatenate(whole)

    def mass(self, q: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Mass matrix M, block-diagonal by body."""
        return self.momentum(q, jnp.eye(self.n, dtype=q.dtype))

    def momentum(self, q: Float[Array, " n"], v: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        """M v, body by body."""
        blocks, parts = self.mass_blocks(q), self.topology.split(v)
        if blocks.ndim == 2:
            inertia = blocks.reshape(blocks.shape + (1,) * (v.ndim - 1)) * parts
        else:
            columns = parts.reshape(*parts.shape[:2], -1)
            inertia = multiply(blocks, columns).reshape(parts.shape)
        return self.topology.join(inertia)

    def force(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
        own = [(group, group.force(self.fields, q, v)) for group in self.bodies]
        acting = [(group, force) for group, force in own if force is not None]
        places = [group.coordinates.array for group, _ in acting]
        total = spread([force for _, force in acting], places, (self.n,)) if acting else 0 * q
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
        return spread(blocks, [group.places.array for group in self.joints], (self.m,))

    def jacobian(self, t: Time, q: Float[Array, " n"]) -> Float[Array, "m n"]:
        """Constraint Jacobian C_q."""
        layout = self.topology
        rows = layout.rows.array[layout.nodes].astype(int)[:, :, None]
        columns = layout.coordinates.array[layout.bodies].astype(int)[:, None]
        there = (rows < self.m) & (columns < self.n)
        places = np.where(there, rows * self.n + columns, -1)
        return spread([self.sides(t, q)], [places], (self.m, self.n))

    def sides(self, t: Time, q: Float[Array, " n"]) -> Float[Array, "sides height size"]:
        """The blocks of C_q: one for each joint and body, by the chain rule."""
        layout = self.topology
        shape = (len(layout.nodes), layout.rows.width, layout.coordinates.width)
        if self.joint_markers is None:
            return jnp.zeros(shape, q.dtype)
        poses, motion = self.joint_markers.poses(q), self.joint_markers.jacobian(q)
        columns = self.joint_markers.coordinates()
        blocks, places = [], []
        for group in self.joints:
            blocks.append(group.jacobian(t, poses, motion))
            places.append(layout.places(group.places.array, np.stack(group.markers.take(columns))))
        return spread(blocks, places, shape)

    def saddle(self, t: Time, q: Float[Array, " n"]) -> Saddle:
        return Saddle(self.topology, self.mass_blocks(q), self.sides(t, q))
