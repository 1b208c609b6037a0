"""Contacts that begin or end within a step: surfaces that a point passes, inwards or outwards."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..march.cuts import AbstractPassage
from ..system.base import AbstractSystem
from ..system.dynamics import solve
from ..system.held import can_hold, goes_on, hold, oscillates
from ..system.local import local_system
from ..system.stabilization import Baumgarte
from .search import first_crossing

# The side of a surface on which a step starts is judged after this share of the step, since a step
# that follows a cut starts on the surface itself. A law that is held acts as much too early or late
# as that is wrong, which derivatives see: sooner there.
_START, _START_HELD = 1e-3, 1e-4
# A step that crosses in this last share of its length counts as ending at the surface; and no step
# is cut to less than so many units in the last place of the time.
_END, _SHORTEST = 1e-6, 100
# A point this deep inside still counts as outside, in units in the last place of the largest
# coordinate.
_ROUNDING = 100
# The stages of a step deviate from the motion by about its curvature. A step ends so far from a
# surface, in multiples of that, that its stages stay outside.
_AWAY = 4.0
# One whose law is held goes through the surface, and is cut there: but it takes no longer than so
# many times what it needs, so that dense output resolves how a point turns on the way.
_THROUGH = 1.7
# Newton's method takes so many steps for that: each squares the error, which is a factor of two at
# first.
_ITERATIONS = 6
# A contact counts as beginning if it does so within this share of the planned step. Its force is
# evaluated after twice that time.
_NOW = 1e-5
# The length of the first step within a contact, in units of rtol^(1/5) times the time in which the
# force reverses the motion. The error of the motion would allow 20 times as much, but the error
# of its derivatives, which is larger, would not.
_FIRST = 0.03
# Steps towards the end of a contact go so far of the way there, until its force changes the speed
# by less than this from there on, in units of rtol. The derivative of the force by the depth is no
# smooth function of time there: one step to the end, as long as the motion allows, would give
# derivatives of the motion that err by percents.
_LEFT, _FAINT = 0.5, 1e-2
# Bisections of a step that passes a surface. Events take fewer: a step that ends so near to one
# may not notice that it has reached it, so that the next one is just as short.
_BISECTIONS = 30


class Passage(AbstractPassage):
    """Finds the steps that pass the surface of a contact, or a stop, where its force has a kink.

    What a step across a kink estimates of its error may be zero by chance, and a step through a
    contact that is outside at both ends has seen no force at all. Such a step is repeated so that
    it ends at the surface that it passes first. The next one starts there, and what it does not
    know of the force is then a fixed share of what it estimates, as long as it is short.

    The force itself is small at a kink, and its derivative is not: stages there, which rounding
    puts on either side, would give derivatives of motions that err by percents. So effects that can
    be `held` have one law in all of a step, that of the side on which it starts. As its stages do
    not feel the other law, what begins and ends within a step is looked for by dense output.

    - `stabilization`: of the accelerations. `rtol`: of the run.
    - `hard` (contacts,): which of them have a law that does not go on smoothly, as the force of a
      contact, which grows otherwise than in proportion.
    - `holds` (contacts,): which of them can be held. `oscillates` (contacts,): which of them a long
      step, of bodies that just turn, might pass again and again.
    """

    system: AbstractSystem
    post_step: Any
    stabilization: Baumgarte | None
    rtol: Float[Array, ""]
    hard: tuple[bool, ...] = eqx.field(static=True)
    holds: tuple[bool, ...] = eqx.field(static=True)
    oscillates: tuple[bool, ...] = eqx.field(static=True)

    @classmethod
    def of(
        cls, system: AbstractSystem, post_step: Any, stabilization: Baumgarte | None, rtol: Any
    ) -> "Passage | None":
        """Return the object for a system, or None if none of its effects may begin."""
        full = system.full
        gaps = full.state(jnp.zeros(()), full.q0, full.v0).gaps()
        if gaps is None:
            return None
        hard = tuple(not smooth for smooth in goes_on(full))
        holds = can_hold(system)
        # A system of samples has the effects of the full one once more, in the same order.
        own = holds[: len(gaps)]
        again = holds == own * (len(holds) // len(gaps))
        holds = own if again else (False,) * len(gaps)
        rtol = jnp.asarray(rtol)
        return cls(system, post_step, stabilization, rtol, hard, holds, oscillates(full))

    def held(
        self, term: Any, t0: Float[Array, ""], t1: Float[Array, ""], y: Any
    ) -> tuple[Any, Float[Array, " contacts"] | None, Any]:
        """Return the term of a step from `y`, whose effects are held on the side on which they
        start; these sides, 0 where they are not held, or None; and whether one of them starts where
        it begins or ends.
        """
        if not any(self.holds):
            return term, None, False
        gaps, rates = jax.lax.stop_gradient(self._gaps_and_rates(t0, y))
        t0, t1 = jax.lax.stop_gradient((t0, t1))
        after = gaps + _START_HELD * (t1 - t0) * rates
        told = jnp.array(self.holds) & (jnp.abs(after) > self._noise)
        near = jnp.abs(gaps) <= 2 * _START_HELD * (t1 - t0) * jnp.abs(rates) + self._noise
        sides = jnp.where(told, jnp.sign(after), 0.0)
        return hold(term, sides), sides, jnp.any(told & near)

    def passed(
        self,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        sides: Float[Array, " contacts"] | None,
        between: diffrax.AbstractLocalInterpolation,
    ) -> tuple[Bool[Array, ""], Float[Array, ""]]:
        """Whether a step with effects held on `sides` passes a surface, and where it has to end
        instead [s].
        """
        span = t1 - t0

        def gaps(share: Array) -> Array:
            t = t0 + share * span
            return self._gaps(t, between.evaluate(t))

        one, yes = jnp.ones_like(t0), jnp.ones(1, bool)
        # A contact that is closed at the start opens by a crossing too: each gap counts by the side
        # that it starts on.
        side = jnp.sign(gaps(_START * one))
        if sides is not None:
            side = jnp.where(sides != 0, sides, side)

        def nearest(share: Array) -> Array:
            """How far the first one to pass its surface is from it, on the side of its start."""
            return jnp.min(jnp.where(side != 0, side * gaps(share), jnp.inf), keepdims=True)

        noise = self._noise[None]
        crossing = first_crossing(nearest, one[None], nearest(one), noise, yes, ~yes, _BISECTIONS)
        return self._cut(t0, t1, crossing.exists, crossing.share)

    def _cut(
        self, t0: Array, t1: Array, exists: Array, share: Array
    ) -> tuple[Bool[Array, ""], Float[Array, ""]]:
        """Whether to end a step at a share of it where it crosses a surface, and when that is."""
        span = t1 - t0
        shortest = _SHORTEST * jnp.finfo(t0.dtype).eps * jnp.maximum(jnp.abs(t0), jnp.abs(t1))
        # A cut at either end would leave a step of nothing but rounding.
        is_within = (share < 1 - _END) & ((1 - share) * span > shortest)
        if not any(self.holds):
            is_within &= (share > _START) & (share * span > shortest)
            return exists & is_within, t0 + share * span
        # A law that was held on the wrong side from the start ends as soon as it may.
        later = jnp.maximum(share * span, 2 * shortest)
        return exists & is_within & (span > 4 * shortest), t0 + later

    def next_end(
        self, t: Float[Array, ""], y: Any, planned: Float[Array, ""], keep: Bool[Array, ""]
    ) -> Float[Array, ""]:
        """Return the time at which the next step from `y` has to end, at most the `planned` one.

        Before a contact it ends where its stages do not touch yet, whatever its body turns. In one
        that begins now, whose force no derivative tells, it is a fraction of the time T in which
        Hertz's force stops the speed u of approach: with the force κ d^(3/2) at a depth d, for a
        unit of mass, κ (u T)^(3/2) T = u. In one that ends, it is a share of what is left of it.
        """
        if not any(self.hard + self.oscillates):
            return planned
        y = jax.lax.stop_gradient(y)
        gaps, rates = self._gaps_and_rates(t, y)
        way = (planned - t) * jnp.abs(rates)
        near = self._noise + _NOW * way
        comes = (gaps > near) & jnp.array(self.oscillates)
        begins = (jnp.abs(gaps) <= near) & jnp.array(self.hard)
        # Farther from the end than four steps, half of the way takes longer than the planned step,
        # unless the push triples the speed on it.
        leaves = (gaps < -near) & (rates > 0) & (-gaps < 4 * way) & jnp.array(self.hard)
        end: Array = jax.lax.cond(
            keep & jnp.any(comes | begins | leaves),
            lambda: self._to_contact(t, y, planned),
            lambda: planned,
        )
        return end

    def _to_contact(self, t: Array, y: Any, planned: Array) -> Array:
        q, v, *chart = y
        h, noise, system = planned - t, self._noise, local_system(self.system, self.post_step, y)
        holds, hard, tried = jnp.array(self.holds), jnp.array(self.hard), 2 * _NOW * h

        def accelerate(at: tuple[Array, Array, Array]) -> Array:
            time, place, sides = at
            return solve(hold(system, sides), time, place, v, self.stabilization).acceleration

        # The accelerations now, a little later, when a point that touches is inside, and now
        # without contacts: in a loop, by one program.
        none = jnp.zeros_like(self._gaps(t, y))
        points = (
            jnp.stack([t, t + tried, t]),
            jnp.stack([q, q + tried * v, q]),
            jnp.stack([none, none, none + holds]),
        )
        a, there, free = jax.lax.map(accelerate, points)

        def gaps(s: Array) -> Array:
            return self._gaps(t + s, (q + s * v + 0.5 * s**2 * a, v, *chart))

        def rates(s: Array) -> tuple[Array, Array]:
            gap, rate = jax.jvp(gaps, (s,), (jnp.ones_like(s),))
            return rate, gap

        def push(change: Array) -> Array:
            return jnp.asarray(jax.jvp(lambda q: self._gaps(t, (q, v, *chart)), (q,), (change,))[1])

        def bends(s: Array) -> tuple[Array, tuple[Array, Array]]:
            rate, bend, gap = jax.jvp(rates, (s,), (jnp.ones_like(s),), has_aux=True)
            return bend, (rate, gap)

        zero, one = jnp.zeros_like(t), jnp.ones_like(t)
        bend, jerk, (rate, gap) = jax.jvp(bends, (zero,), (one,), has_aux=True)
        away = jnp.where(holds, 1.0, _AWAY)
        lands = _reaches(gap, rate, away * jnp.abs(bend), away * jnp.abs(jerk))
        lands *= jnp.where(holds, _THROUGH, 1.0)
        soon = (gap > noise) & (lands > _NOW * h) & jnp.array(self.oscillates)
        begins = (jnp.abs(gap) <= noise - _NOW * h * rate) & (-rate * h > noise)

        # What the acceleration inside has more than now is the push of the contact.
        pushes = push(there - a)
        begins &= (pushes > 0) & hard
        speed, depth = jnp.where(begins, -rate, 1), jnp.where(begins, -rate * tried - gap, 1)
        # Hertz's law in accelerations, δ'' = −k δ^(3/2): its time is (k √v)^(−2/5).
        stiffness = jnp.where(begins, pushes, 1) / depth**1.5
        turns = (stiffness * jnp.sqrt(speed)) ** -0.4
        first = jnp.where(begins, _FIRST * self.rtol**0.2 * turns, jnp.inf)

        # The speed at the end of a contact and the time to it, if it pushed on as it does now: with
        # the depth δ, the speed u now and a push b, s² = u² + 2 b δ, and 2 δ / (s + u) is the time.
        pushes = jnp.maximum(push(a - free), 0)
        leaves = (gap < -noise) & (rate > 0) & (-gap < 4 * h * rate) & hard
        speed = jnp.sqrt(rate**2 + 2 * jnp.abs(gap) * pushes)
        leaves &= speed - rate > _FAINT * self.rtol * speed
        left = 2 * jnp.abs(gap) / jnp.where(leaves, speed + rate, 1)
        nexts = [jnp.where(soon, lands, jnp.inf), first, jnp.where(leaves, _LEFT * left, jnp.inf)]
        return jnp.minimum(planned, t + jnp.min(jnp.stack(nexts)))

    @property
    def _noise(self) -> Float[Array, ""]:
        """Return the rounding errors of gaps [m]."""
        q = self.system.full.structure.without_states(self.system.full.q0)
        return _ROUNDING * jnp.finfo(q.dtype).eps * jnp.maximum(1.0, jnp.max(jnp.abs(q)))

    def _gaps_and_rates(self, t: Array, y: Any) -> tuple[Array, Array]:
        """Return the gaps of all contacts and their time derivatives, (contacts,) each."""
        q, v, *chart = y
        one = jnp.ones_like(t)
        found: tuple[Array, Array]
        found = jax.jvp(lambda t, q: self._gaps(t, (q, v, *chart)), (t, q), (one, v))
        return found

    def _gaps(self, t: Array, y: Any) -> Float[Array, " contacts"]:
        state = local_system(self.system, self.post_step, y).state(t, *y[:2])
        gaps = self.system.full.state(t, state.q, state.v).gaps()
        assert gaps is not None
        return gaps


def _reaches(gap: Array, rate: Array, bend: Array, jerk: Array) -> Array:
    """The time at which the gap g + g' s − c s²/2 − d s³/6 is zero, infinite where it never is.

    The third derivative is that of a point on a body that turns: without it, a step would be as
    long as one likes where the point moves straight on now. Newton's method comes from above, as
    the cubic is concave, from the root without d, in the form that is exact for each sign of the
    rate, or from where half of d s³/6 is more than g and than g' s.
    """
    root = jnp.sqrt(rate**2 + 2 * gap * bend)
    above = jnp.where(rate > 0, rate + root, 2 * gap)
    below = jnp.where(rate > 0, bend, root - rate)
    straight = jnp.where(below > 0, above / jnp.where(below > 0, below, 1), jnp.inf)
    third = jnp.where(jerk > 0, jerk, 1)
    turned = jnp.maximum(jnp.cbrt(12 * gap / third), jnp.sqrt(12 * jnp.maximum(rate, 0) / third))
    start = jnp.minimum(straight, jnp.where(jerk > 0, turned, jnp.inf))

    def nearer(_: Any, s: Array) -> Array:
        value = gap + s * (rate - s * (bend / 2 + s * jerk / 6))
        slope = rate - s * (bend + s * jerk / 2)
        return s - value / jnp.where(slope < 0, slope, -jnp.inf)

    finite = jnp.where(jnp.isfinite(start), start, 0)
    return jnp.where(
        jnp.isfinite(start), jax.lax.fori_loop(0, _ITERATIONS, nearer, finite), jnp.inf
    )
