"""Inertia and forces of bodies by twists, from those by the coordinates of their frames."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...linalg import quaternions
from ...linalg.dense import multiply
from ...linalg.indexing import take
from ...scene.turn_counter import TurnCounter
from . import twists
from .kinematics import TreeMotion
from .tree import Tree


class Inertias(NamedTuple):
    """The kinetic energy of bodies by their angular velocities, velocities and amplitudes:

        T = ½ m v·v + v·(ω × h) + ½ ωᵀ J ω + v·S η + ωᵀ H η + ½ ηᵀ M η.

    By the inertial axes, about the frames of the bodies, or any other point that moves with each.

    - `mass` (bodies,), `arm` h (bodies, d), `turning` J (bodies, spins, spins).
    - `sliding` Sᵀ (bodies, modes, d), `spinning` Hᵀ (bodies, modes, spins), `modal` M.
    """

    mass: Float[Array, " bodies"]
    arm: Float[Array, "bodies d"]
    turning: Float[Array, "bodies spins spins"]
    sliding: Float[Array, "bodies modes d"]
    spinning: Float[Array, "bodies modes spins"]
    modal: Float[Array, "bodies modes modes"]

    def about(self, arms: Float[Array, "bodies d"]) -> "Inertias":
        """The same about points from which the frames are at `arms`: v of a frame is v + ω × a."""
        more = self.mass[:, None] * arms
        turning = self.turning + _parallel(self.arm, arms) + _parallel(arms, self.arm + more)
        spinning = self.spinning + twists.moment(arms[:, None], self.sliding)
        return self._replace(arm=self.arm + more, turning=turning, spinning=spinning)

    def matrices(self) -> Float[Array, "bodies size size"]:
        """The matrices of T by (ω, v, η)."""
        d = self.arm.shape[1]
        unit = np.eye(d, dtype=self.mass.dtype)[None]
        moving = self.mass[:, None, None] * unit
        aside = _columns(self.arm)
        across = jnp.swapaxes(aside, 1, 2)
        rigid = [
            jnp.concatenate([self.turning, aside], axis=2),
            jnp.concatenate([across, moving], axis=2),
        ]
        if not self.modal.shape[1]:
            return jnp.concatenate(rigid, axis=1)
        bent = jnp.concatenate([self.spinning, self.sliding], axis=2)
        top = jnp.concatenate(rigid, axis=1)
        upper = jnp.concatenate([top, jnp.swapaxes(bent, 1, 2)], axis=2)
        lower = jnp.concatenate([bent, self.modal], axis=2)
        return jnp.concatenate([upper, lower], axis=1)


def _columns(arm: Float[Array, "bodies d"]) -> Float[Array, "bodies spins d"]:
    """The matrix A with ω·A v = v·(ω × arm), rows by ω."""
    if arm.shape[1] == 2:
        return twists.perpendicular(arm)[:, None]
    return quaternions.skew(arm)


def _parallel(first: Array, second: Array) -> Float[Array, "bodies spins spins"]:
    """What a moment of inertia has of ω × `first` and ω × `second`."""
    dot = jnp.sum(first * second, axis=1)[:, None, None]
    if first.shape[1] == 2:
        return dot
    unit = np.eye(3, dtype=first.dtype)[None]
    return dot * unit - second[:, :, None] * first[:, None, :]


def inertias(system: AssembledSystem, tree: Tree, q: Float[Array, " N"]) -> Inertias:
    """Those of all bodies about their frames, in the order of the tree."""
    parts, firsts = [], list[int]()
    for group in system.bodies:
        if isinstance(group.bodies, TurnCounter):
            continue
        mass, own = group.mass(q), group.coordinates.take(q)
        size = group.bodies.frame_size
        each = _in_plane(mass) if size == 3 else _in_space(mass, own[:, 3:7])
        parts.append(_widened(each, tree.modes))
        firsts += [row[0] for row in group.coordinates.rows]
    number = {first: i for i, first in enumerate(firsts)}
    order = np.array([number[row[0]] for row in tree.columns.rows], np.uint32)
    joined = [take(jnp.concatenate(x), order) for x in zip(*parts, strict=True)]
    return Inertias(*joined)


def _in_plane(mass: Float[Array, "count size *size"]) -> Inertias:
    if mass.ndim == 2:
        none = jnp.zeros((len(mass), mass.shape[1] - 3, 2), mass.dtype)
        modal = mass[:, 3:, None] * np.eye(mass.shape[1] - 3, dtype=mass.dtype)[None]
        turning = mass[:, 2, None, None]
        centred = jnp.zeros((len(mass), 2), mass.dtype)
        return Inertias(mass[:, 0], centred, turning, none, none[:, :, :1], modal)
    # M_xφ is the derivative of the velocity by φ: the arm turned by a right angle.
    arm = -twists.perpendicular(mass[:, :2, 2])
    return Inertias(
        mass[:, 0, 0], arm, mass[:, 2:3, 2:3], mass[:, 3:, :2], mass[:, 3:, 2:3], mass[:, 3:, 3:]
    )


def _in_space(mass: Float[Array, "count size size"], p: Float[Array, "count 4"]) -> Inertias:
    onto = 0.5 * quaternions.space_matrix(p)  # ṗ = Eᵀ ω / 2
    turning = multiply(multiply(onto, mass[:, 3:7, 3:7]), jnp.swapaxes(onto, 1, 2))
    aside = multiply(onto, mass[:, 3:7, :3])  # ω·A v, the matrix of the arm
    arm = jnp.stack([aside[:, 2, 1], aside[:, 0, 2], aside[:, 1, 0]], axis=1)
    spinning = multiply(mass[:, 7:, 3:7], jnp.swapaxes(onto, 1, 2))
    return Inertias(mass[:, 0, 0], arm, turning, mass[:, 7:, :3], spinning, mass[:, 7:, 7:])


def _widened(each: Inertias, modes: int) -> Inertias:
    """The inertias with amplitudes that nothing moves, up to so many modes."""
    more = modes - each.modal.shape[1]
    if not more:
        return each
    wide = twists.widened(twists.widened(each.modal, modes, 1), modes, 2)
    ones = np.diag(np.arange(modes) >= modes - more).astype(wide.dtype)
    return each._replace(
        sliding=twists.widened(each.sliding, modes),
        spinning=twists.widened(each.spinning, modes),
        modal=wide + ones[None],
    )


def biases(
    tree: Tree,
    motion: TreeMotion,
    own: Inertias,
    p: Float[Array, "bodies *turn"],
    force: Float[Array, " N"],
) -> Float[Array, "bodies size"]:
    """B of M ẏ + b = 0 of free bodies, about the points of the motion.

    **Arguments:** the `tree` and its `motion`; `own`: about the frames; `p`: their turns in q;
    `force`: Q of all bodies.

    A frame has the acceleration v̇ + ω̇ × a + ω × ẋ. What its quaternion has at ω̇ = 0 is along
    itself, where nothing is coupled with it.
    """
    omega, velocity = twists.split(motion.twists)
    velocity = velocity + twists.about(omega, motion.arms)
    acting = tree.columns.take(force)
    d, arms = motion.arms.shape[1], motion.arms
    torque = acting[:, 2:3] if d == 2 else quaternions.torque(p, acting[:, 3:7])
    lifted = twists.about(omega, velocity)
    wrench = twists.joined(
        twists.moment(own.arm, lifted) - torque,
        own.mass[:, None] * lifted - acting[:, :d],
    )
    wrench = twists.wrench_from_origin(wrench, arms)
    if not tree.modes:
        return wrench
    modal = jnp.sum(own.sliding * lifted[:, None], axis=2) - acting[:, tree.size :]
    return jnp.concatenate([wrench, modal], axis=1)
