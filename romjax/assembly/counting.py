"""The angles of a system that count full turns, and the start of their counters."""

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_jax, pick
from ..compiling.program import program_once
from ..linalg.indexing import take
from ..linalg.inverse_mass import InverseMass
from ..scene.effect.joint_inertia import JointInertia
from ..scene.marker import Marker, Pose, Twist
from ..scene.state_carrier import StateCarrier
from ..scene.turn_counter import CounterJoint, TurnCounter
from ..system.structure import COUNTER_INERTIA

G = TypeVar("G")

# While that is looked for: of a counter that adds nothing to it [kg m²].
_ENDLESS = 1e30


_COUNTING = (TurnCounter, CounterJoint, StateCarrier)


def counters_of(
    parts: Sequence[Any], names: Sequence[str], before: Sequence[tuple[Marker, ...]]
) -> tuple[list[TurnCounter], list[CounterJoint], list[tuple[Marker, ...]]]:
    """The counters of parts with these `names`, what holds them, and the markers of each part, the
    ones `before` and those of its counters.
    """
    counters, holding, sides = list[TurnCounter](), list[CounterJoint](), []
    for part, name, markers in zip(parts, names, before, strict=True):
        dtype = markers[0].point.dtype if markers else float
        for number, (a, b) in enumerate(part.counted if _in_space(part) else ()):
            own = f"counter of {name}" if number == 0 else f"counter {number + 1} of {name}"
            marker = Marker(own, np.zeros(3, dtype), np.array([1, 0, 0, 0], dtype))
            inertia, motion = as_jax(np.asarray(_ENDLESS, dtype)), "angle"
            if isinstance(part, JointInertia):
                inertia, motion = part.inertia, part.motion
            counters.append(TurnCounter(own, inertia))
            holding.append(CounterJoint(part.markers[a], part.markers[b], marker, own, motion))
            markers = (*markers, marker)
        sides.append(markers)
    return counters, holding, sides


def counters_at_zero(part: Any, dtype: Any) -> tuple[list[Pose], list[Twist]]:
    """The poses and twists of the counters of a part that no system has: no turn is counted."""
    count, none = len(part.counted) if _in_space(part) else 0, jnp.zeros(3, dtype)
    pose = Pose(none, jnp.array([1, 0, 0, 0], dtype))
    return [pose] * count, [Twist(none, none)] * count


def carriers_of(
    parts: Sequence[Any], names: Sequence[str], dimension: int
) -> tuple[list[StateCarrier], list[tuple[Marker, ...]]]:
    """The carriers of the states of parts with these `names`, in a scene of a `dimension`, and the
    markers of each part with those of its carriers.
    """
    carriers, sides = list[StateCarrier](), []
    for part, name in zip(parts, names, strict=True):
        markers = part.markers
        for number, state in enumerate(getattr(part, "states", ())):
            own, begin = f"{state} of {name}", pick(part.initial(), number)
            unit = part.units[number] if getattr(part, "units", ()) else ""
            carriers.append(StateCarrier(name=own, unit=unit, dimension=dimension, begin=begin))
            still, turn = np.zeros(dimension), np.eye(4)[0] if dimension == 3 else 0.0
            placed = (np.asarray(x, begin.dtype) for x in (still, turn))
            markers = (*markers, Marker(own, *placed))
        sides.append(markers)
    return carriers, sides


def without_counters(groups: Sequence[G]) -> tuple[G, ...]:
    """The groups of bodies or of joints that are those of the scene: neither counters of turns, nor
    carriers of states.
    """
    own = (getattr(group, "bodies", None) or getattr(group, "joints", None) for group in groups)
    return tuple(g for g, x in zip(groups, own, strict=True) if not isinstance(x, _COUNTING))


def without_states(groups: Sequence[G]) -> tuple[G, ...]:
    """The groups of bodies that have kinetic energy: not the carriers of states."""
    return tuple(g for g in groups if not isinstance(getattr(g, "bodies", None), StateCarrier))


def bodies_coordinates(parts: Sequence[Any], q: np.ndarray, n: int) -> np.ndarray:
    """Return `q` (k, n + others) without what follows the coordinates of bodies, counters of turns
    and states of effects; other arrays stay as they are.
    """
    counted = sum(len(part.counted) for part in parts if _in_space(part))
    counted += sum(len(getattr(part, "states", ())) for part in parts)
    return q[:, :n] if q.ndim == 2 and q.shape[1] == n + counted else q


def _in_space(part: Any) -> bool:
    return bool(getattr(part, "counted", ())) and part.markers[0].dimension == 3


def with_counter_starts(system: Any) -> Any:
    """The system whose counters start at their angles, with inertias that suit what they count, but
    for those that are the inertias of joints.

    A counter that stands at zero violates its constraint by the angle.
    """
    return eqx.tree_at(
        lambda s: (
            s.q0,
            s.v0,
            next(g for g in s.bodies if isinstance(g.bodies, TurnCounter)).bodies.inertia,
        ),
        system,
        _start(system),
    )


@program_once
def _start(
    system: Any,
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " counters"]]:
    """The start of a system with that of its counters, and the counters' inertias."""
    group = next(group for group in system.bodies if isinstance(group.bodies, TurnCounter))
    holding = tuple(group for group in system.joints if isinstance(group.joints, CounterJoint))
    # The rows of all that hold counters come in the order of these.
    rows = np.sort(np.concatenate([joints.rows.array[:, 0] for joints in holding]))
    own, system = group.coordinates.array[:, 0], dataclasses.replace(system, joints=holding)
    zero = jnp.zeros((), system.q0.dtype)
    angle, speed = jax.jvp(lambda q: system.constraint(zero, q), (system.q0,), (system.v0,))
    inverse, sides = system.inverse_mass(system.q0), system.jacobian_blocks(zero, system.q0)
    inverse = InverseMass.of(system.mass_blocks(system.q0)) if inverse is None else inverse
    mobility = jnp.sum(inverse.apply(sides, system.pattern.bodies) * sides, axis=2)
    mobility = jnp.sum(take(mobility, system.pattern.sides_of_nodes), axis=1)
    mobility = system.pattern.join_rows(mobility)
    given, small = group.bodies.inertia, COUNTER_INERTIA / jax.lax.stop_gradient(mobility[rows])
    return (
        system.q0.at[own].set(angle[rows]),
        system.v0.at[own].set(speed[rows]),
        jnp.where(given < _ENDLESS, given, small),
    )
