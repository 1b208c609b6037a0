"""The same mechanism from other starts, or driven at other speeds."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np

from ..assembly.assemble import assemble
from ..assembly.assembled import AssembledSystem
from ..common.arrays import as_jax
from ..integrate.trajectory import Trajectory
from ..linalg import quaternions
from ..scene.marker import GROUND
from ..scene.scene import Scene, markers_of
from ..scene.signal import AbstractSignal, Chirp, Ramp, Sine, Step, Sum, Table
from ..system.structure import without_names
from .facts import Joined, drives, joined


class Change(NamedTuple):
    """The difference between two starts.

    `speed`: of what moves or is driven, relative to the first. `tilt`, `spin`: of what rests, as
    shares of how far and how fast the motion goes. `axis`: in space.
    """

    speed: float
    tilt: float
    spin: float
    axis: tuple[float, float, float]


# The starts of further training runs; and those of the runs that judge models, which lie within.
TRAINING = (
    Change(0.85, 0.2, 0.2, (0.3, -0.5, 0.8)),
    Change(1.15, -0.2, -0.2, (-0.7, 0.6, 0.4)),
)
UNSEEN = (
    Change(0.9, 0.12, -0.15, (0.6, 0.6, 0.5)),
    Change(1.05, -0.15, 0.12, (0.5, -0.7, 0.5)),
    Change(1.1, 0.08, 0.1, (-0.2, 0.1, 1.0)),
)
# [rad] The largest tilt of a start.
_LARGEST_TILT = 0.3
# The largest work of a tilt, as a share of the largest kinetic energy of the motion, and how often
# a tilt is halved to get there, so that contacts and springs do not break loose.
_WORK, _HALVINGS = 0.25, 8
# A start counts as moving if its speed is this share of the largest one in the run; a tilt or spin
# counts as held by the joints if they leave less than this share of it.
_MOVING, _HELD = 0.1, 1e-3
# Steps of Newton's method, the violation at which it ends, and the share below which singular
# values count as zero.
_SWEEPS, _CLOSED, _RANK = 20, 1e-13, 1e-9


def variants(
    scene: Scene, system: AssembledSystem, run: Trajectory, changes: Sequence[Change]
) -> list[AssembledSystem]:
    """The system with other speeds of its drives; without drives, at other speeds of a start that
    moves; of one that rests, tilted and turning about where it is held. All joints hold.
    """
    if drives(scene):
        return [_driven(scene, system, change.speed) for change in changes]
    metric, v = np.asarray(run.metric), np.asarray(run.v)
    squared = np.einsum("ki,ij,kj->k", v, metric, v)
    if squared[0] > _MOVING**2 * np.max(squared):
        return [dataclasses.replace(system, v0=change.speed * system.v0) for change in changes]
    return [_moved(scene, system, run, change) for change in changes]


def _driven(scene: Scene, system: AssembledSystem, speed: float) -> AssembledSystem:
    """Scale the speed of all drives, and the rates of the start alike, so that joints still fit."""
    joints = list(scene.joints)
    for i in drives(scene):
        faster = at_speed(joints[i].signal, speed)  # type: ignore[attr-defined]
        joints[i] = eqx.tree_at(lambda joint: joint.signal, joints[i], faster)
    other = assemble(Scene(scene.bodies, joints, scene.effects))
    return dataclasses.replace(other, q0=system.q0, v0=speed * system.v0)


def at_speed(signal: AbstractSignal, speed: float) -> AbstractSignal:
    """The signal with its time running faster by a factor; of an unknown kind, as it is."""
    match signal:
        case Ramp():
            return Ramp(signal.rate * speed, signal.offset)
        case Sine():
            return Sine(signal.amplitude, signal.frequency * speed, signal.phase)
        case Chirp():
            return Chirp(signal.amplitude, signal.frequency * speed, signal.rate * speed**2)
        case Table():
            return Table(signal.times / speed, signal.values)
        case Step():
            return Step(signal.height, signal.start / speed, signal.duration / speed)
        case Sum():
            return Sum(tuple(at_speed(term, speed) for term in signal.terms))
    return signal


def _moved(
    scene: Scene, system: AssembledSystem, run: Trajectory, change: Change
) -> AssembledSystem:
    """Return the mechanism tilted and turning as a whole, as far as the joints allow.

    Where they allow nothing, it starts from a later state of the motion, slower.
    """
    posed = _Posed(system, np.asarray(run.metric))
    pivot, axis = _pivot(scene, system), np.asarray(change.axis) / np.linalg.norm(change.axis)
    q0, q, v = (np.asarray(x) for x in (system.q0, run.q, run.v))
    whole = _turning(system, q0, pivot, axis)
    field = posed.fitting(q0, whole)
    if posed.size(field) <= _HELD * posed.size(whole):
        k = int(len(q) * abs(change.tilt))
        return dataclasses.replace(system, q0=run.q[k], v0=change.speed * run.v[k])
    farthest, fastest = (posed.share(x, field) for x in (q - q0, v))
    tilt = float(np.sign(change.tilt)) * min(_LARGEST_TILT, abs(change.tilt) * farthest)
    spin = change.spin * fastest
    most = 0.5 * np.max([posed.size(rates) ** 2 for rates in v])
    stored = posed.joined(q0).stored
    for _ in range(_HALVINGS):
        moved = posed.closed(q0 + tilt * field)
        work = abs(float(posed.joined(moved).stored - stored))
        if work <= _WORK * most:
            break
        tilt /= 2
    else:
        moved = q0
    turning = posed.fitting(moved, spin * _turning(system, moved, pivot, axis))
    rates = posed.fitting(moved, np.asarray(system.v0)) + turning
    return dataclasses.replace(system, q0=as_jax(moved), v0=as_jax(rates))


@dataclasses.dataclass(frozen=True)
class _Posed:
    """Moves of the frames of bodies, nearest in the `metric`: modes that took part would ring."""

    system: AssembledSystem
    metric: np.ndarray

    def joined(self, q: np.ndarray) -> Joined:
        """The joints of a configuration."""
        return joined(without_names(self.system), as_jax(q))

    def size(self, x: np.ndarray) -> float:
        """The length of a move in the metric."""
        return float(np.sqrt(x @ self.metric @ x))

    def share(self, motion: np.ndarray, field: np.ndarray) -> float:
        """Return how many times the field fits into the motion, all in all and in angles."""
        turns = self.system.structure.turns
        angles = np.max(np.linalg.norm(motion[:, turns], axis=2))
        turned = np.max(np.linalg.norm(field[turns], axis=1))
        far = max(self.size(x) for x in motion) / self.size(field)
        return far if turned == 0 else float(min(far, angles / turned))

    def move(self, rows: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """The least move of the frames by which constraints change as `wanted`."""
        frames = np.array(self.system.structure.rigid)
        root = np.linalg.cholesky(self.metric[np.ix_(frames, frames)])
        own = np.linalg.solve(root, rows[:, frames].T).T
        moved = np.zeros(len(frames))
        least = np.linalg.pinv(own, _RANK) @ wanted
        moved[frames] = np.linalg.solve(root.T, least)
        return moved

    def fitting(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The nearest velocities that the joints allow."""
        rows = np.asarray(self.joined(q).rows)
        return v - self.move(rows, rows @ v) if len(rows) else v

    def closed(self, q: np.ndarray) -> np.ndarray:
        """The nearest configuration in which all joints hold, by Newton's method."""
        for _ in range(_SWEEPS):
            now = self.joined(q)
            violation = np.asarray(now.violation)
            if not violation.size or np.max(np.abs(violation)) < _CLOSED:
                break
            q = q - self.move(np.asarray(now.rows), violation)
        return q


def _pivot(scene: Scene, system: AssembledSystem) -> np.ndarray:
    """Return the mean point where joints hold the mechanism to the ground, or of its bodies."""
    held = [
        np.asarray(marker.point)
        for joint in scene.joints
        for marker, _ in markers_of(joint)
        if marker.body == GROUND
    ]
    if held:
        return np.asarray(np.mean(held, axis=0))
    return np.asarray(np.mean(np.asarray(system.q0)[system.structure.positions], axis=0))


def _turning(
    system: AssembledSystem, q: np.ndarray, pivot: np.ndarray, axis: np.ndarray
) -> np.ndarray:
    """Velocities (n,) of all bodies that turn as one at 1 rad/s."""
    structure, field = system.structure, np.zeros_like(q)
    arms = q[structure.positions] - pivot
    if structure.quaternions:
        own = np.broadcast_to(axis, arms.shape)
        field[structure.positions] = np.cross(own, arms)
        p = q[structure.turns]
        field[structure.turns] = np.asarray(quaternions.derivative(as_jax(p), as_jax(own)))
    else:
        field[structure.positions] = np.stack([-arms[:, 1], arms[:, 0]], axis=1)
        field[structure.turns] = 1.0
    return field
