"""How fast a system is: what the choice of a method and of a stabilisation needs."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..common.arrays import Time
from ..linalg import quaternions
from ..linalg.dense import length
from ..scene.effect.base import AbstractMarkerEffect
from .base import AbstractSystem
from .dynamics import solve
from .stabilization import Baumgarte
from .start import extent_of
from .state import AbstractState

# Makes a system whose effects that may begin act, or not.
_Acting = Callable[[Bool[Array, ""]], AbstractSystem]
# Steps of the power iteration: the estimate settles a choice, not a result.
_ITERATIONS = 12
# Vibrations for which a motion lasts that counts: in fewer, errors of its phase stay small.
_LASTING = 20.0


class Frequencies(NamedTuple):
    """The fastest frequencies of a system at one state [rad/s]."""

    rigid: Float[Array, ""]  # fastest rigid-body frequency
    fastest: Float[Array, ""]  # fastest frequency or rate of decay of all
    spin: Float[Array, ""]  # fastest angular velocity of a body in space
    # Root of the largest angular acceleration of a body: about how fast one turns that is let go.
    swing: Float[Array, ""]
    # Fastest swing of a body, turning or not, that nothing damps.
    lasting: Float[Array, ""]
    # Fastest of all while effects act that may begin on the way: zero without such, and infinite
    # where their stiffness is unknown, as with friction, or where nobody asks.
    acting: Float[Array, ""]
    turns: "Turns | None" = None  # None without bodies


def frequencies(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    with_acting: bool = True,
) -> Frequencies:
    """The fastest frequencies at a state; `with_acting`: those with all effects acting too.

    Of a reduced system with constraints, the rigid one is that of the full system: it sets the
    stabilisation, and reduced coordinates know no bodies.
    """
    acting = with_all_acting(system) if with_acting and system.structure.contacts else None
    rigid, fastest, all_acting = _estimate(system, t, q, v, acting)
    if system.m > 0 and system.full is not system:
        state = system.state(t, q, v)
        rigid, *_ = _estimate(system.full, t, state.q, state.v, None)
    spin = swing = lasting = jnp.zeros_like(fastest)
    turns = None
    if system.full.structure.frames:
        turns = Turns.of(system, t, q, v, _unstabilized(system, q))
        swing, lasting = (jnp.sqrt(jnp.max(x)) for x in (turns.changes, turns.swings))
        # In the plane a balanced body turns without any effort.
        spin = jnp.max(turns.spins) if system.full.structure.quaternions else spin
    return Frequencies(rigid, fastest, spin, swing, lasting, all_acting, turns)


class Turns(NamedTuple):
    """How all bodies turn and swing at a state, (bodies,) each; numbers that are not finite, of
    which the run tells, are zero.

    - `spins`, `changes`: the sizes of angular velocities [rad/s] and accelerations [rad/s²].
    - `swings`: squares ω² [rad²/s²] of how fast bodies go round or to and fro, turning or not,

          ω² = min((a + |∂a/∂r v| / ω₀) / ℓ, ω₀²),   ω₀² = |∂a/∂r|:

      as about an equilibrium that is as far as the mechanism is large, ℓ, no faster than they
      vibrate, and not at all in free flight. A body that is hit at its equilibrium has its largest
      acceleration, ω₀ v, later. Derivatives are those along the acceleration and along the
      velocity, the larger of them. Zero where forces take or give energy too fast for motions to
      last.
    """

    spins: Float[Array, " bodies"]
    changes: Float[Array, " bodies"]
    swings: Float[Array, " bodies"]

    @classmethod
    def of(
        cls,
        system: AbstractSystem,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        stabilization: Baumgarte | None,
    ) -> "Turns":
        full, t, places = system.full, jnp.asarray(t, q.dtype), system.full.structure.positions
        state = system.state(t, q, v)
        extent, speeds = extent_of(full, t, state.q), length(state.v[places])
        # As in `_estimate`, and in lengths.
        step = jnp.sqrt(jnp.finfo(q.dtype).eps) * extent

        def accelerated(along: Array, ways: Array) -> tuple[Array, tuple[Array, Array]]:
            # A loop, since the acceleration is most of the program; `along` is that of the start.
            place = q + step * (ways[0] * along + ways[1] * v / _positive(jnp.max(speeds)))
            moved = system.state(t, place, v)
            found = solve(system, t, place, v, stabilization).acceleration
            a = moved.physical_acceleration(found)
            first = found / _positive(jnp.max(length(a[places])))
            return jnp.where(jnp.any(ways > 0), along, first), (moved.q[places], a)

        ways = jnp.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], q.dtype)
        _, (at, a) = jax.lax.scan(accelerated, 0 * q, ways)
        moved, changed = (length(x[1:] - x[:1]) for x in (at, a[:, places]))
        squares = jnp.max(changed / _positive(moved), axis=0)
        later = changed[1] / _positive(step) * jnp.max(speeds) / _positive(jnp.sqrt(squares))
        pulls = length(a[0][places]) + later
        swings = jnp.minimum(pulls / _positive(extent), squares)
        swings = jnp.where(_lasts(full, t, state, a[0], jnp.sqrt(jnp.max(swings))), swings, 0)
        spins, changes = (length(spins_of(full, state.q, x)) for x in (state.v, a[0]))
        return cls(spins, *(jnp.where(jnp.isfinite(x), x, 0) for x in (changes, swings)))


def _lasts(
    full: AbstractSystem, t: Time, state: AbstractState, a: Float[Array, " N"], rate: Array
) -> Bool[Array, ""] | bool:
    """Whether forces take and give so little energy that a motion of a `rate` [rad/s] lasts for
    `_LASTING` vibrations.

    The power P that dampers take while the kinetic energy is T makes the energy of a vibration fall
    at the rate P / 2T, and its amplitude at half of that: it lasts for about 2T / P.
    """
    moving = full.state(t, state.q, state.v + a / _positive(rate))
    power = moving.power()
    if power is None:
        return True
    taken = jnp.abs(power.dissipation) + jnp.abs(power.supply)
    return taken * 2 * np.pi * _LASTING <= rate * 2 * moving.energy().kinetic


def _positive(x: Array) -> Array:
    """One for zero, which is divided by where nothing moves."""
    return jnp.where(x > 0, x, 1)


def spins_of(
    full: AbstractSystem, q: Float[Array, " N"], v: Float[Array, " N"]
) -> Float[Array, "bodies axes"]:
    """The angular velocity of each body of a full system [rad/s], in space by its axes."""
    structure: Any = full.structure
    q, v = q[structure.turns], v[structure.turns]
    return quaternions.angular_velocity(q, v) if structure.quaternions else v


def _unstabilized(system: AbstractSystem, q: Float[Array, " n"]) -> Baumgarte | None:
    """Zero stabilisation instead of none: the trace of the acceleration then serves the steps."""
    return Baumgarte(jnp.zeros((), q.dtype), jnp.zeros((), q.dtype)) if system.m else None


def with_all_acting(system: AbstractSystem) -> _Acting | None:
    """Return the system with its effects that may begin, acting or not; None where it has none, or
    one whose stiffness is unknown.
    """

    def changed(acts: Bool[Array, ""]) -> AbstractSystem:
        def change(x: Any) -> Any:
            begins = isinstance(x, AbstractMarkerEffect) and x.begins
            return x.acting(acts) if begins else x

        other: AbstractSystem = jax.tree.map(change, system, is_leaf=_is_effect)
        return other

    effects = [x for x in jax.tree.leaves(system, is_leaf=_is_effect) if _is_effect(x)]
    beginning = [x for x in effects if x.begins]
    known = all(x.acting(jnp.zeros((), bool)) is not None for x in beginning)
    return changed if beginning and known else None


def _is_effect(x: Any) -> bool:
    return isinstance(x, AbstractMarkerEffect)


def _estimate(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    acting: _Acting | None,
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """The fastest frequency of rigid motion, that of all, and that with all effects acting [rad/s].

    By power iteration with products only, in the metric of M.

    ω² = |∂a/∂q| sees springs, flexible modes, gravity on hinged bodies and rotation; the rate
    |∂a/∂v| sees dampers. Three directions are iterated at once: among the rigid coordinates for
    ∂a/∂q, among all for ∂a/∂q, and among all for ∂a/∂v; and a fourth for ∂a/∂q of the system whose
    effects are `acting`, where this is given.
    """
    # Difference quotients: the derivative would double the program for a rough number. At the root
    # of the rounding unit their truncation, in proportion to the step, is as large as their
    # rounding, in proportion to its inverse.
    step = jnp.sqrt(jnp.finfo(q.dtype).eps)
    everywhere = [jnp.ones(system.n, bool)] * (2 if acting is None else 3)
    among = jnp.stack([jnp.array(system.structure.rigid), *everywhere])
    t, state = jnp.asarray(t, q.dtype), system.state(t, q, v)
    unstabilized = _unstabilized(system, q)
    # For each acceleration, the direction of positions or of velocities that is added to the state,
    # −1 for none, and whether all effects act.
    moved, faster = np.array([0, 1, -1, -1, 3, -1]), np.array([-1, -1, -1, 2, -1, -1])
    acts = np.arange(6) > 3
    count = 4 if acting is None else 6

    def sizes(x: Float[Array, "directions n"]) -> Float[Array, " directions"]:
        return jnp.sqrt(jnp.sum(x * state.apply_mass(x.T).T, axis=1))

    def acceleration(at: tuple[Array, Array, Array]) -> Array:
        by_q, by_v, all_act = at
        own = system if acting is None else acting(all_act)
        return solve(own, t, q + step * by_q, v + step * by_v, unstabilized).acceleration

    def push(x: Array, _: None) -> tuple[Array, Array]:
        directions = jnp.concatenate([x, jnp.zeros_like(x[:1])])
        # A loop, not a batch: as a batch, the acceleration would be traced and compiled once more.
        at = directions[moved[:count]], directions[faster[:count]], acts[:count]
        pushed = jax.lax.map(acceleration, at)
        ends, starts = np.array([0, 1, 3, 4][: len(x)]), np.array([2, 2, 2, 5][: len(x)])
        change = jnp.where(among, (pushed[ends] - pushed[starts]) / step, 0)
        size = sizes(change)
        return change / jnp.where(size > 0, size, 1)[:, None], size

    # No symmetric direction, so that no mode of a symmetric mechanism is missed.
    x = jnp.where(among, jnp.cos(1.0 + jnp.arange(system.n, dtype=q.dtype) ** 1.5)[None], 0)
    size = sizes(x)
    start = x / jnp.where(size > 0, size, 1)[:, None]
    _, stretches = jax.lax.scan(push, start, None, length=_ITERATIONS)
    # The largest stretch met, not the last: a level pendulum's ∂a/∂q is nilpotent.
    rigid, all_, rate, *stops = jnp.max(stretches, axis=0)
    unknown = jnp.full_like(rigid, jnp.inf if system.structure.contacts else 0)
    fastest = jnp.maximum(jnp.sqrt(all_), rate)
    return jnp.sqrt(rigid), fastest, jnp.sqrt(stops[0]) if stops else unknown
