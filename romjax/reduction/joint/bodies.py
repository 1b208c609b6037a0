"""Inertia and forces of bodies by twists, from those by the coordinates of their frames."""

import functools
import operator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...assembly.body_group import BodyGroup
from ...linalg import quaternions
from ...linalg.dense import multiply
from ...linalg.indexing import take
from ...scene.body.base import AbstractBody
from ...scene.effect.base import AbstractField
from ...scene.effect.gravity import Gravity
from ...scene.one_coordinate import AbstractOneCoordinate
from . import twists
from .inertias import Inertias
from .tree import Tree


def inertias(system: AssembledSystem, tree: Tree, state: Any) -> Inertias:
    """The inertias of all bodies about their frames, in the order of the tree.

    `state`: with the `motion` of the tree, and q, which is asked for where bodies have no
    invariants.
    """
    parts = []
    for group, order, known in _groups(system, tree):
        if known:
            axes = take(state.motion.frames.axes, order)
            bent = take(tree.amplitudes.take(state.z), order)[:, : group.bodies.modes]
            each = jax.vmap(_of_invariants)(group.bodies, axes, bent)
            each = jax.tree.map(group.weighted, each)
        else:
            mass, own = group.mass(state.q), group.coordinates.take(state.q)
            size = group.bodies.frame_size
            each = _in_plane(mass) if size == 3 else _in_space(mass, own[:, 3:7])
        parts.append(_widened(each, tree.modes))
    if any(each.arm is not None for each in parts):
        parts = [each.with_arm() for each in parts]
    return Inertias(*in_tree_order(system, tree, [list(each) for each in parts]))


def _groups(system: AssembledSystem, tree: Tree) -> list[tuple[BodyGroup, np.ndarray, bool]]:
    """The bodies, with their places in the tree, and whether their invariants are known."""
    number = {row[0]: i for i, row in enumerate(tree.columns.rows)}
    return [
        (group, np.array([number[row[0]] for row in group.coordinates.rows], np.uint32), known)
        for group, known in zip(system.bodies, tree.invariants, strict=True)
        if not isinstance(group.bodies, AbstractOneCoordinate)
    ]


def in_tree_order(system: AssembledSystem, tree: Tree, parts: list[list[Any]]) -> list[Any]:
    """Rows of all groups, in the order of the tree; None where none has any."""
    order = np.argsort(np.concatenate([own for _, own, _ in _groups(system, tree)]))

    def ordered(*rows: Any) -> Any:
        return None if rows[0] is None else take(jnp.concatenate(rows), order.astype(np.uint32))

    return [ordered(*rows) for rows in zip(*parts, strict=True)]


def _of_invariants(body: AbstractBody, axes: Float[Array, "3 3"], bent: Array) -> Inertias:
    inertia: Any = body.invariants()
    k, dtype = len(bent), axes.dtype
    modal = jnp.eye(k, dtype=dtype) if inertia.modal is None else inertia.modal
    turning = multiply(multiply(axes, inertia.turning(bent)), axes.T)
    arm, sliding = None, jnp.zeros((k, 3), dtype)
    if not inertia.centred:
        arm = multiply(axes, inertia.arm(bent))
        sliding = multiply(axes, inertia.sliding(bent)).T
    spinning = multiply(axes, inertia.spinning(bent)).T
    return Inertias(inertia.mass, arm, turning, sliding, spinning, modal)


def _in_plane(mass: Float[Array, "count size *size"]) -> Inertias:
    if mass.ndim == 2:
        none = jnp.zeros((len(mass), mass.shape[1] - 3, 2), mass.dtype)
        modal = mass[:, 3:, None] * np.eye(mass.shape[1] - 3, dtype=mass.dtype)[None]
        turning = mass[:, 2, None, None]
        return Inertias(mass[:, 0], None, turning, none, none[:, :, :1], modal)
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
    system: AssembledSystem, tree: Tree, state: Any, own: Inertias
) -> Float[Array, "bodies size"]:
    """B of M ẏ + b = 0 of free bodies, about the points of the motion.

    **Arguments:** the `system` of bodies and its `tree`; `state`: with t, z, the `motion`, the
    `bending` of the bodies, and `others`, the forces that neither gravity nor invariants give;
    `own`: the inertias about the frames.

    A frame has the acceleration v̇ + ω̇ × a + ω × ẋ. Gravity acts as if all frames were accelerated
    against it.
    """
    motion, dtype = state.motion, own.mass.dtype
    omega, velocity = twists.split(motion.twists)
    lifted = twists.about(omega, velocity + twists.about(omega, motion.arms))
    gravity, _ = _gravity(system)
    if gravity is not None:
        lifted = lifted - jnp.asarray(gravity, dtype)[None]
    force, torque = own.mass[:, None] * lifted, None
    if own.arm is not None:
        torque = twists.moment(own.arm, lifted)
    modal = jnp.sum(own.sliding * lifted[:, None], axis=2)
    quadratic = _quadratic(system, tree, state, own)
    if quadratic is not None:
        torque, modal = _sum(torque, quadratic.torque), modal + quadratic.modal
        force = _sum(force, quadratic.force)
    if state.others is not None:
        # Forces by coordinates of frames are those by twists, but for torques, which act on
        # quaternions.
        acting = tree.columns.take(state.others)
        d = motion.arms.shape[1]
        turns = tree.columns.take(state.q)[:, 3:7] if d == 3 else None
        turned = acting[:, 2:3] if turns is None else quaternions.torque(turns, acting[:, 3:7])
        torque, force = _sum(torque, -turned), force - acting[:, :d]
        modal = modal - acting[:, tree.size :]
    wrench = twists.joined(_sum(torque, twists.moment(motion.arms, force)), force)
    return jnp.concatenate([wrench, modal], axis=1) if tree.modes else wrench


def _sum(x: Any, y: Any) -> Any:
    """A sum of what is zero where it is None."""
    return y if x is None else x if y is None else x + y


def _gravity(system: AssembledSystem) -> tuple[Any, tuple[AbstractField, ...]]:
    """The acceleration of gravity, None without, and the other fields."""
    falling = [field for field in system.fields if type(field) is Gravity]
    others = tuple(field for field in system.fields if type(field) is not Gravity)
    if not falling:
        return None, others
    return functools.reduce(operator.add, [field.acceleration for field in falling]), others


class Quadratic(NamedTuple):
    """Torques and forces about the frames, the latter None where it is zero, and modal forces."""

    torque: Float[Array, "bodies spins"]
    force: Float[Array, "bodies d"] | None
    modal: Float[Array, "bodies modes"]


def _quadratic(system: AssembledSystem, tree: Tree, state: Any, own: Inertias) -> Quadratic | None:
    """The forces of motion of bodies whose invariants give them; None of other ones."""
    if not any(tree.invariants):
        return None
    omega, moving = twists.split(state.motion.twists)
    groups = _groups(system, tree)
    if not tree.modes and all(known for *_, known in groups):
        # Torques are taken by the inertial axes, as the inertias are already.
        torque, force = twists.about(omega, twists.apply(own.turning, omega)), None
        if own.arm is not None:
            force = twists.about(omega, twists.about(omega, own.arm))
        return Quadratic(torque, force, jnp.zeros_like(moving[:, :0]))
    parts, bent = [], tree.amplitudes.take(state.z)
    for group, order, known in groups:
        modes = group.bodies.modes
        if not known:
            sizes = 3, 3, tree.modes
            parts.append([jnp.zeros((len(order), k), state.z.dtype) for k in sizes])
            continue
        axes, amplitudes = take(state.motion.frames.axes, order), take(bent, order)[:, :modes]
        bending = take(state.bending, order)[:, :modes]
        each = (group.bodies, axes, take(omega, order), amplitudes, bending)
        torque, force, modal = jax.tree.map(group.weighted, jax.vmap(_quadratic_of)(*each))
        parts.append([torque, force, twists.widened(modal, tree.modes)])
    return Quadratic(*in_tree_order(system, tree, parts))


def _quadratic_of(
    body: AbstractBody, axes: Float[Array, "3 3"], omega: Array, bent: Array, bending: Array
) -> Quadratic:
    inertia: Any = body.invariants()
    moving, turning, modal = inertia.quadratic(multiply(axes.T, omega), bent, bending)
    moving = moving if inertia.centred else multiply(axes, moving)
    return Quadratic(multiply(axes, turning), moving, modal)


def other_forces(system: AssembledSystem, tree: Tree, state: Any) -> Float[Array, " N"] | None:
    """Q of all that neither gravity nor invariants give, nor acts along coordinates of joints; None
    where there is nothing else.

    `state`: with t, and q and v, which are asked for where forces depend on them.
    """
    _, fields = _gravity(system)
    groups = list(zip(system.bodies, tree.invariants, strict=True))
    acting = any(group.acts(fields, not known) for group, known in groups)
    along = state.system.along.numbers
    if not acting and not any(system.acting(along)):
        return None
    t, q, v = state.t, state.q, state.v
    own = [group.force(fields, q, v, not known) for group, known in groups]
    return system.body_force(own, q) + system.effect_force(t, q, v, along)
