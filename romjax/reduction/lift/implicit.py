"""Minimal coordinates from which Newton's method finds the others."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common import precision
from ...common.arrays import Time
from ...linalg.dense import improve_inverse, multiply, solve_by_inverse, solve_by_similar
from ...system.base import AbstractSystem
from ...system.constraints import differentiate
from ..charts.chart import Chart
from ..charts.guesses import WAY, Guesses, guesses_of
from .base import AbstractLift, Motion, Physical, Reduced

# Most matrices of Newton's method, and most steps with each, while each of these is shorter by this
# factor than the one before.
_MATRICES, _STEPS, _SLOWEST = 7, 16, 0.5
# So many right sides for each unknown are solved by an inverse, fewer by that of a similar matrix.
_FEW = 8


class ImplicitLift(AbstractLift):
    """q = q̄ + Y Φ z + W d, with d(t, z) from C(t, q) = 0.

    With the columns Y, W of a chart the constraints determine d wherever ∂C/∂d = C_q W is regular
    (generalized coordinate partitioning; Wehage and Haug 1982, doi:10.1115/1.3256318). They are
    solved by simplified Newton steps d ← d − (C_q W)⁻¹ C from the nearest snapshot. Differentiating
    C(t, q(t)) = 0 along a motion, once and twice, gives all else from the same matrix:

        C_q (Y Φ + W ∂d/∂z) = 0             G = Y Φ − W (C_q W)⁻¹ C_q Y Φ
        C_q v + C_t = 0                     v = G w − W (C_q W)⁻¹ C_t
        C_q q̈ + (C_q v)_q v + … = 0         β = −W (C_q W)⁻¹ [(C_q v)_q v + 2 C_qt v + C_tt]
    """

    offset: Float[Array, " n"]  # q̄
    modes: Float[Array, "n r"]  # Y Φ
    dual: Float[Array, "r n"]  # z of a displacement
    snapshots: Float[Array, "K r"]  # z of the way to the snapshots, and of these,
    guesses: Float[Array, "K m"]  # d,
    times: Float[Array, " K"]  # t,
    inverses: Float[Array, "K m m"]  # and (C_q W)⁻¹ at these
    pace: Float[Array, ""]  # of d along the drives, in the metric of z; zero without any
    chart: Chart

    def position(self, full: AbstractSystem, t: Time, z: Reduced) -> Physical:
        """NaN where Newton's method does not converge."""
        return self._solve(full, t, z)[0]

    def motion(self, full: AbstractSystem, t: Time, z: Reduced, w: Reduced) -> Motion:
        t = jnp.asarray(t, z.dtype)
        chart = self.chart
        q, inverse = self._solve(full, t, z)
        dependent = jnp.asarray(chart.dependent, z.dtype)
        rows = chart.jacobian(full, t, q)
        # The columns C_q Y Φ and C_t, which one matrix solves for: the tangent and the drives.
        right = [multiply(rows, self.modes), chart.drives(full, t, q)[:, None]]
        matrix = multiply(rows, dependent)
        solve = solve_by_similar
        if len(matrix) < _FEW * (self.modes.shape[1] + 2):
            solve = solve_by_inverse
            inverse = improve_inverse(inverse, jax.lax.stop_gradient(matrix))

        solved = solve(matrix, inverse, jnp.concatenate(right, axis=1))
        follow = -multiply(dependent, solved)
        tangent = self.modes + follow[:, :-1]
        v = multiply(tangent, w) + follow[:, -1]
        constraint = functools.partial(chart.constraint, full)
        # C̈ of the motion with unaccelerated q: what the bias has to take back.
        curvature = differentiate(constraint, t, q, v).curvature
        bias = -multiply(dependent, solve(matrix, inverse, curvature))
        return Motion(q, v, tangent, bias)

    def restrict(self, full: AbstractSystem, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        del full
        return multiply(self.dual, q - self.offset), multiply(self.dual, v)

    def with_full(self, full: AbstractSystem, from_start: bool = True) -> "ImplicitLift":
        """The same lift for a system with other numbers, whose bodies may be far from where the
        snapshots are: they are followed there `from_start`, the other system's own.
        """
        known = self.snapshots[WAY:], self.guesses[WAY:], self.times[WAY:]
        guesses = Guesses(self.offset, self.modes, self.dual, *known, self.pace)
        z, d, inverses = guesses_of(self.chart, guesses, full, from_start)
        return dataclasses.replace(self, snapshots=z, guesses=d, inverses=inverses)

    def _solve(
        self, full: AbstractSystem, t: Time, z: Reduced
    ) -> tuple[Physical, Float[Array, "m m"]]:
        """q, and (C_q W)⁻¹ near it, which is not to be differentiated."""
        chart, t = self.chart, jnp.asarray(t, z.dtype)
        origin = self.offset + multiply(self.modes, z)
        dependent = jnp.asarray(chart.dependent, z.dtype)
        limits = precision.of(z.dtype)

        def violation(d: Array) -> Array:
            return chart.constraint(full, t, origin + multiply(dependent, d))

        def newton(_: Any, start: Array) -> tuple[Array, Array]:
            largest = jnp.maximum(1, jnp.max(jnp.abs(origin)))

            def renew(carry: Any) -> Any:
                d, size, inverse, count = carry

                def improved() -> Array:
                    rows = chart.jacobian(full, t, origin + multiply(dependent, d))
                    return improve_inverse(inverse, multiply(rows, dependent))

                # A matrix costs as much as many steps: the first ones do with that of the snapshot.
                inverse = jax.lax.cond(count > 0, improved, lambda: inverse)

                def chord(carry: Any) -> Any:
                    d, size, _, count = carry
                    step = multiply(inverse, violation(d))
                    return d - step, jnp.max(jnp.abs(step)) / largest, size, count + 1

                def converging(carry: Any) -> Array:
                    _, size, before, count = carry
                    faster = (size < _SLOWEST * before) | (count < 2)
                    more: Array = (size > limits.newton_converged) & faster & (count < _STEPS)
                    return more

                start = (d, size, jnp.full_like(size, jnp.inf), 0)
                d, size, _, _ = jax.lax.while_loop(converging, chord, start)
                return d, size, inverse, count + 1

            def unfinished(carry: Any) -> Array:
                more: Array = (carry[1] > limits.newton_converged) & (carry[-1] < _MATRICES)
                return more

            first = (start, jnp.asarray(jnp.inf, start.dtype), inverse, 0)
            d, size, last, _ = jax.lax.while_loop(unfinished, renew, first)
            # The last step is the error before it.
            return jnp.where(size <= limits.newton_accepted, d, jnp.nan), last

        # What is prescribed turns on with time, whatever the independent coordinates do.
        far = jnp.sum((self.snapshots - z[None]) ** 2, axis=1)
        nearest = jnp.argmin(far + (self.pace * (self.times - t)) ** 2)
        start, inverse = jax.lax.stop_gradient((self.guesses[nearest], self.inverses[nearest]))
        # Derivatives are those of the solution (implicit function theorem), not of the steps.
        d, inverse = jax.lax.custom_root(violation, start, newton, _solve_linear, has_aux=True)
        return origin + multiply(dependent, d), jax.lax.stop_gradient(inverse)


def _solve_linear(linear: Callable[[Array], Array], right: Array) -> Array:
    solution: Array = jnp.linalg.solve(jax.jacobian(linear)(right), right)
    return solution
