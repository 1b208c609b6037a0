"""The flow of errors along motions that are known, which tells the errors of others."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...compiling.program import program
from ...integrate.default import start_frequencies
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem
from ...system.dynamics import gamma, linearize
from ...system.reduced import AbstractReducedSystem
from ...system.stabilization import Baumgarte
from ...system.structure import without_names
from .residual import DECAY, residual_about

# The largest angle [rad] by which the fastest mode turns in a step of the method of Runge and
# Kutta: it errs by 0.5⁵/120 = 3e-4 of the mode in each.
_LARGEST_ANGLE = 0.5
# More steps from one output to the next than these are not worth their time.
_MOST_STEPS = 256

Columns = Float[Array, "*runs k n2 columns"]


class Flows(eqx.Module):
    """The linearised flow of a model along some of its motions.

    An error e = (x, y) of positions and velocities, driven by accelerations d that are linear
    between outputs, goes on by

        e_{k+1} = Φ_k e_k + Γ⁰_k d_k + Γ¹_k (d_{k+1} − d_k).

    What drives it are forces, d = −K (r₁, r₂), with the residuals of another run and the upper rows
    K of the inverse of the extended matrix at the known motion. As accelerations of the other run
    itself they would be large in stiff directions, and cancel only with its own mass matrix.

    - `space`: the model, whose own coordinates (r) errors are in.
    - `t` (k,) [s]; `q` (runs, k, n): the motions in physical coordinates, and `metric` (n, n).
    - `response` (runs, k, r, r + m): K. `transition` (runs, k − 1, 2 r, 2 r): Φ; `held` and `ramp`
      (runs, k − 1, 2 r, r): Γ⁰ and Γ¹.
    """

    space: AbstractReducedSystem
    t: Float[Array, " k"]
    q: Float[Array, "runs k n"]
    metric: Float[Array, "n n"]
    response: Columns
    transition: Columns
    held: Columns
    ramp: Columns

    @classmethod
    def along(
        cls, space: AbstractReducedSystem, systems: Sequence[AbstractSystem], ts: Any, rtol: Any
    ) -> "Flows":
        """The flow of a model for each of some mechanisms, from their own starts.

        Raises SimulationError where one of its motions fails.
        """
        flows, runs = [], []
        for system in systems:
            model = space.with_full(system).starting_at(system.q0, system.v0)
            run = simulate(model, ts, rtol=rtol, audit=False)
            bare = without_names(model)
            fastest = float(start_frequencies(bare, run.t, bare.q0, bare.v0).fastest)
            # Steps of equal length between outputs, as many as the fastest mode needs in the
            # longest interval.
            longest = float(np.max(np.diff(np.asarray(run.t))))
            steps = int(np.clip(np.ceil(longest * fastest / _LARGEST_ANGLE), 1, _MOST_STEPS))
            flows.append(_flow(bare, run.t, run.q, run.v, np.asarray(steps)))
            runs.append(run)
        stacked = jax.tree.map(lambda *x: jnp.stack(x), *flows)
        positions = jnp.stack([run.q for run in runs])
        return cls(without_names(space), runs[0].t, positions, runs[0].metric, *stacked)

    def error(
        self,
        rom: AbstractReducedSystem,
        run: Trajectory,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
    ) -> tuple[Float[Array, "k n"], Float[Array, "k n"]]:
        """Return the difference of the motion from (q, v) to a run of a model, in physical
        coordinates, by the flow along the nearest of the motions.
        """
        apart = run.q[None] - self.q
        # In the energy norm, over all outputs.
        nearest = jnp.argmin(jnp.einsum("rki,ij,rkj->r", apart, self.metric, apart))
        motion = run.t, run.q, run.v
        result: tuple[Array, Array] = _error(self, without_names(rom), motion, (q, v), nearest)
        return result


@program
def _flow(
    model: AbstractReducedSystem,
    t: Float[Array, " k"],
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
    steps: Int[Array | np.ndarray, ""],
) -> tuple[Array, Array, Array, Array]:
    """The responses, transitions and gains along a motion in physical coordinates."""
    r, m, stabilization = model.n, model.m, Baumgarte.critical(DECAY)
    x, y = jax.vmap(model.restrict)(q, v)
    rows = jnp.eye(r + m, dtype=q.dtype)

    def response(t: Array, x: Array, y: Array) -> Array:
        upper: Array = model.state(t, x, y).kkt().solve(rows[:r], rows[r:])[0]
        return upper

    one, none = jnp.eye(r, dtype=q.dtype), jnp.zeros((r, r), q.dtype)
    start = jnp.eye(2 * r, 4 * r, dtype=q.dtype)
    pushed = jnp.concatenate([none, none, one, none], axis=1)
    ramped = jnp.concatenate([none, none, none, one], axis=1)

    def interval(span: tuple[Array, Array, Array, Array]) -> Array:
        t0, length, x, y = span
        h = length / steps

        def rate(t: Array, state: Any) -> Any:
            x, y, e = state
            local = linearize(model, t, x, y, stabilization)
            push = local.by_position @ e[:r] + local.by_velocity @ e[r:]
            push += pushed + ramped * ((t - t0) / length)
            return y, local.acceleration, jnp.concatenate([e[r:], push])

        def moved(state: Any, rates: Any, by: Array) -> Any:
            return jax.tree.map(lambda a, b: a + by * b, state, rates)

        def step(number: Array, state: Any) -> Any:
            t = t0 + number * h
            first = rate(t, state)
            second = rate(t + h / 2, moved(state, first, h / 2))
            third = rate(t + h / 2, moved(state, second, h / 2))
            last = rate(t + h, moved(state, third, h))
            for rates, share in ((first, 6), (second, 3), (third, 3), (last, 6)):
                state = moved(state, rates, h / share)
            return state

        e: Array = jax.lax.fori_loop(0, jnp.asarray(steps), step, (x, y, start))[2]
        return e

    columns = jax.lax.map(interval, (t[:-1], jnp.diff(t), x[:-1], y[:-1]))
    responses = jax.lax.map(lambda at: response(*at), (t, x, y))
    return responses, columns[..., : 2 * r], columns[..., 2 * r : 3 * r], columns[..., 3 * r :]


@eqx.filter_jit
def _error(
    flows: Flows,
    rom: AbstractReducedSystem,
    run: tuple[Array, Array, Array],
    start: tuple[Array, Array],
    nearest: Int[Array, ""],
) -> tuple[Array, Array]:
    space = flows.space.with_full(rom.full)
    (times, positions, velocities), r = run, space.n

    def rate(t: Array, q: Array, v: Array) -> Array:
        """The acceleration of the run in physical coordinates."""
        z, w = rom.restrict(q, v)
        state = rom.state(t, z, w)
        own = state.solve(gamma(rom, t, z, w, Baumgarte.critical(DECAY))).acceleration
        physical: Array = state.physical_acceleration(own)
        return physical

    def pushed(t: Array, q: Array, v: Array, response: Array) -> tuple[Array, Array, Array]:
        a = rate(t, q, v)
        (x, y), (_, b) = jax.jvp(space.restrict, (q, v), (v, a))
        unbalanced = residual_about(space, t, x, y, b)(x, y)
        return x, y, -response @ jnp.concatenate(unbalanced)

    x, y, d = jax.vmap(pushed)(times, positions, velocities, flows.response[nearest])
    right = space.restrict(*start)
    first = jnp.concatenate([right[0] - x[0], right[1] - y[0]])

    def step(e: Array, k: Array) -> tuple[Array, Array]:
        columns = flows.transition, flows.held, flows.ramp
        transition, held, ramp = (x[nearest, k] for x in columns)
        e = transition @ e + held @ d[k] + ramp @ (d[k + 1] - d[k])
        return e, e

    rows = jax.lax.scan(step, first, jnp.arange(len(times) - 1))[1]
    e = jnp.concatenate([first[None], rows])
    own = jax.vmap(space.reconstruct)(times, x, y)
    other = jax.vmap(space.reconstruct)(times, x + e[:, :r], y + e[:, r:])
    return other[0] - own[0], other[1] - own[1]
