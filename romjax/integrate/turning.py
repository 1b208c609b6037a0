"""Tolerances of steps by which runs in which bodies turn many times, and motions that magnify
errors, are right.

Errors of the steps change the energy of a body that turns, all with one sign, so that its angular
velocity drifts in proportion to the turns N and to the tolerance, and its angle as N². With
tolerances that go with 1/N² the error of the angle is the same after a hundred turns as after
three; methods of a high order err by less the tighter they are.

So do angles of bodies that swing far, whose frequency changes with their energy: of a pendulum of
the amplitude a, dω/ω = -a² dE / 16 E where one that whirls has dE / 2 E. A body of the angular
velocity ω and acceleration α counts with the angular velocity √(ω² + 2 |α| φ) that it has when it
has turned by φ more, a quarter of a radian. Bodies that go round or swing without turning, as a
mass on a spring does, count alike with √(2 φ) of their ω (`Turns`), where that lasts for twenty
vibrations.

Explicit methods are as accurate in any run as in one of five turns, at a third of the tolerance,
whether anything turns or not. A motion close to an unstable equilibrium magnifies errors, as of a
bar that is let go near its top, some hundred times without any sign of it. Dopri8 takes an eighth
more steps, and errs half as much in most motions, and four to thirty times less in those.
"""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..common.partition import detached
from ..system.base import AbstractSystem
from ..system.frequencies import Turns
from ..system.local import local_system
from ..system.mobility import moves
from ..system.stabilization import Baumgarte
from .settings import Settings

# Turns after which angles of free bodies and whirling pendulums err by 5 to 50 times the tolerance.
TURNS = 3.0
# The angle that bodies have turned on when their angular velocity counts [rad].
_LATER = 0.25
# Turns that explicit methods allow for at least.
_FEWEST = 5.0
# Turns beyond which steps get no shorter: those of Rodas5P are four times as many by then, and a
# run that an event or a brake ends early has paid for turns that it does not make.
MOST = 100.0
# Nothing is below, in units in the last place, where rounding errors are those of a step.
_DIGITS = 500


def turning(
    system: AbstractSystem,
    t: Time,
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    stabilization: Baumgarte | None,
    turns: Turns | None = None,
) -> Float[Array, ""]:
    """How fast bodies turn at a state, or swing, by the rules of this module [rad/s]; `turns`: of
    the state, if they are known.

    Zero where joints move with time, since no angle drifts that is prescribed.
    """
    full = system.full
    if not full.structure.frames or (full.m and moves(full)):
        return jnp.zeros((), q.dtype)
    if turns is None:
        # Derivatives of what they do not reach would be a tenth of the program of a gradient.
        turns = Turns.of(*detached(system, t, q, v, stabilization))
    squares = jnp.maximum(turns.spins**2 + 2 * _LATER * turns.changes, 2 * _LATER * turns.swings)
    return jnp.sqrt(jnp.max(squares))


def turning_rtol(
    rtol: Any, turning: Float[Array, ""], span: Any, fewest: float = TURNS
) -> Float[Array, ""]:
    """The relative tolerance of the steps of a run that lasts for `span` [s], in which bodies go on
    with the angular velocity `turning` of its start, but make the `fewest` turns at least.
    """
    turns = turning * jax.lax.stop_gradient(span) / (2 * np.pi)
    least = jnp.minimum(rtol, _DIGITS * jnp.finfo(turns.dtype).eps)
    return jnp.maximum(rtol * (TURNS / jnp.clip(turns, fewest, MOST)) ** 2, least)


def for_turns(
    system: AbstractSystem,
    post_step: Any,
    ts: Float[Array, " k"],
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
    settings: Settings,
) -> Settings:
    """The settings of a run with tolerances of its steps for as many turns as bodies make in it,
    and for no fewer than any run allows for; tolerances that are given, and do not follow the
    motion, stay.
    """
    if settings.dt is not None:
        return settings
    known = settings.known_start(system)
    turns = None if known is None else known.frequencies.turns
    chart = None if post_step is None else post_step.start(system)
    if chart is not None:
        system, turns = local_system(system, post_step, (q0, v0, chart)), None
    fewest = _FEWEST if isinstance(settings.solver, diffrax.AbstractERK) else TURNS
    speed = turning(system, ts[0], q0, v0, settings.baumgarte, turns)
    finer = turning_rtol(settings.rtol, speed, ts[-1] - ts[0], fewest)
    # The `atol` of root finders may be finer already.
    rtol = jnp.where(settings.follow, finer, settings.rtol)
    atol = jnp.where(settings.follow, jnp.minimum(settings.atol, finer), settings.atol)
    return settings._replace(rtol=rtol, atol=atol)
