"""Location of events in the steps of a run, and the change of the state at them."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..march.cuts import AbstractWatch, Arrival, Cut, Watching
from ..march.record import Record
from ..march.scales import Scales
from ..march.tolerances import Tolerances
from ..system.base import AbstractSystem
from ..system.dynamics import solve
from ..system.local import local_system
from ..system.stabilization import Baumgarte
from .base import AbstractEvent
from .impact import collide
from .record import Events
from .search import first_crossing

# A step that ends closer to an event than this times rtol, or than the second number, in lengths of
# the step, is carried there by a Taylor series, of which derivatives err by as much.
_REACH, _NEAREST = 0.1, 1e-9
# Where a step ends at a tick of a controller, no event carries it back so far that the tick, which
# has been, counts as the next: by less than the share of a period by which a step may miss it.
_OF_TICKS = 5e-8
# In this last share of a step, Newton's method from the end is more accurate than dense output.
_NEWTON = 0.05
# Impacts of one gap at times closer than this share of the run would never end: a ball of which
# the bounce is lost in rounding errors of a metre flies for 1e-7 s.
_AT_ONCE = 1e-7
# Steps are not halved below this share of the run, where a quantity has a kink.
_KINK = 1e-9
# Shortest step to an event, in units in the last place.
_SHORTEST = 16


class Watch(AbstractWatch):
    """The events of a run, and how its steps end at them.

    A step that contains an event is repeated so that it ends there: dense output tells where, then
    Newton's method with the state at the end, until what is left is within reach of a Taylor
    series. The state at an event so has the accuracy of the method, and the derivatives of that
    series, t* = t − g/ġ, are those of the time of the event.
    """

    system: AbstractSystem
    post_step: Any
    stabilization: Baumgarte | None
    events: tuple[AbstractEvent, ...]
    tolerances: Tolerances
    end: Float[Array, ""]  # of the run
    span: Float[Array, ""]  # from its start
    most: int = eqx.field(static=True)
    ticks: bool = eqx.field(static=True)  # whether controllers with a clock act

    def start(self, t: Float[Array, ""], y: Any) -> Watching:
        """Return the state of the watch before the first step."""
        system, (q, v, *_) = local_system(self.system, self.post_step, y), y
        values, transpose = jax.vjp(lambda t, q, v: self._values(system, t, q, v), t, q, v)
        by_t, by_q, by_v = jax.vmap(transpose)(jnp.eye(len(values), dtype=q.dtype))
        a = solve(system, t, q, v, self.stabilization).acceleration
        rates = by_t + by_q @ v + by_v @ a
        reach = self.tolerances.start(y)
        scales = Scales.of(self.tolerances, reach, y, (by_q, by_v), self.span)
        # A quantity that starts at its level counts as on the side to which it moves.
        leaves = jnp.where(jnp.abs(rates) > scales.least, jnp.sign(rates), 0.0)
        side = jnp.where(jnp.abs(values) > scales.floor, jnp.sign(values), leaves)
        no = jnp.zeros((), bool)
        side = jnp.where(self._resets & (side < 0), 0.0, side)
        never = jnp.full_like(t, -jnp.inf)
        last = jnp.full_like(side, -jnp.inf)
        return Watching(side, scales, last, never, no, no, no, jnp.zeros((), int))

    def arrive(
        self, watching: Watching, t0: Float[Array, ""], t1: Float[Array, ""], y: Any
    ) -> Arrival:
        """The end of a step from t0 to t1 in the state `y`, carried to the events in reach."""
        system, (q, v, *chart) = local_system(self.system, self.post_step, y), y
        values, rates, a = self._flow_and_acceleration(system, t1, q, v)
        moves, reach = rates != 0, self._reach(t0, t1)
        wait = jnp.where(moves, -values / jnp.where(moves, rates, 1), jnp.inf)
        is_near = jnp.abs(values) <= reach * jnp.abs(rates) + watching.scales.noise
        in_reach = is_near & (t1 + wait <= self.end)
        hits = self._passes(watching.side, rates) & in_reach
        # The time to the level is meaningless where the value is a rounding error, but not how it
        # changes with what the motion depends on.
        moving = jnp.abs(rates) > watching.scales.least
        none = jnp.where(moving, wait - jax.lax.stop_gradient(wait), 0.0)
        wait = jnp.where(is_near & (jnp.abs(wait) > reach), none, wait)
        first = jnp.min(jnp.where(hits, wait, jnp.inf))
        # Events that follow by less than the error of their time count as simultaneous.
        hits = hits & (wait <= first + 1e-3 * reach)
        shift = jnp.where(jnp.any(hits), first, 0.0)
        # A Taylor series: velocities err by the square of the shift, positions by its cube.
        t, q, v = t1 + shift, q + shift * v + 0.5 * shift**2 * a, v + shift * a
        closed = self._resets & (hits | (values + shift * rates <= watching.scales.floor))
        return self._collided(
            watching,
            system,
            Arrival(
                t=t,
                before=(q, v, *chart),
                after=(q, v, *chart),
                hits=hits,
                impulse=jnp.zeros_like(values),
                work=jnp.zeros_like(t),
                rates=rates,
                closed=closed,
                closing=jnp.zeros((), bool),
                end=t1,
                values=values,
                wait=wait,
            ),
        )

    def cut(
        self,
        watching: Watching,
        t0: Float[Array, ""],
        between: diffrax.AbstractLocalInterpolation,
        arrival: Arrival,
    ) -> Cut:
        """The first event within a step, but for those at which it ends."""
        t1, span, reach = arrival.end, arrival.end - t0, self._reach(t0, arrival.end)

        def at(share: Array) -> Array:
            t = t0 + share * span
            y = between.evaluate(t)
            return self._values(local_system(self.system, self.post_step, y), t, *y[:2])

        crossings = first_crossing(
            at, watching.side, arrival.values, watching.scales.noise, self._falling, self._rising
        )
        time, crosses = t0 + crossings.share * span, crossings.sign != 0
        backwards = jnp.min(jnp.where(crosses & (arrival.wait < 0), arrival.wait, jnp.inf))
        is_near = crossings.is_last & (jnp.abs(backwards) <= _NEWTON * span)
        # Each cut makes the step shorter by `reach` at least, so that cutting comes to an end.
        time = jnp.minimum(jnp.where(is_near, t1 + backwards, time), t1 - reach)
        is_due = crossings.exists & ~(arrival.happens & (time >= t1 - 2 * reach))
        shortest = _SHORTEST * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(t0), jnp.abs(t1))
        follows = is_due & (time - t0 <= shortest)
        is_due &= ~follows
        # Half of a step in which quantities oscillate may tell; kinks of quantities end it at last.
        halves = ~crossings.is_resolved & (span > jnp.maximum(4 * shortest, _KINK * self.span))
        time = jnp.where(halves, t0 + span / 2, time)
        is_due |= halves
        # A contact lasts if a closed gap is pushed through, closes again at once, or still closes.
        opened = jnp.any(arrival.hits & self._resets) & arrival.closed
        through = (watching.side == 0) & (arrival.values < -watching.scales.floor) & ~opened
        again = arrival.hits & (arrival.t - watching.last <= _AT_ONCE * self.span)
        lasting = self._resets & (through | again | (follows & crosses))
        lasting = jnp.any(lasting) | arrival.closing
        return Cut(is_due, time, lasting & ~is_due)

    def follow(
        self,
        watching: Watching,
        keep: Bool[Array, ""],
        cut: Cut,
        y0: Any,
        end: Array,
        arrival: Arrival,
    ) -> Watching:
        """Return the state of the watch after a step from `y0` that should have ended at `end`."""
        values, hits = arrival.values, arrival.hits
        is_apart = jnp.abs(values) > watching.scales.floor
        side = jnp.where(is_apart, jnp.sign(values), watching.side)
        side = jnp.where(hits, -watching.side, side)
        # After a collision, the gaps that were closed open again, or stay at rest.
        collide = jnp.any(hits & self._resets)
        opens = jnp.where(arrival.rates > watching.scales.least, 1.0, 0.0)
        side = jnp.where(collide & arrival.closed, opens, side)
        happens = keep & arrival.happens
        later = jnp.maximum(watching.planned, end)
        planned = jnp.where(keep, -jnp.inf, watching.planned)
        return Watching(
            side=jnp.where(keep, side, watching.side),
            scales=watching.scales.after(self.tolerances, y0, arrival.after, self.span, keep),
            last=jnp.where(keep & hits, arrival.t, watching.last),
            planned=jnp.where(cut.is_due, later, planned),
            jumped=jnp.where(keep, happens, watching.jumped),
            stopped=watching.stopped | (keep & jnp.any(hits & self._stops)),
            lasting=watching.lasting | cut.lasting,
            number=watching.number + jnp.where(happens, 1, 0),
        )

    def describe(self, record: Record, watching: Watching) -> Events:
        """Return the record of events in physical coordinates."""

        def at(t: Array, before: Any, after: Any) -> tuple[Array, Array, Array]:
            system, (q, v, *_) = local_system(self.system, self.post_step, before), before
            state = system.state(t, q, v)
            # States of effects are in their places, as in outputs.
            now = system.full.structure.with_states(state.q, state.v)
            return now, state.v, system.state(t, q, after[1]).v

        q, v_before, v_after = jax.vmap(at)(record.time, record.before, record.after)
        # Rows without an event hold the start, as the record has it, and get a time that never
        # comes.
        used = jnp.arange(len(record.time)) < record.number
        return Events(
            count=record.number,
            time=jnp.where(used, record.time, jnp.inf),
            happened=record.hits,
            impulse=record.impulse,
            q=q,
            v_before=v_before,
            v_after=v_after,
            lasting=watching.lasting,
        )

    def is_stopped(self, watching: Watching) -> Bool[Array, ""]:
        """Whether an event ends the run: a `Stop`, or one that cannot be followed."""
        return watching.stopped | watching.lasting | (watching.number > self.most)

    @property
    def _falling(self) -> Bool[Array, " events"]:
        return jnp.array([event.direction != "rising" for event in self.events])

    @property
    def _rising(self) -> Bool[Array, " events"]:
        return jnp.array([event.direction != "falling" for event in self.events])

    @property
    def _resets(self) -> Bool[Array, " events"]:
        return jnp.array([event.resets for event in self.events])

    @property
    def _stops(self) -> Bool[Array, " events"]:
        return jnp.array([event.stops for event in self.events])

    def _reach(self, t0: Array, t1: Array) -> Array:
        share = _REACH * self.tolerances.rtol
        share = jnp.minimum(share, _OF_TICKS) if self.ticks else share
        return jnp.maximum(share, _NEAREST) * (t1 - t0)

    def _passes(self, side: Array, rates: Array) -> Bool[Array, " events"]:
        """Say of each quantity whether it crosses its level in the direction that is asked for."""
        falls = (side > 0) & (rates < 0) & self._falling
        rises = (side < 0) & (rates > 0) & self._rising
        return falls | rises

    def _values(self, system: AbstractSystem, t: Array, q: Array, v: Array) -> Array:
        return jnp.stack([event.value(system, t, q, v) for event in self.events])

    def _flow_and_acceleration(
        self, system: AbstractSystem, t: Array, q: Array, v: Array
    ) -> tuple[Array, Array, Array]:
        """The quantities, their rates along the motion, and the acceleration."""
        t = jnp.asarray(t, q.dtype)
        a = solve(system, t, q, v, self.stabilization).acceleration
        values, rates = jax.jvp(
            lambda t, q, v: self._values(system, t, q, v), (t, q, v), (jnp.ones_like(t), v, a)
        )
        return values, rates, a

    def _collided(self, watching: Watching, system: AbstractSystem, arrival: Arrival) -> Arrival:
        """Return the arrival with the velocities after the impacts among the events."""
        rows = [i for i, event in enumerate(self.events) if event.resets]
        if not rows:
            return arrival
        index = jnp.array(rows)
        impacts = [self.events[i] for i in rows]
        (q, v, *chart), t = arrival.before, arrival.t

        def gaps(t: Array, q: Array) -> Array:
            return jnp.stack([event.value(system, t, q, jnp.zeros_like(q)) for event in impacts])

        def collided() -> Arrival:
            restitution = jnp.stack([event.restitution for event in impacts])  # type: ignore
            collision = collide(
                system,
                t,
                q,
                v,
                gaps,
                restitution,
                arrival.closed[index],
                watching.scales.least[index],
            )
            return arrival._replace(
                after=(q, collision.v, *chart),
                impulse=arrival.impulse.at[index].set(collision.impulses),
                work=collision.work,
                rates=arrival.rates.at[index].set(collision.rates),
                closing=collision.closing,
            )

        after: Arrival = jax.lax.cond(jnp.any(arrival.hits[index]), collided, lambda: arrival)
        return after
