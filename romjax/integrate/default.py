"""Choices that a simulation makes where the user makes none."""

import functools
import warnings
from typing import Any, NamedTuple, cast

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common import precision
from ..common.arrays import concrete
from ..common.compat import is_outermost, is_traced
from ..common.identity_cache import IdentityCache
from ..compiling.program import program_once
from ..system.base import AbstractSystem
from ..system.frequencies import Frequencies, frequencies, with_all_acting
from ..system.stabilization import Baumgarte
from ..system.start import Start
from .adjoint import has_root_finder
from .rodas5p import Rodas5P
from .settings import AtStart
from .trajectory import Trajectory
from .turning import MOST, TURNS

# A run with fewer outputs is judged as if it had so many: it may be asked for its end alone.
_OUTPUTS = 100
# Steps that Rodas5P takes at least, and how many times those of Dopri8 where the fast vibration has
# to be followed. Dopri8 takes steps of at most this over the fastest frequency.
_FEWEST, _FOLLOWING, _STABLE = 50, 1.4, 4.0
# Steps of Dopri8 up to which swings, and rods without damping, are followed: Rodas5P takes more of
# them, each at several times the cost (measured for pendulums of a rod up to 4000 steps, whose tips
# turn by 1 to 1e-3).
_RUNG = 1e4
# Steps that Rodas5P takes at least in a swing that nothing damps, where a run has few of them, and
# how they grow with their number N, since tolerances go with 1/N² (`turning.py`).
_SWING, _FINER = 20.0, 2 / 5
# Steps of Dopri8 up to which a system may rest on its stops or contacts for all of a run.
_RESTED = 1e4
# What a step of Rodas5P costs in steps of Dopri8: by parts, whatever the number of coordinates; of
# the whole residual, at first and for each coordinate.
_BY_PARTS, _WHOLE, _COORDINATE = 2.0, 1.5, 0.1
# A fixed step times a frequency that an explicit method still follows.
_RESOLVED = 1.0
# A spinning body has no frequency above this many times its angular velocity of its own: that of
# nutation is up to the ratio of two moments of inertia. Two is the ratio of a thin disc, which no
# body exceeds, as no moment is larger than the sum of the others.
_SPINS = 2.0
# A pendulum that swings by an amplitude a of some tenths of a radian or more has no frequency above
# this many times the root of its angular acceleration, which is 1 / √(sin a) times.
_SWINGS = 2.0
# Share of the fastest frequency at which Baumgarte's terms leave the step to the mechanism.
_UNRESOLVED = 0.25
# Baumgarte's terms set the step if their rate is this many times the mechanism's, and comparable
# with the steps that were taken.
_FASTER, _COMPARABLE = 3.0, 0.25
# Runs of fewer steps are not judged, since the first steps of any run are short.
_STEPS = 100


_known = IdentityCache()


def start_frequencies(
    system: AbstractSystem,
    ts: Float[Array | np.ndarray, " k"],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
) -> Frequencies:
    """Return the frequencies at the first of some times, which are remembered as by `at_start`."""
    return at_start(system, ts, q, v).frequencies


def at_start(
    system: AbstractSystem,
    ts: Float[Array | np.ndarray, " k"],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
) -> AtStart:
    """Return what is known of the first of some times, remembered for the own start and the latest
    other one.
    """
    t = ts[0] if is_traced(ts) else np.asarray(ts, q.dtype)[0, ...]
    # What is a part of the user's program is a tracer.
    if not is_outermost():
        asks = system.structure.contacts and _is_known((q, system, t, v))
        return _at_start(system, t, q, v, asks)
    is_own = q is system.q0 and v is system.v0
    key = tuple([np.asarray(x).tobytes() for x in ((t,) if is_own else (t, q, v))])
    known: dict[bool, Any] = _known.get(system) or _known.put(system, {})
    at, found = known.get(is_own, (None, None))
    if at != key:
        found = _at_start(system, t, q, v, system.structure.contacts)
        known[is_own] = key, found
    return cast(AtStart, found)


@program_once
def _at_start(
    system: AbstractSystem,
    t: Float[Array | np.ndarray, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    with_acting: bool,
) -> AtStart:
    """Return what is known of a start: a program for all methods, which compiles faster than as a
    part of a run; settings are not differentiated.
    """
    share = precision.of(q.dtype).start_tolerance
    t = jnp.asarray(t, q.dtype)
    energy = system.state(t, q, v).energy().total if system.n else jnp.zeros_like(t)
    found, energy = jax.lax.stop_gradient((frequencies(system, t, q, v, with_acting), energy))
    return AtStart(found, Start.of(system, t, q, v, share), energy)


def _is_known(x: Any) -> bool:
    """Whether results of a program of these numbers, without their derivatives, will be known."""
    arrays = (leaf for leaf in jax.tree.leaves(x) if isinstance(leaf, jax.Array | np.ndarray))
    return all(not is_traced(jax.lax.stop_gradient(array)) for array in arrays)


class Method(NamedTuple):
    """A solver, and why it is taken, in words that follow "since"."""

    solver: diffrax.AbstractSolver[Any]
    reason: str


def default_method(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    dt: Float[Array | np.ndarray, ""] | None,
    start: Frequencies,
) -> Method:
    """Rodas5P for stiff systems, Dopri8 for others.

    Stiff: the fastest frequency is above what the outputs can show, half their rate (counted as a
    hundred at least), or above what a fixed step resolves. Between its long steps, outputs of
    Dopri8 carry some twenty times the tolerance. While JAX traces, numbers are unknown,
    and flexible systems count as stiff. So do contacts with friction, which sticks as fast as its
    creep is slow, with any step size control. How fast a system is on stops, taut ropes and
    contacts without friction limits steps only while it is there: pendulums between stops took 2 to
    4 times as many steps by Rodas5P (36 at random, up to 5000 rad a run), with errors up to 60
    times as large, and ropes and contacts twice as many. It counts where a run that rests there
    throughout would take Dopri8 more than ten thousand steps, of a contact about a millimetre deep.
    A fast spin in space is not stiff: every method has to follow it; nor are swings of a body that
    is let go far from its equilibrium, nor rods without damping, whose fast vibrations are in what
    bends far.

    Whether the fast vibration is excited is unknown before the run. If it is not, Rodas5P takes
    few steps; if it is, both methods follow it, and Rodas5P's steps cost c times as much: 2 where
    its derivatives come by parts, 1.5 + n/10 where its matrices are dense (measured for 8 to 96
    coordinates). Rodas5P is taken if Dopri8 instead of it would at worst lose a larger factor,
    E / (50 c) with E steps, than Rodas5P instead of Dopri8 does at worst, 1.4 c. Where
    bodies make N swings that nothing damps, Rodas5P takes at least 20 N (N / 3)^0.4 instead of 50,
    for the tolerances that they ask for (a mass that swings on a spring a hundred times, while
    that could vibrate 560 times: 26 000, and Dopri8 6600).
    """
    explicit, implicit = _solvers()
    known, times, step = concrete(start.fastest), concrete(ts), concrete(dt)
    ringing = system.structure.flexible and system.full.structure.ringing
    if known is None or times is None or (dt is not None and step is None):
        flexible = system.structure.flexible and not ringing
        contacts = system.structure.contacts and with_all_acting(system) is None
        stiff = flexible or contacts
        return Method(implicit if stiff else explicit, "numbers are unknown while JAX traces")
    if dt is not None:
        if known * step > _RESOLVED:
            return Method(implicit, "a step does not resolve the fastest frequency")
        return Method(explicit, "a step resolves the fastest frequency")
    # Python's numbers take a tenth of the time of NumPy's.
    acting = float(np.asarray(start.acting))
    if acting == np.inf:
        return Method(implicit, "contacts may begin that stick by friction")
    outputs, span = len(times) - 1, float(times[-1] - times[0])
    acting = acting if acting * span / _STABLE > _RESTED else 0.0
    fastest = max(float(known), acting)
    spin, swing = (float(np.asarray(x)) for x in (start.spin, start.swing))
    if 0 < fastest <= _SPINS * spin:
        return Method(explicit, "the spin of a body, which has to be followed, is as fast as any")
    cost = _BY_PARTS if system.structure.by_parts else _WHOLE + _COORDINATE * system.n
    if fastest * span / max(outputs, _OUTPUTS) <= np.pi:
        return Method(explicit, "the outputs can show the fastest frequency")
    if fastest <= _SWINGS * swing and fastest * span / _STABLE <= _RUNG:
        return Method(explicit, "a body swings as fast as anything, and has to be followed")
    if ringing and fastest * span / _STABLE <= _RUNG:
        return Method(explicit, "what bends far without damping vibrates, and has to be followed")
    swings = float(np.asarray(start.lasting)) * span / (2 * np.pi)
    fewest = max(_FEWEST, _SWING * swings * (min(max(swings, TURNS), MOST) / TURNS) ** _FINER)
    if fastest * span / _STABLE <= fewest * _FOLLOWING * cost**2:
        return Method(explicit, "steps that resolve the fastest frequency are cheaper here")
    return Method(implicit, "the fastest frequency is far above what the outputs can show")


@functools.cache
def _solvers() -> tuple[diffrax.AbstractSolver[Any], diffrax.AbstractSolver[Any]]:
    """The explicit method, and the one for stiff systems."""
    return diffrax.Dopri8(), Rodas5P()


def default_stabilization(
    system: AbstractSystem,
    ts: Float[Array, " k"],
    dt: Float[Array | np.ndarray, ""] | None,
    start: Frequencies,
) -> Baumgarte | None:
    """Critical damping at ω: α = 2ω, β = ω², with the fastest rigid frequency in fixed steps, and a
    quarter of it with step size control.

    Faster stabilisation buys no accuracy: it limits the step and lowers the order of explicit
    methods, so ω dt stays below 0.1. The fastest frequency may be one that nothing excites, which
    step size control need not resolve: at the whole of it a chain of 32 ball joints takes 108 steps
    instead of 57, at no smaller an error. ω is at least one turn in the simulated time, so that a
    mechanism that nothing drives at the start is stabilised too.
    """
    if system.m == 0:
        return None
    slowest = 2 * jnp.pi / (ts[-1] - ts[0])
    if dt is None:
        return Baumgarte.critical(jnp.maximum(_UNRESOLVED * start.rigid, slowest))
    return Baumgarte.critical(jnp.minimum(jnp.maximum(start.rigid, slowest), 0.1 / dt))


def warn_of_fast_stabilization(
    system: AbstractSystem,
    trajectory: Trajectory,
    q0: Float[Array, " n"],
    v0: Float[Array, " n"],
) -> None:
    """Warn if Baumgarte's terms, and not the mechanism, have set the step of an explicit method."""
    baumgarte = trajectory.stats.stabilization
    is_stiff = isinstance(trajectory.solver, Rodas5P) or has_root_finder(trajectory.solver)
    if not isinstance(baumgarte, Baumgarte) or is_stiff:
        return
    numbers = (baumgarte.alpha, baumgarte.beta, trajectory.stats.num_accepted_steps)
    if any(concrete(x) is None for x in (*numbers, trajectory.t, q0, system.q0)):
        return
    # NumPy is used since each operation of JAX on its own would take as long as a short run.
    alpha, beta, steps = (np.asarray(x, float) for x in numbers)
    times = np.asarray(trajectory.t)
    # |s| of s² + α s + β = 0
    rate = float(np.max(np.abs(alpha / 2 + np.sqrt(alpha**2 / 4 - beta + 0j))))
    step = float(times[-1] - times[0]) / max(float(steps), 1.0)
    if steps < _STEPS or rate * step < _COMPARABLE:
        return
    fastest = float(start_frequencies(system, trajectory.t, q0, v0).fastest)
    if rate > _FASTER * fastest:
        warnings.warn(
            f"The stabilisation and not the mechanism sets the step: Baumgarte's terms decay at "
            f"{rate:.3g} /s, the fastest frequency of the mechanism is {fastest:.3g} rad/s, and "
            f"{trajectory.solver_name} took steps of {step:.2g} s. Use "
            # Where nothing pulls the frequency is zero, and a term of that rate would hold no
            # joint.
            f"romjax.Baumgarte.critical({max(fastest, 1e-3):.2g}), romjax.Projection(), or "
            "romjax.Rodas5P().",
            stacklevel=3,
        )
