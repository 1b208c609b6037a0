"""Forces of joints and of effects along a run."""

import functools
import string
from collections.abc import Iterator
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..assembly.counting import without_counters
from ..assembly.kinematics import MarkerBlocks, Markers
from ..assembly.locate import assembled
from ..assembly.wrenches import effect_wrenches, joint_wrenches
from ..common.checks import unknown_name
from ..integrate.trajectory import Trajectory
from ..linalg import quaternions
from ..scene.marker import Pose, Poses, Twist, Twists, Wrench, Wrenches
from ..system.base import AbstractSystem
from ..system.structure import without_names
from .states import along, check_run, solved

_SIDES = string.ascii_lowercase


class Forces(eqx.Module):
    """The wrenches of one joint or effect on its markers, along a run of k outputs.

    Wrenches act on the bodies that carry the markers; torques are about the markers.

    - `poses`, `twists`, `wrenches`: of each marker in order, by the inertial axes.
    """

    poses: Poses
    twists: Twists
    wrenches: Wrenches

    @property
    def force(self) -> Float[Array, "*k d"]:
        """The force on the first marker [N], by the inertial axes; (*k, 3) in space."""
        return self.wrenches[0].force

    @property
    def torque(self) -> Float[Array, "..."]:
        """The torque on the first marker [N m], about it; (*k, 3) in space."""
        return self.wrenches[0].torque

    @property
    def power(self) -> Float[Array, "*k"]:
        """The power that it puts into the mechanism [W], at all its markers together.

        For a joint that prescribes a motion this is the power of the drive; other joints have none.
        """
        terms = [w.power(twist) for w, twist in zip(self.wrenches, self.twists, strict=True)]
        return sum(terms[1:], terms[0])

    def on(self, side: str = "a", frame: str = "inertial") -> Wrench:
        """The wrench on the marker `side`: its `.force` [N] (k, 2) and `.torque` [N m] (k,).

        **Arguments:**

        - `side`: "a" for the first marker, "b" for the second, and so on.
        - `frame`: along whose axes: "inertial", or "a", "b", … for those of a marker.

        Raises InputError for a marker that is not there.
        """
        names = _SIDES[: len(self.wrenches)]
        if side not in tuple(names):
            raise unknown_name("Forces.on", "side", side, names)
        if frame not in ("inertial", *names):
            raise unknown_name("Forces.on", "frame", frame, ("inertial", *names))
        force, torque = self.wrenches[names.index(side)]
        if frame == "inertial":
            return Wrench(force, torque)
        pose = self.poses[names.index(frame)]
        # Rᵀ F: the components along the axes of the marker.
        if pose.dimension == 3:
            back = quaternions.conjugate(pose.turn)
            return Wrench(quaternions.rotate(back, force), quaternions.rotate(back, torque))
        c, s = jnp.cos(pose.angle), jnp.sin(pose.angle)
        along, across = force[..., 0], force[..., 1]
        turned = jnp.stack([c * along + s * across, c * across - s * along], axis=-1)
        return Wrench(turned, torque)


class ForceTable(eqx.Module):
    """The `Forces` of all joints, or of all effects that act on markers, by their keys.

    A key is the label of the part, as messages have it: its name, or its kind and its bodies, such
    as "Revolute(crank, ground)". Where several parts have one label, all of them are numbered in
    their order in the scene, from 1: "hinge 1", "hinge 2". `keys()`, `values()`, `items()`, `in`,
    `len` and loops work as for a dictionary.

    - `stacked`: of groups of parts, the parts along the last axis but that of vectors.
    - `names`: their keys, group by group. `kind`: what they are, for messages.
    """

    stacked: tuple[Forces, ...]
    names: tuple[tuple[str, ...], ...] = eqx.field(static=True)
    kind: Literal["joint", "effect"] = eqx.field(static=True)

    def keys(self) -> tuple[str, ...]:
        """The keys of all parts."""
        return tuple(name for group in self.names for name in group)

    def items(self) -> Iterator[tuple[str, Forces]]:
        """All keys with their forces."""
        return ((key, self[key]) for key in self.keys())

    def values(self) -> Iterator[Forces]:
        """The forces of all parts, in the order of the keys."""
        return (self[key] for key in self.keys())

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    def __contains__(self, key: object) -> bool:
        return key in self.keys()

    def __getitem__(self, key: str) -> Forces:
        for forces, names in zip(self.stacked, self.names, strict=True):
            if key in names:
                part = functools.partial(_part, names.index(key))
                one: Forces = jax.tree.map(part, forces, is_leaf=_is_pair)
                return one
        raise unknown_name(f"{self.kind}_forces", self.kind, key, self.keys())


def _is_pair(x: Any) -> bool:
    return isinstance(x, Pose | Twist | Wrench)


def _part(i: int, x: Any) -> Any:
    """One of several parts: a Pose, a Twist or a Wrench, each a vector, and a number in the plane,
    another vector in space.
    """
    vector, other = x
    # The parts are on the last axis of numbers and on the last but one of vectors, whatever axes of
    # outputs come before.
    return type(x)(
        vector[..., i, :], other[..., i, :] if other.ndim == vector.ndim else other[..., i]
    )


def joint_forces(system: AbstractSystem, run: Trajectory) -> ForceTable:
    """Return the wrenches of each joint along a run: `joint_forces(system, run)["hinge"]` has
    `.force` (k, 2) [N] and `.torque` (k,) [N m] on its first marker, in the inertial frame and
    about the marker, `.power` (k,) [W], and `.on("b")` for the second one; see `ForceTable` for its
    keys.

    The wrench on a marker at the pose x is −(∂C/∂x)ᵀ λ, by the virtual work of the constraint
    forces −C_qᵀ λ. The multipliers λ are those of the motion without stabilisation; of a reduced
    model, those that balance the mechanism's bodies as `reactions` does. Where joints repeat each
    other, as one that is made twice, each carries a share, and only the sum of them is determined.

    **Arguments:** the `system`, full or reduced; a `run` that was simulated with it.

    Raises InputError for a run of another system or of other numbers, or a system without bodies.
    """
    check_run("joint_forces", system, run)
    full, bare = assembled("joint_forces", system), without_names(system)
    if full.joint_markers is None:
        return ForceTable((), (), "joint")
    stacked = along(_of_joints, bare, run.t, run.q, run.v)
    return _table("joint", without_counters(full.joints), full.structure.joints, stacked)


def effect_forces(system: AbstractSystem, run: Trajectory) -> ForceTable:
    """Return the wrenches of each effect along a run: `effect_forces(system, run)["Spring(a,
    ground)"]` has `.force` (k, 2) [N] and `.torque` (k,) [N m] on its first marker, in the inertial
    frame and about the marker, `.power` (k,) [W] that it puts into the mechanism, and `.on("b")`
    for the second one; see `ForceTable` for its keys. Gravity, which acts on no marker, has none.

    **Arguments:** the `system`, full or reduced; a `run` that was simulated with it.

    Raises InputError for a run of another system or of other numbers, or a system without bodies.
    """
    check_run("effect_forces", system, run)
    full, bare = assembled("effect_forces", system), without_names(system)
    if full.effect_markers is None:
        return ForceTable((), (), "effect")
    stacked = along(_of_effects, bare, run.t, run.q, run.v)
    return _table("effect", full.effects, full.structure.effects, stacked)


def _table(
    kind: Literal["joint", "effect"], groups: Any, keys: tuple[str, ...], stacked: list[Forces]
) -> ForceTable:
    names, first = [], 0
    for group in groups:
        names.append(keys[first : first + group.markers.count])
        first += group.markers.count
    return ForceTable(tuple(stacked), tuple(names), kind)


def _of_joints(system: Any, t: Array, q: Array, v: Array) -> list[Forces]:
    full, (_, multipliers) = system.full, solved(system, t, q, v)
    wrenches = joint_wrenches(full.joints, full.joint_markers, t, q, multipliers)
    blocks = [group.markers for group in without_counters(full.joints)]
    return _by_group(full.joint_markers, blocks, q, v, wrenches)


def _of_effects(system: Any, t: Array, q: Array, v: Array) -> list[Forces]:
    full = system.full
    wrenches = effect_wrenches(full.now(v).effects, full.effect_markers, t, q, v)
    blocks = [group.markers for group in full.effects]
    return _by_group(full.effect_markers, blocks, q, v, wrenches)


def _by_group(
    markers: Markers, blocks: list[MarkerBlocks], q: Array, v: Array, wrenches: Wrench
) -> list[Forces]:
    poses, twists = markers.motion(q, v)
    return [Forces(own.take(poses), own.take(twists), own.take(wrenches)) for own in blocks]
