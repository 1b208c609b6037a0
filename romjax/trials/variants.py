"""The same mechanism from other starts, or driven and loaded at other speeds."""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from ..assembly.assemble import assemble
from ..assembly.assembled import AssembledSystem
from ..common.arrays import as_jax
from ..integrate.trajectory import Trajectory
from ..linalg import quaternions
from ..scene.marker import GROUND
from ..scene.scene import Scene, markers_of
from ..scene.signal import Constant, Held, is_signal, signals_of
from ..system.structure import without_names
from .facts import Joined, drives, joined
from .pace import at_speed


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
    scene: Scene, system: AssembledSystem, run: Trajectory, change: Change
) -> Iterator[AssembledSystem]:
    """Yield changed mechanisms, in all of which joints hold: with another speed of the drives and
    of the loads in time; without drives, at another speed of a start that moves, or from one that
    rests, tilted and turning about where it is held; and from a later state of the motion.

    The first that serves is meant: a load may hardly matter, and a tilt may bend what is stiff, of
    which no run follows the vibrations to their end. A later state is as smooth as the motion.
    """
    signals = signals_of((scene.joints, scene.effects))
    if any(not isinstance(x, Constant | Held) for x in signals):
        yield _paced(scene, system, change.speed)
    if drives(scene):
        return
    metric, v = np.asarray(run.metric), np.asarray(system.structure.without_states(run.v))
    squared = np.einsum("ki,ij,kj->k", v, metric, v)
    if squared[0] > _MOVING**2 * np.max(squared):
        yield _faster(system, system.q0, system.v0, change.speed)
    else:
        moved = _moved(scene, system, run, change)
        if moved is not None:
            yield moved
    k = int(len(v) * abs(change.tilt))
    yield _faster(system, run.q[k], run.v[k], change.speed)


def _faster(
    system: AssembledSystem, q: Float[Array, " n"], v: Float[Array, " n"], speed: float
) -> AssembledSystem:
    """The system from a state with velocities times `speed`; states of effects as they are."""
    rates = np.where(system.structure.is_state, v, speed * np.asarray(v))
    return dataclasses.replace(system, q0=q, v0=as_jax(rates))


def _paced(scene: Scene, system: AssembledSystem, speed: float) -> AssembledSystem:
    """Scale the speed of all signals, and the rates of the start, so that joints still fit."""
    joints, effects = jax.tree.map(
        lambda x: at_speed(x, speed) if is_signal(x) else x,
        (scene.joints, scene.effects),
        is_leaf=is_signal,
    )
    other = assemble(Scene(scene.bodies, joints, effects))
    return _faster(other, system.q0, system.v0, speed)


def _moved(
    scene: Scene, system: AssembledSystem, run: Trajectory, change: Change
) -> AssembledSystem | None:
    """Return the mechanism tilted and turning as a whole, as far as the joints allow; None where
    they allow nothing.
    """
    posed = _Posed(system, np.asarray(run.metric))
    pivot, axis = _pivot(scene, system), np.asarray(change.axis) / np.linalg.norm(change.axis)
    q0, q, v = (
        np.asarray(system.q0),
        np.asarray(run.q),
        np.asarray(system.structure.without_states(run.v)),
    )
    whole = _turning(system, q0, pivot, axis)
    field = posed.fitting(q0, whole)
    if posed.size(field) <= _HELD * posed.size(whole):
        return None
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
