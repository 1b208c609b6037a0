"""Physical coordinates of a mechanism from those of its tree, and back."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...linalg import quaternions
from ...linalg.indexing import spread, take
from ...scene.marker import Pose
from . import twists
from .closing import SomeJoints
from .kinematics import TreeMotion, edges, frames
from .ports import Frames
from .tree import Links, Tree


class Counters(eqx.Module):
    """The coordinates that follow those of joints of the tree: angles that count full turns, and
    motions that have an inertia of their own, such as the turn of a rotor.

    - `joints`: what holds them. `columns`: theirs in q. `followed`: those of the joints among z.
      `turning`: which of them are angles.
    - `signs`, `offsets`: about s = sign z + offset; the rest is less than a turn.
    - `rotors`: which have an inertia; `inertias` [kg m²] or [kg]: these.
    """

    joints: SomeJoints
    columns: tuple[int, ...] = eqx.field(static=True)
    followed: tuple[int, ...] = eqx.field(static=True)
    turning: tuple[bool, ...] = eqx.field(static=True)
    signs: Float[Array, " counters"]
    offsets: Float[Array, " counters"]
    rotors: tuple[int, ...] = eqx.field(static=True)
    inertias: Float[Array, " rotors"]

    def about(self, z: Float[Array, " n"]) -> Float[Array, " counters"]:
        """The coordinates but for less than a turn."""
        return self.signs * z[np.array(self.followed)] + self.offsets

    @property
    def masses(self) -> tuple[np.ndarray, Float[Array, " rotors"]]:
        """The coordinates among z that move a rotor, and its inertia: as s = ± z + offset, what M
        has more on its diagonal.
        """
        return np.array(self.followed)[np.array(self.rotors, int)], self.inertias

    def added(self, z: Float[Array, " n"], q: Float[Array, " N"]) -> Float[Array, " N"]:
        """`q` with the counters."""
        columns = np.array(self.columns)
        # The residual of a counter is how far it is from its angle, between −π and π: near the
        # angle it is exact, and one step of Newton's method is the solution.
        guess = q.at[columns].set(jax.lax.stop_gradient(self.about(z)))
        return guess.at[columns].add(self.joints.residual(jnp.zeros((), q.dtype), guess))

    def starting_at(self, lift: "TreeLift", z: Float[Array, " n"], q: Array) -> "Counters":
        """The counters with the signs and offsets that suit a configuration z, at which they are
        those of `q`.
        """
        unit = jnp.zeros_like(z).at[np.array(self.followed)].set(1)
        _, slopes = jax.jvp(lambda z: self.residual(lift, z), (z,), (unit,))
        # A counter turns with its joint or against it, by which marker came first.
        signs = jax.lax.stop_gradient(jnp.where(slopes < 0, -1.0, 1.0).astype(z.dtype))
        offsets = q[np.array(self.columns)] - signs * z[np.array(self.followed)]
        return dataclasses.replace(self, signs=signs, offsets=offsets)

    def residual(self, lift: "TreeLift", z: Float[Array, " n"]) -> Float[Array, " counters"]:
        """The motions of the bodies that are counted, where the counters are at zero."""
        uncounted = dataclasses.replace(lift, counters=None)
        return self.joints.residual(jnp.zeros((), z.dtype), uncounted.position(z))


class TreeLift(eqx.Module):
    """The coordinates q of a system of bodies at those of its tree, z.

    - `lengths`: of the quaternions of the bodies, with the signs that they start with; None in the
      plane. `counters`: None where there are none. `size`: how many q there are.
    """

    tree: Tree
    lengths: Float[Array, " bodies"] | None
    counters: Counters | None
    size: int = eqx.field(static=True)

    def position(self, z: Float[Array, " n"]) -> Float[Array, " N"]:
        """The coordinates of the system."""
        poses = frames(self.tree, edges(self.tree, z))
        return self.at_frames(z, poses)

    def at_frames(self, z: Float[Array, " n"], poses: Pose | Frames) -> Float[Array, " N"]:
        """The same, from the frames of the bodies."""
        turn = self.turns(poses)
        q = self._spread(poses.position, turn, self.tree.amplitudes.take(z), z)
        return q if self.counters is None else self.counters.added(z, q)

    def turns(self, poses: Pose | Frames) -> Float[Array, "bodies *turn"]:
        """The turns of the bodies in q."""
        return poses.turn if self.lengths is None else poses.turn * self.lengths[:, None]

    def velocity(
        self, z: Float[Array, " n"], motion: TreeMotion, moved: Array, bending: Array, w: Array
    ) -> Float[Array, " N"]:
        """The rates of q where the bodies have the twists `moved` and the rates `bending`, and z
        has the rates w.
        """
        omega, velocity = twists.split(moved)
        velocity = velocity + twists.about(omega, motion.arms)
        turns = self.turns(motion.frames)
        rate = omega if self.lengths is None else quaternions.derivative(turns, omega)
        v = self._spread(velocity, rate, bending, w)
        if self.counters is None:
            return v
        count, q = self.counters, self.at_frames(z, motion.frames)
        return v.at[np.array(count.columns)].set(_counted(count, q, v)[1])

    def acceleration(
        self,
        z: Float[Array, " n"],
        motion: TreeMotion,
        moved: Float[Array, "bodies twist"],
        bending: Float[Array, "bodies modes"],
        v: Float[Array, " N"],
        change: Float[Array, " n"],
    ) -> Float[Array, " N"]:
        """The accelerations of q where `moved` and `bending` are the derivatives of V and η, and
        `change` is that of the rates of z.
        """
        omega, velocity = twists.split(motion.twists)
        turning, moving = twists.split(moved)
        velocity = velocity + twists.about(omega, motion.arms)
        # a + ω̇ × arm + ω × v, since arms turn with their bodies.
        moving = moving + twists.about(turning, motion.arms) + twists.about(omega, velocity)
        rate, turns = turning, self.turns(motion.frames)
        if self.lengths is not None:
            spun = quaternions.derivative(turns, omega)
            rate = quaternions.derivative(turns, turning) + quaternions.derivative(spun, omega)
        a = self._spread(moving, rate, bending, change)
        if self.counters is None:
            return a
        count, q = self.counters, self.at_frames(z, motion.frames)
        _, change = jax.jvp(lambda q, v: _counted(count, q, v)[1], (q, v), (v, a))
        return a.at[np.array(count.columns)].set(change)

    def restrict(self, q: Float[Array, " N"]) -> Float[Array, " n"]:
        """The coordinates of the tree that the joints read from the poses of their markers."""
        tree = self.tree
        poses = tree.ports.poses(q)
        outer = jax.tree.map(lambda x: x[: tree.count], poses)
        inner = jax.tree.map(lambda x: x[tree.count :], poses)
        rows = [_read(link, outer, inner) for link in tree.links]
        bent = tree.columns.take(q)[:, tree.size :]
        tables = [link.coordinates.array.astype(int) for link in tree.links]
        amplitudes = tree.amplitudes.array.astype(int)
        tables.append(np.where(amplitudes < tree.n, amplitudes, -1))
        in_q, in_z, _ = tree.states.array
        z = spread([*rows, bent, take(q, in_q)], [*tables, in_z], (tree.n,))
        if self.counters is None:
            return z
        count = self.counters
        # Several may count the turns of one joint.
        each = zip(count.followed, count.turning, strict=True)
        own = {coordinate: i for i, (coordinate, turns) in enumerate(each) if turns}
        if not own:
            return z
        turns = jnp.round((q[np.array(count.columns)] - count.about(z)) / (2 * np.pi))
        more = jax.lax.stop_gradient(2 * np.pi * count.signs * turns)
        return z.at[np.array(list(own))].add(more[np.array(list(own.values()))])

    def _spread(
        self, position: Array, turn: Array, amplitudes: Array, states: Float[Array, " n"]
    ) -> Float[Array, " N"]:
        """Numbers of q from those of the frames, of the amplitudes, and of z, as states have."""
        turn = turn[:, None] if turn.ndim == 1 else turn
        rows = jnp.concatenate([position, turn, amplitudes], axis=1)
        table = self.tree.columns.array.astype(int)
        in_q, in_z, _ = self.tree.states.array
        tables = [np.where(table < self.size, table, -1), in_q]
        return spread([rows, take(states, in_z)], tables, (self.size,))


def _counted(count: Counters, q: Array, v: Array) -> tuple[Array, Array]:
    """The angles of counters less their numbers of turns, and the rates of the angles."""
    zero = jnp.zeros((), q.dtype)
    still = v.at[np.array(count.columns)].set(0)
    both: tuple[Array, Array] = jax.jvp(lambda q: count.joints.residual(zero, q), (q,), (still,))
    return both


def _read(link: Links, outer: Pose, inner: Pose) -> Float[Array, "count freedoms"]:
    """The coordinates of joints of one kind from the poses of all ports."""
    own = np.array(link.bodies, np.uint32)
    parent, child = (jax.tree.map(lambda x: take(x, own), each) for each in (outer, inner))
    a, b = (parent, child) if link.reversed else (child, parent)
    axes = 0 if jax.tree.leaves(link.joints) else None
    each: Array = jax.vmap(lambda joint, a, b: joint.read(a, b), (axes, 0, 0))(link.joints, a, b)
    return each
