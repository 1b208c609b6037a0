"""Baumgarte's parameters by gradient."""

import dataclasses
from collections.abc import Callable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, ArrayLike, Float
from tqdm import tqdm

from ...common.arrays import Vector
from ...compiling.program import program, program_often
from ...integrate.adjoint import forward_mode
from ...integrate.doubt import warn_of_outcome
from ...integrate.settings import check_times
from ...integrate.simulate import simulate
from ...integrate.status import Status
from ...system.base import AbstractSystem
from ...system.dynamics import constraint_state
from ...system.frequencies import frequencies
from ...system.reduced import reduced_of
from ...system.stabilization import Baumgarte

# A step of the search that leaves what can be simulated is taken back, and later ones are shorter.
_SHORTER = 0.5
# The search ends when the best loss has not fallen by more than the first in so many steps.
_LEAST_FALL, _PATIENCE = 1e-4, 25


@dataclasses.dataclass(frozen=True)
class Tuning:
    """The result of `tune_baumgarte`.

    - `best`: the parameters of the smallest loss met; `start`: those it began with.
    - `loss`, `drift` (steps,): the loss, and the largest |C| of each run.
    - `alpha`, `beta` (steps,) or (steps, m): the path.
    - `frequency`: fastest rigid frequency ω of the mechanism [rad/s]; the default in
      fixed steps is `Baumgarte.critical(frequency)`.
    """

    best: Baumgarte
    start: Baumgarte
    loss: np.ndarray
    drift: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray
    frequency: float
    loss_of: Callable[[Baumgarte], Array]

    def landscape(
        self, count: int = 25, decades: float = 0.5
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The loss (count, count) over a logarithmic grid of α and β, of scalar parameters.

        The grid holds the path with so many `decades` around. NaN where nothing can be simulated.
        """
        if self.alpha.ndim > 1:
            raise ValueError("landscape: there are more than two parameters; tune scalars.")
        sides = []
        for path in (self.alpha, self.beta):
            low, high = np.log10(path.min()) - decades, np.log10(path.max()) + decades
            sides.append(np.logspace(low, high, count))
        with forward_mode():
            row: Any = program(jax.vmap(lambda a, b: self.loss_of(Baumgarte(a, b)), (0, None)))
            losses = [row(jnp.asarray(sides[0]), b) for b in jnp.asarray(sides[1])]
        grid = np.stack([np.asarray(x) for x in losses])
        return sides[0], sides[1], np.where(np.isfinite(grid), grid, np.nan)


def tune_baumgarte(
    system: AbstractSystem,
    ts: Vector,
    *,
    start: Baumgarte | None = None,
    cost: float = 0.0,
    steps: int = 300,
    rate: float = 0.1,
    solver: diffrax.AbstractSolver[Any] | None = None,
    rtol: ArrayLike = 1e-6,
    dt: ArrayLike | None = None,
    progress: bool = False,
) -> Tuning:
    """Baumgarte's α and β that keep the constraints best, by Adam on their logarithms.

    The loss log⟨C²⟩ + log⟨Ċ²⟩ over the output times needs no reference. For a pendulum in small
    fixed steps it leads to α ≈ 1.6 ω, β ≈ ω², independent of the step.

    **Arguments:**

    - `system`: full or reduced; `ts`: output times [s], of a run long enough to drift.
    - `start`: parameters to begin with, one pair or one per constraint; critical damping at the
      fastest rigid frequency unless given.
    - `cost`: weight of log(1 + |s|/ω), where |s| is the faster root of s² + α s + β, since a
      stabilisation that is faster than the mechanism shortens the steps.
    - `steps`, `rate`: of the search; `solver`, `rtol`, `dt`: as `simulate`, explicit and with a
      fixed step, or with step size control.
    - `progress`: show a progress bar.

    Warns if the run with the best parameters is doubtful.
    Raises ValueError for a system without constraints, or a start that cannot be simulated.
    """
    if system.m == 0:
        raise ValueError("tune_baumgarte: the system has no constraints, so nothing drifts.")
    ts = check_times("tune_baumgarte", ts, system.q0.dtype)
    frequency = float(frequencies(system, ts[0], system.q0, system.v0).rigid)
    # A mechanism without forces is slow: the length of the run is then its time.
    omega = max(frequency, 2 * np.pi / float(ts[-1] - ts[0]))
    first = Baumgarte.critical(jnp.asarray(omega)) if start is None else start
    if steps < 1:
        raise ValueError(f"tune_baumgarte: steps={steps}, but the search takes at least one.")
    if not all(bool(jnp.all(x > 0)) for x in (first.alpha, first.beta)):
        raise ValueError(f"tune_baumgarte: start={first} must be positive; logarithms are tuned.")

    def measure(stabilization: Baumgarte) -> tuple[Array, tuple[Array, Array]]:
        run = simulate(
            system,
            ts,
            stabilization=stabilization,
            solver=solver,
            rtol=rtol,
            dt=dt,
            throw=False,
        )
        q, v = run.q, run.v
        # Drift is that of the constraints that the stabilization acts on: of a reduced system its
        # own.
        rom = reduced_of(system)
        if rom is not None:
            q, v = jax.vmap(rom.restrict)(q, v)
        states = jax.vmap(lambda t, q, v: constraint_state(system, t, q, v))(ts, q, v)
        loss = _log_mean(states.violation) + _log_mean(states.rate)
        if cost:
            loss += cost * jnp.mean(jnp.log1p(_root(stabilization) / omega))
        # A run that failed, or whose start is not one, says nothing of its stabilisation.
        loss = jnp.where(run.status == Status.SUCCESS, loss, jnp.nan)
        return loss, (jnp.max(jnp.abs(states.violation)), run.flags)

    path, best, flags = _search(measure, first, steps, rate, progress)
    losses, drifts, alphas, betas = (np.stack(x) for x in zip(*path, strict=True))
    warn_of_outcome("tune_baumgarte, at the best parameters", Status.SUCCESS, flags)
    return Tuning(best, first, losses, drifts, alphas, betas, omega, lambda pair: measure(pair)[0])


def _search(
    measure: Callable[[Baumgarte], Any],
    start: Baumgarte,
    steps: int,
    rate: float,
    progress: bool,
) -> tuple[list[tuple[Any, ...]], Baumgarte, int]:
    """The path (loss, drift, α, β) of Adam's search, and the best parameters with the flags of
    their run.

    Raises ValueError if there is no loss at the start.
    """
    # A search by optimistix finds the same parameters, in 6.4 s of a processor for 5.6 with what it
    # compiles (two bars, 20 steps), but it tells its end alone. The path, and steps that are taken
    # back where a run fails, would be callbacks to the host, with which no program is stored.
    optimizer = optax.inject_hyperparams(optax.adam)(learning_rate=rate)

    @program_often
    def advance(logs: Baumgarte, state: Any) -> Any:
        # Forwards: two parameters, or two for each constraint, and runs of many steps.
        def both(logs: Baumgarte) -> tuple[Array, Any]:
            loss, others = measure(jax.tree.map(jnp.exp, logs))
            return loss, (loss, *others)

        gradient, (loss, drift, flags) = jax.jacfwd(both, has_aux=True)(logs)
        updates, state = optimizer.update(gradient, state)
        finite = jnp.isfinite(loss)
        for slope in jax.tree.leaves(gradient):
            finite &= jnp.all(jnp.isfinite(slope))
        return optax.apply_updates(logs, updates), state, loss, drift, flags, finite

    logs = jax.tree.map(jnp.log, start)
    state, best, last_fall = optimizer.init(logs), (np.inf, logs, 0), 0
    path: list[tuple[Any, ...]] = []
    with (
        forward_mode(),
        tqdm(total=steps, disable=None if progress else True, desc="tune", unit="step") as bar,
    ):
        for step in range(steps):
            next_logs, next_state, loss, drift, flags, finite = advance(logs, state)
            if not finite:
                if not path:
                    raise ValueError(
                        f"tune_baumgarte: a run with start={start} fails, or does not drift at "
                        "all; simulate it to see why, and start elsewhere."
                    )
                shorter = _SHORTER * state.hyperparams["learning_rate"]
                logs, state = best[1], optimizer.init(best[1])
                state.hyperparams["learning_rate"] = shorter
                continue
            path.append((float(loss), float(drift), *(np.exp(x) for x in (logs.alpha, logs.beta))))
            bar.set_postfix_str(f"loss {float(loss):.3f}, |C| {float(drift):.1e}")
            bar.update()
            if float(loss) < best[0] - _LEAST_FALL:
                last_fall = step
            if float(loss) < best[0]:
                best = float(loss), logs, int(flags)
            if step - last_fall >= _PATIENCE:
                break
            logs, state = next_logs, next_state
    return path, jax.tree.map(jnp.exp, best[1]), best[2]


def _log_mean(x: Float[Array, "k m"]) -> Array:
    """log⟨x²⟩."""
    return jnp.log(jnp.mean(x**2))


def _root(stabilization: Baumgarte) -> Any:
    """|s| of the faster root of s² + α s + β."""
    alpha, beta = stabilization.alpha, stabilization.beta
    # Overdamped, both roots are real and α/2 + √ the larger; else they are conjugate, of the size
    # √β.
    discriminant = alpha**2 / 4 - beta
    # The square root is taken of one where it is not used: its derivative there would be NaN.
    positive = jnp.where(discriminant > 0, discriminant, 1)
    return jnp.where(discriminant > 0, alpha / 2 + jnp.sqrt(positive), jnp.sqrt(beta))
