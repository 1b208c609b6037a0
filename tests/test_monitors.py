"""Monitors of a user's own: one class, and nothing else, in any transformation."""

import contextlib

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj

END = 2.0
TS = np.linspace(0.0, END, 5)
# ∫ v² dt of x = cos 2t, up to the end.
ACTION = 2 * END - np.sin(4 * END) / 2
METHODS = {
    "Tsit5": diffrax.Tsit5(),
    "Rodas5P": zoo.RODAS5P,
    "Kvaerno5": diffrax.Kvaerno5(),
    "of two terms": diffrax.KenCarp4(),
}
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)


def place(system, t, q, v):
    return q[0]


class Action(rj.AbstractMonitor):
    """∫ v·v dt, and the number of steps that it took."""

    def start(self, system, start):
        return {"action": jnp.zeros_like(start.t), "steps": jnp.zeros((), int)}

    def follow(self, step, seen):
        begin, span = step.before.t, step.after.t - step.before.t
        squares = [jnp.sum(step.at(begin + (1 + x) / 2 * span).v ** 2) for x in NODES]
        added = span / 2 * jnp.sum(jnp.stack(squares) * WEIGHTS)
        return {"action": seen["action"] + added, "steps": seen["steps"] + 1}


class Last(rj.AbstractMonitor):
    """The state that came last."""

    def start(self, system, start):
        return start

    def follow(self, step, seen):
        return step.after


class Halvings(rj.AbstractMonitor):
    """The speed, halved by a loop until it is small."""

    is_transposed = False

    def start(self, system, start):
        return start.t

    def follow(self, step, seen):
        speed = jnp.abs(step.after.v[0])
        return jax.lax.while_loop(lambda x: x > 0.1, lambda x: 0.5 * x, speed)


class Growing(rj.AbstractMonitor):
    """One whose memory grows, which no compiled loop can have."""

    def start(self, system, start):
        return jnp.zeros(1)

    def follow(self, step, seen):
        return jnp.append(seen, step.after.t)


def swing(start, *monitors, **settings):
    """The motion from a deflection at rest, by default with its action."""
    follow = monitors or (Action(),)
    system = zoo.oscillator()
    return zoo.run(system, TS, q0=start[None], v0=jnp.zeros(1), follow=follow, **settings)


@pytest.mark.parametrize(
    "method", in_groups(METHODS, fast=["Tsit5"], slow=["Rodas5P", "Kvaerno5", "of two terms"])
)
def test_each_accepted_step_is_seen_once(method):
    """With events, dense output and the balance of energy beside, by methods of all kinds."""
    beside = {"events": [rj.Crossing(place)], "dense": True, "audit": True}
    run = swing(jnp.ones(()), Action(), Last(), solver=METHODS[method], **beside)
    seen, last = run.followed
    # Within steps the motion is that of dense output, which errs by more than their ends.
    assert abs(seen["action"] - ACTION) <= DIFFERENCED
    assert seen["steps"] == run.stats.num_accepted_steps
    assert last.t == END
    assert_close(last.q, run.q[-1], IDENTITY)
    assert run.balance is not None
    assert_close(run.events.time[: run.events.count], [np.pi / 4], SOLVED)
    assert_close(run.at(np.array([0.3])).q, [[np.cos(0.6)]], DIFFERENCED)


def test_under_jit_and_vmap():
    starts = jnp.array([0.5, 1.0, 3.0])
    seen = jax.jit(jax.vmap(lambda x: swing(x).followed[0]["action"]))(starts)
    assert_close(seen, ACTION * np.asarray(starts) ** 2, DIFFERENCED)


def motion_and_action(x):
    """Of a run with a loop beside it that reverse mode does not transpose."""
    run = swing(x, Action(), Halvings(), dt=1e-3, audit=False)
    return jnp.stack([run.q[-1, 0], run.followed[0]["action"]])


SLOPES = [np.cos(2 * END), 2 * ACTION]


def test_derivatives():
    """Of the motion and of what a monitor has seen."""
    assert_close(rj.jit(jax.jacrev(motion_and_action))(jnp.ones(())), SLOPES, SOLVED)


@pytest.mark.slow
def test_derivatives_in_forward_mode():
    with rj.forward_mode():
        assert_close(rj.jit(jax.jacfwd(motion_and_action))(jnp.ones(())), SLOPES, SOLVED)


def test_refused_derivatives():
    halvings = rj.jit(jax.grad(lambda x: swing(x, Halvings()).followed[0]))
    with pytest.raises(Exception, match=r"does not pass through what follow\[0\] \(Halvings\)"):
        halvings(jnp.ones(()))


class Rebounds(rj.AbstractMonitor):
    """How often a body is thrown back, and how fast."""

    def start(self, system, start):
        return jnp.zeros((), int), start.t

    def follow(self, step, seen):
        count, speed = seen
        turned = (step.at(step.after.t).v[0] < -0.1) & (step.after.v[0] > 0.1)
        return count + jnp.where(turned, 1, 0), speed + jnp.where(turned, step.after.v[0], 0.0)


def rebounds(wall):
    """From a wall at a place: how fast, and the run."""
    impact = rj.Impact(place, restitution=0.5, level=wall)
    run = swing(jnp.ones(()), Rebounds(), events=[impact], audit=False)
    return run.followed[0][1], run


# Half of √(4 − 4 x²), where x is the place of the wall, and its slope.
WALL, REBOUND = -0.6, [0.8, 0.75]


def test_with_events():
    """Of a step to an impact, the end is after it."""
    speed, run = rebounds(WALL)
    assert_close(speed, REBOUND[0], SOLVED)
    assert run.followed[0][0] == run.events.count == 1


@pytest.mark.slow
@pytest.mark.parametrize("by", [jax.jacfwd, jax.jacrev])
def test_derivatives_with_events(by):
    """By where the wall is."""
    with rj.forward_mode() if by is jax.jacfwd else contextlib.nullcontext():
        slope, run = rj.jit(by(rebounds, has_aux=True))(jnp.asarray(WALL))
    assert_close([run.followed[0][1], slope], REBOUND, SOLVED)


def test_what_is_no_monitor():
    with pytest.raises(rj.InputError, match=r"follow\[0\] is the class Action.*AbstractMonitor"):
        swing(jnp.ones(()), Action)
    with pytest.raises(rj.InputError, match=r"Growing\.follow returns float64\[2\].*float64\[1\]"):
        swing(jnp.ones(()), Growing())
