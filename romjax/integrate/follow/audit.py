"""The audit of a run: the balance of its energy, and whether it stayed on its branch."""

from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...assembly.assembled import controllers_of
from ...common import compat
from ...linalg.dense import multiply
from ...march.follower import AbstractFollower, Step
from ...march.steps import Progress
from ...march.tolerances import Tolerances
from ...system.base import AbstractSystem
from ...system.dynamics import constraint_state, solve
from ...system.flags import Flag
from ...system.frequencies import spins_of
from ...system.local import local_system
from ...system.mobility import moves
from ...system.stabilization import Baumgarte
from ...system.state import AbstractState, Power
from ..post_step import PostStep
from .bounces import Touching
from .branching import Branching
from .energy_balance import EnergyBalance, Momentary
from .phase import Motion, Phase, Response, shares_of

# Nodes of Gauss' quadrature in each step: exact for what changes like a polynomial of degree 7.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


class Findings(NamedTuple):
    """The findings of an audit up to a time."""

    balance: EnergyBalance
    branching: Branching | None  # None where constraints cannot lose rank, or are projected
    beyond: Bool[Array, ""] | None  # whether an effect passed its limit; None where none has one
    lengths: Float[Array, " rows"] | None  # the largest of each row of constraints, so far
    phase: Phase | None  # None where no body turns, or angles follow drives

    @property
    def flags(self) -> Int[Array, ""]:
        """The reasons not to trust the run, as the number of a `Flag`."""
        branching = 0 if self.branching is None else self.branching.flags
        beyond = 0 if self.beyond is None else self.beyond * int(Flag.LIMIT)
        return self.balance.flags + branching + beyond


class Audit(AbstractFollower):
    """The audit of a run of a system.

    E = T + V changes by the work of the forces that have no potential energy, and of joints that
    move with time. Energies are taken between the steps, the work from the motion within each.
    The stabilisation of the constraints is no part of the mechanism: its work is an error.
    """

    system: AbstractSystem
    post_step: PostStep | None
    stabilization: Baumgarte | None
    tolerances: Tolerances
    controlled: bool = eqx.field(static=True)  # not in fixed steps
    energy: Float[Array, ""] | None = None  # at the start [J], if it is known

    calls_users: ClassVar[bool] = True

    def start(self, start: Progress) -> Findings:
        """Return the findings before the first step."""
        zero = jnp.zeros_like(start.t)
        energy = self.energy
        if energy is None:
            energy = self._at(start.t, start.y)[1].energy().total
        balance = EnergyBalance(energy, *[zero] * 10)
        branching = lengths = None
        if self.watches_branches:
            branching = Branching.start(start.t, self.system.m)
            # The first step has them: at the start they would be a part of the program once more.
            rows = jax.eval_shape(lambda: self._at(start.t, start.y)[1].kkt().lengths())
            lengths = jnp.zeros(rows.shape, rows.dtype)
        beyond = None if self._limits(start) is None else jnp.zeros((), bool)
        phase = None
        if self.watches_phases:
            state = self._at(start.t, start.y)[1]
            touching = self._touching(start, state)
            phase = Phase.start(self._motion(state), touching, state.energy().kinetic)
        return Findings(balance, branching, beyond, lengths, phase)

    @property
    def watches_branches(self) -> bool:
        """Whether constraints may lose rank, and violations push the motion off its branch: those
        that Baumgarte's terms act against.
        """
        return self.system.structure.loops and self.stabilization is not None

    @property
    def watches_phases(self) -> bool:
        """Whether angles drift where energy does: not those that follow drives, nor those to which
        a controller holds them, of whose answer the state at one time says nothing; nor where
        bodies have energies of their own, whose errors one balance does not tell apart.
        """
        full = self.system.full
        driven = full.m > 0 and moves(full)
        known = bool(full.structure.frames) and full.structure.connected
        return known and not driven and not controllers_of(full)

    def follow(self, step: Step, seen: Findings) -> Findings:
        """Return the findings with a step added, if it was accepted."""
        before, after, tried = step.before, step.after, step.tried
        branching, lengths = seen.branching, seen.lengths
        (system, state), q = self._at(after.t, after.y), after.y[0]
        if branching is not None and lengths is not None:
            places, violation = system.structure.without_states(q), system.constraint(after.t, q)
            kkt = state.kkt()
            lengths = jnp.maximum(lengths, kkt.lengths())
            branching = branching.follow(after.t, kkt, lengths, violation, places)
        now, work = (
            self._energies(before, after, state),
            self._work(before.t, after.t, tried.between),
        )
        if tried.arrival is not None:
            # Impacts at the end of the step do work too.
            work = work._replace(supply=work.supply + tried.arrival.work)
        beyond = seen.beyond
        if beyond is not None:
            # Limits pass zero once within a step, since its errors see what happens there.
            beyond |= jnp.any(self._limits(before) * self._limits(after) < 0)
        balance = seen.balance.follow(after.t, now, work)
        phase = seen.phase
        if phase is not None:
            h = after.t - before.t
            motion = self._motion(state)
            response = self._response(after.t, state, h, -work.dissipation)
            gained = balance.imbalance - seen.balance.imbalance
            gained *= self._shares(state, motion, after.y, tried.error)
            # No derivative is taken of findings.
            parts = h, motion, self._touching(after, state), now.kinetic, gained, response
            parts = jax.lax.stop_gradient(parts)
            phase = phase.follow(*parts)
        new = Findings(balance, branching, beyond, lengths, phase)
        chosen: Findings = jax.tree.map(lambda a, b: jnp.where(step.kept, a, b), new, seen)
        return chosen

    def _at(self, t: Array, y: Any) -> tuple[AbstractSystem, AbstractState]:
        system = local_system(self.system, self.post_step, y)
        return system, system.state(t, *y[:2])

    def _motion(self, state: AbstractState) -> Motion:
        full = self.system.full
        angles, velocities = state.q[full.structure.turns], state.v[full.structure.positions]
        return Motion(angles, spins_of(full, state.q, state.v), velocities)

    def _touching(self, at: Progress, state: AbstractState) -> Touching | None:
        full = self.system.full
        gaps = full.state(at.t, state.q, state.v).gaps()
        if gaps is None:
            return None
        v = self.system.structure.without_states(at.y[1])
        gain = -multiply(state.energy().slope, v)
        return Touching(gaps, state.q[full.structure.positions], gain)

    def _limits(self, at: Progress) -> Any:
        state = self._at(at.t, at.y)[1]
        return self.system.full.state(at.t, state.q, state.v).limits()

    def _energies(self, before: Progress, after: Progress, state: AbstractState) -> Momentary:
        """The energies at the end of a step, in the `state` there.

        The step size control holds the root mean square of the errors of all 2n numbers of the
        state, each divided by its tolerance, below one. By Cauchy and Schwarz that of the energy is
        then below the square root of 2n times the sum of the squares of its derivatives times the
        tolerances.
        """
        t, y = after.t, after.y
        v = self.system.structure.without_states(y[1])
        energy, zero, squared = state.energy(), jnp.zeros_like(t), jnp.sum(v**2)
        # Half of a mean inertia, by which velocities as small as their tolerances have an energy.
        share = energy.kinetic / jnp.where(squared > 0, squared, 1)
        if not self.controlled:
            least = share * len(v) * self.tolerances.atol**2
            return Momentary(energy.total, energy.kinetic, least, zero, zero)
        q_errors, v_errors = self.tolerances.errors(
            after.controller_state[1], y[0][None], y[1][None], t - before.t
        )
        squares = (energy.slope * q_errors) ** 2 + (energy.momentum * v_errors) ** 2
        tolerated = jnp.sqrt(2 * len(v) * jnp.sum(squares))
        least = share * jnp.sum(self.system.structure.without_states(v_errors) ** 2)
        return Momentary(energy.total, energy.kinetic, least, tolerated, self.tolerances.rtol)

    def _work(self, t0: Array, t1: Array, between: diffrax.AbstractLocalInterpolation) -> Power:
        """Return the work of all forces without potential energy in a step [J]."""

        def node(x: Array) -> Power:
            t = t0 + x * (t1 - t0)
            y = between.evaluate(t)
            system, state = self._at(t, y)
            power = state.power() or nothing
            if not driven:
                return power
            return power._replace(supply=power.supply + self._drive(system, state, t, y))

        zero = jnp.zeros_like(t0)
        nothing = Power(zero, zero)
        driven = self.system.full.m > 0 and moves(self.system.full)
        if not driven and self._at(t0, between.evaluate(t0))[1].power() is None:
            return nothing

        def add(work: Power, at: tuple[Array, Array]) -> tuple[Power, None]:
            place, weight = at
            return jax.tree.map(lambda x, y: x + weight * y, work, node(place)), None

        places = jnp.asarray((1 + _NODES) / 2, t0.dtype)
        weights = jnp.asarray(_WEIGHTS / 2, t0.dtype) * (t1 - t0)
        # A loop, not a batch, which takes twice as long for so few.
        total: Power = jax.lax.scan(add, nothing, (places, weights))[0]
        return total

    def _response(self, t: Array, state: AbstractState, h: Array, taken: Array) -> Response:
        """How forces act against a motion that is early; `taken`: by dampers in the step h [J]."""
        full = self.system.full

        def supply(t: Array, faster: Array) -> Array:
            v = state.v + faster * full.structure.without_states(state.v)
            power = full.state(t, state.q, v).power()
            return zero if power is None else power.supply

        zero = jnp.zeros_like(t)
        faster, early = taken, zero
        if compat.depends_on_first(lambda faster, t: supply(t, faster), zero, t):
            # The power changes by P too, which a motion has that is only early.
            given, more = jax.jvp(lambda faster: supply(t, faster), (zero,), (zero + 1,))
            faster += h * jnp.maximum(given - more, 0)
            early = h * jnp.maximum(jax.jvp(lambda t: supply(t, zero), (t,), (zero + 1,))[1], 0)
        return Response(faster, early)

    def _shares(
        self, state: AbstractState, motion: Motion, y: Any, error: Any
    ) -> Float[Array, "2 bodies"]:
        """The shares of the turns and of the rounds of each body in a step's error of energy; all,
        where nobody estimates it.
        """
        if not self.controlled:
            return jnp.ones((2, len(motion.spins)), motion.spins.dtype)
        full, at_rest = self.system.full, state.physical_acceleration(jnp.zeros_like(y[1]))
        # Of the positions and of the velocities.
        of_q, of_v = (state.physical_acceleration(x) - at_rest for x in (error[0], error[1]))
        common = state.energy(), self.system.structure.without_states(y[1]), (error[0], error[1])
        turns = spins_of(full, state.q, of_q), spins_of(full, state.q, of_v)
        rounds = of_q[full.structure.positions], of_v[full.structure.positions]
        shares = (
            shares_of(*common, motion.spins, turns),
            shares_of(*common, motion.velocities, rounds),
        )
        return jnp.stack(shares)

    def _drive(self, system: AbstractSystem, state: AbstractState, t: Array, y: Any) -> Array:
        """The power of joints that move with time.

        The constraint forces are M q̈ − Q, and their power vᵀ(M q̈ − Q) contains that of joints
        which drift, −λᵀĊ, which no joint has that holds.
        """
        q, v, *_ = y
        a, multipliers, _ = solve(system, t, q, v, self.stabilization)
        full = system.full.state(t, state.q, state.v)
        power: Array = multiply(state.v, full.residual(state.physical_acceleration(a)))
        if system.m:
            power += multiply(multipliers, constraint_state(system, t, q, v).rate)
        return power
