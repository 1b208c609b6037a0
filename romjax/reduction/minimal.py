"""The reduced system in minimal coordinates: no constraints are left."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..arrays import Time
from ..linalg.dense import multiply
from ..linalg.kkt import Saddle
from ..linalg.pattern import Topology
from ..system.base import AbstractSystem, Linearization
from ..system.stabilization import Baumgarte
from .base import AbstractReducedSystem
from .chart import Chart
from .validity import Training

# Newton's method for the dependent coordinates: most matrices, and most steps with each; what is
# left when it has converged, relative to the coordinates; and what may be left at worst.
_MATRICES, _STEPS = 6, 8
_SQUARINGS = 8
_CONVERGED = {jnp.dtype("float64"): 1e-15, jnp.dtype("float32"): 1e-7}
_ACCEPTED = {jnp.dtype("float64"): 1e-9, jnp.dtype("float32"): 1e-4}


class _Motion(NamedTuple):
    """A state as the full system sees it."""

    q: Float[Array, " n"]
    v: Float[Array, " n"]
    tangent: Float[Array, "n r"]  # G = ∂q/∂z
    bend: Float[Array, " n"]  # q̈ where z̈ = 0


class MinimalSystem(AbstractReducedSystem):
    """Gᵀ M G z̈ = Gᵀ (Q − M β) on q = q̄ + Y Φ z + W d(z), with q̈ = G z̈ + β.

    The constraints determine d, so they hold exactly: no multipliers and no stabilisation, and the
    mass matrix is symmetric and positive definite. For open chains d has a closed form; else
    Newton's method finds it from the nearest snapshot, and the implicit function theorem its
    derivatives.
    """

    full: AbstractSystem
    offset: Float[Array, " n"]  # q̄
    inner: Float[Array, "d r"]  # Φ
    modes: Float[Array, "n r"]  # Y Φ
    dual: Float[Array, "r n"]  # z of a displacement
    near: Float[Array, "K r"]  # snapshots of z
    guesses: Float[Array, "K m"]  # and of d
    inverses: Float[Array, "K m m"]  # (∂C/∂d)⁻¹ at these, or the constant one of an affine chart
    time: Float[Array, ""]  # of the start
    q0: Float[Array, " r"]
    v0: Float[Array, " r"]
    chart: Chart
    training: Training | None
    reason: str = eqx.field(static=True)

    @property
    def m(self) -> int:
        return 0

    def constraint(self, t: Time, q: Float[Array, " r"]) -> Float[Array, " 0"]:
        return jnp.zeros(0, q.dtype)

    def lift(self, t: Time, q: Float[Array, " r"]) -> Float[Array, " n"]:
        """Physical coordinates; NaN where Newton's method finds none."""
        return self._lift(t, q)[0]

    def _lift(
        self, t: Time, q: Float[Array, " r"]
    ) -> tuple[Float[Array, " n"], Float[Array, "m m"]]:
        """Physical coordinates, and (∂C/∂d)⁻¹ there, which is not to be differentiated."""
        chart, t = self.chart, jnp.asarray(t, q.dtype)
        if chart.affine:
            d = self.guesses[0] - multiply(self.inverses[0], self._violated(t, q))
            return self.offset + self._ordered(multiply(self.inner, q), d), self.inverses[0]
        place = self.offset + multiply(self.modes, q)
        bound = jnp.asarray(chart.bound, q.dtype)

        def violation(d):  # type: ignore[no-untyped-def]
            return self._kept(self.full.constraint(t, place + multiply(bound, d)))

        def slope(d):  # type: ignore[no-untyped-def]
            rows = self._kept(self.full.jacobian(t, place + multiply(bound, d)))
            return multiply(rows, bound)

        def newton(_, start):  # type: ignore[no-untyped-def]
            enough = _CONVERGED[q.dtype] * jnp.maximum(1, jnp.max(jnp.abs(place)))

            def unfinished(most):  # type: ignore[no-untyped-def]
                return lambda x: (jnp.max(jnp.abs(x[1])) > enough) & (x[-1] < most)

            def improve(carry):  # type: ignore[no-untyped-def]
                # A matrix costs as much as many steps.
                d, step, inverse, count = carry
                inverse = _improved(inverse, slope(d))

                def chord(carry):  # type: ignore[no-untyped-def]
                    d, _, count = carry
                    step = multiply(inverse, violation(d))
                    return d - step, step, count + 1

                d, step, _ = jax.lax.while_loop(unfinished(_STEPS), chord, (d, step, 0))
                return d, step, inverse, count + 1

            first = (start, jnp.full_like(start, jnp.inf), inverse, 0)
            d, step, found, _ = jax.lax.while_loop(unfinished(_MATRICES), improve, first)
            # The last step is the error before it.
            return jnp.where(jnp.max(jnp.abs(step)) <= _ACCEPTED[q.dtype], d, jnp.nan), found

        def tangent(linear, right):  # type: ignore[no-untyped-def]
            return jnp.linalg.solve(jax.jacobian(linear)(right), right)

        nearest = jnp.argmin(jnp.sum((self.near - q[None]) ** 2, axis=1))
        start, inverse = jax.lax.stop_gradient((self.guesses[nearest], self.inverses[nearest]))
        d, inverse = jax.lax.custom_root(violation, start, newton, tangent, has_aux=True)
        return place + multiply(bound, d), jax.lax.stop_gradient(inverse)

    def _ordered(self, free: Float[Array, "d *r"], bound: Float[Array, "m *r"]) -> Array:
        """Free and dependent coordinates of an affine chart in their places."""
        return jnp.concatenate([free, bound])[np.array(self.chart.order)]

    def _violated(self, t: Time, q: Float[Array, " r"]) -> Float[Array, " m"]:
        """The constraints of an affine chart where d is that of the guess."""
        if not self.chart.rows:
            return jnp.zeros(0, q.dtype)
        place = self.offset + self._ordered(multiply(self.inner, q), self.guesses[0])
        return self._kept(self.full.constraint(t, place))

    def _motion(self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]) -> _Motion:
        chart, t = self.chart, jnp.asarray(t, q.dtype)
        one = jnp.ones_like(t)
        if chart.affine:
            # In closed form, derivatives along the motion are cheaper than constraint equations.
            def rate(t, q):  # type: ignore[no-untyped-def]
                return jax.jvp(self.lift, (t, q), (one, v))

            (place, speed), (_, bend) = jax.jvp(rate, (t, q), (one, v))
            slopes = jax.jacfwd(self._violated, argnums=1)(t, q)
            tangent = self._ordered(self.inner, -multiply(self.inverses[0], slopes))
            return _Motion(place, speed, tangent, bend)
        place, inverse = self._lift(t, q)
        bound = jnp.asarray(chart.bound, q.dtype)
        rows = self._kept(self.full.jacobian(t, place))
        _, driven = jax.jvp(lambda t: self.full.constraint(t, place), (t,), (one,))
        right = jnp.concatenate([multiply(rows, self.modes), self._kept(driven)[:, None]], axis=1)
        matrix = multiply(rows, bound)
        inverse = _improved(inverse, jax.lax.stop_gradient(matrix))

        def solve(right):  # type: ignore[no-untyped-def]
            return jax.lax.custom_linear_solve(
                lambda x: multiply(matrix, x),
                right,
                lambda _, right: multiply(inverse, right),
                lambda _, right: multiply(inverse.T, right),
            )

        follow = -multiply(bound, solve(right))
        tangent = self.modes + follow[:, :-1]
        speed = multiply(tangent, v) + follow[:, -1]
        curvature = self._kept(self.full.constraint_state(t, place, speed).curvature)
        return _Motion(place, speed, tangent, -multiply(bound, solve(curvature)))

    def _kept(self, rows: Float[Array, "M *n"]) -> Float[Array, "m *n"]:
        """Without the constraints that repeat others."""
        kept = self.chart.rows
        return rows if len(kept) == len(rows) else rows[np.array(kept)]

    def tangent(self, t: Time, q: Float[Array, " r"]) -> Float[Array, "n r"]:
        """G = ∂q/∂z of the physical coordinates."""
        return self._motion(t, q, jnp.zeros_like(q)).tangent

    def mass(self, q: Float[Array, " r"]) -> Float[Array, "r r"]:
        """GᵀMG, where constraints depend on time at that of the start."""
        return self._mass(self._motion(self.time, q, jnp.zeros_like(q)))

    def _mass(self, motion: _Motion) -> Float[Array, "r r"]:
        return multiply(motion.tangent.T, self.full.momentum(motion.q, motion.tangent))

    def force(self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]) -> Float[Array, " r"]:
        """Gᵀ (Q − M β)."""
        return -self._inertia(t, q, v, None)

    def _inertia(
        self,
        t: Time,
        q: Float[Array, " r"],
        v: Float[Array, " r"],
        a: Float[Array, " r"] | None,
    ) -> Float[Array, " r"]:
        """Gᵀ (M q̈ − Q) for an acceleration z̈, zero unless given."""
        motion = self._motion(t, q, v)
        bend = motion.bend if a is None else multiply(motion.tangent, a) + motion.bend
        force = self.full.force(t, motion.q, motion.v)
        return multiply(motion.tangent.T, self.full.momentum(motion.q, bend) - force)

    def physical(
        self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        motion = self._motion(t, q, v)
        return motion.q, motion.v

    def physical_acceleration(
        self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"], a: Float[Array, " r"]
    ) -> Float[Array, " n"]:
        motion = self._motion(t, q, v)
        return multiply(motion.tangent, a) + motion.bend

    def reduced(
        self, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
        return multiply(self.dual, q - self.offset), multiply(self.dual, v)

    def acceleration(
        self,
        t: Time,
        q: Float[Array, " r"],
        v: Float[Array, " r"],
        stabilization: Baumgarte | None = None,
    ) -> tuple[Float[Array, " r"], Float[Array, " 0"]]:
        motion = self._motion(t, q, v)
        pushed = self.full.momentum(
            motion.q, jnp.concatenate([motion.tangent, motion.bend[:, None]], axis=1)
        )
        force = self.full.force(t, motion.q, motion.v) - pushed[:, -1]
        mass = multiply(motion.tangent.T, pushed[:, :-1])
        return self._saddle(mass).solve(multiply(motion.tangent.T, force), jnp.zeros(0, q.dtype))

    def linearize(
        self,
        t: Time,
        q: Float[Array, " r"],
        v: Float[Array, " r"],
        stabilization: Baumgarte | None = None,
    ) -> Linearization:
        t = jnp.asarray(t, q.dtype)
        a, _ = self.acceleration(t, q, v)
        by = jax.jacfwd(lambda t, q, v: self._inertia(t, q, v, a), argnums=(1, 2, 0))(t, q, v)
        right = -jnp.concatenate([by[0], by[1], by[2][:, None]], axis=1)
        mass = self._mass(self._motion(t, q, v))
        slopes, _ = self._saddle(mass).solve(right, jnp.zeros((0, right.shape[1]), q.dtype))
        r = self.n
        return Linearization(a, slopes[:, :r], slopes[:, r : 2 * r], slopes[:, 2 * r])

    def _saddle(self, mass: Float[Array, "r r"]) -> Saddle:
        none = jnp.zeros((0, 0, self.n), mass.dtype)
        return Saddle(Topology.dense(self.n, 0), mass[None], none)


def _improved(inverse: Float[Array, "m m"], matrix: Float[Array, "m m"]) -> Float[Array, "m m"]:
    """The inverse of a matrix from that of one near it.

    By Schulz's iteration X + X (I − A X), which squares the error. Products only: a library's
    factorisation takes longer than all the rest.
    """
    unit = jnp.eye(len(matrix), dtype=matrix.dtype)
    # The next iteration squares this to rounding.
    enough = jnp.finfo(matrix.dtype).eps ** 0.5

    def unfinished(carry):  # type: ignore[no-untyped-def]
        _, error, count = carry
        return (error > enough) & (count < _SQUARINGS)

    def square(carry):  # type: ignore[no-untyped-def]
        inverse, _, count = carry
        rest = unit - multiply(matrix, inverse)
        return inverse + multiply(inverse, rest), jnp.max(jnp.abs(rest)), count + 1

    start = (inverse, jnp.full_like(inverse[0, 0], jnp.inf), 0)
    return jax.lax.while_loop(unfinished, square, start)[0]
