"""Configurations of a mechanism with one or two freedoms, looked up in a table."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time, as_jax, put, untraced
from ...linalg.dense import invert, multiply
from ...system.base import AbstractSystem
from ..lift.base import AbstractLift, Motion, Physical, Reduced
from .expansion import along_motion, monomials, tabulate
from .frames import Frames
from .grid import Grid
from .interpolation import evaluate
from .project_nodes import project_nodes

# Gauss–Newton steps towards the nearest configuration of the table, from its nearest node.
_STEPS = 4


class TableLift(AbstractLift):
    """q = Σ_j T_j(s) μ_j(δ) of one or two coordinates s and amplitudes δ, z = (s, δ).

    T_0 is the curve or surface on which undeformed bodies move, with μ_0 = 1. Small amplitudes are
    added to second order: C(q(s, δ)) = 0, differentiated once and twice, gives with the way of the
    frames back to the constraints, X, across the curve,

        T_a = Φ_a − X C_q Φ_a            μ_a = δ_a
        T_ab = −X (C_q T_a)_q T_b        μ_ab = δ_a δ_b, half of it if a = b

    The global modal parametrization of Brüls, Duysinx and Golinval (IJNME 69, 2007,
    doi:10.1002/nme.1795) tabulates the reduced mass and stiffness; with the configurations alone,
    masses, forces and stiffnesses may change without a new table, and effects are exact.
    """

    frames: Frames
    grid: Grid
    modes: Float[Array, "n k"]  # Φ, of the amplitudes of all bodies
    dual: Float[Array, "k n"]  # δ of a displacement
    coefficients: Float[Array, "..."]  # (*N, *p, columns), on the intervals of the grid

    @classmethod
    def of(
        cls,
        system: AbstractSystem,
        frames: Frames,
        grid: Grid,
        modes: Float[Array, "n k"],
    ) -> "TableLift":
        """Make the lift with a table of the grid; `modes` are orthonormal in the mass metric."""
        coefficients = tabulate(system, frames, grid, modes)
        # In the metric of the amplitudes alone, whatever the frames do.
        metric = put(frames.metric, np.s_[:, np.array(frames.numbers)], 0.0)
        dual = as_jax(untraced(modes)[0].T @ metric)
        return cls(frames, grid, modes, dual, coefficients)

    def position(self, full: AbstractSystem, t: Time, z: Reduced) -> Physical:
        del full, t
        d = self.frames.freedoms
        (table, _, _), turns = self._table(z[:d])
        return multiply(monomials(z[d:]), table) + turns

    def motion(self, full: AbstractSystem, t: Time, z: Reduced, w: Reduced) -> Motion:
        del full, t
        d = self.frames.freedoms
        (table, slopes, bends), turns = self._table(z[:d])
        one, rate, curvature = along_motion(z[d:], w[d:])
        by_amplitude = jax.jacfwd(monomials)(z[d:])  # (c, k)
        along = jnp.stack([multiply(one, slope) for slope in slopes], axis=1)
        tangent = jnp.concatenate([along, multiply(table.T, by_amplitude)], axis=1)
        bend = jnp.einsum("i,j,ijcn->cn", w[:d], w[:d], bends)
        # By the product rule on μ(δ(t)) · T(s(t)) with unaccelerated z.
        bias = multiply(one, bend)
        if self.modes.shape[1]:
            slope = jnp.einsum("i,icn->cn", w[:d], slopes)
            bias += 2 * multiply(rate, slope) + multiply(curvature, table)
        return Motion(multiply(one, table) + turns, multiply(tangent, w), tangent, bias)

    def restrict(self, full: AbstractSystem, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        d, amplitudes = self.frames.freedoms, self._amplitudes(q)
        # Frames are compared where bodies are undeformed, since nodes are configurations of these.
        start = self._of_nearest(q - multiply(jnp.asarray(self.modes), amplitudes))
        zero = jnp.zeros(d + len(amplitudes), q.dtype)

        def at(s: Array) -> Motion:
            return self.motion(full, 0.0, jnp.concatenate([s, amplitudes]), zero)

        def fitted(tangent: Array, displacement: Array) -> Array:
            """The displacement in the coordinates s, least in the mass metric."""
            along = tangent[:, :d]
            pushed = multiply(self.frames.metric, along)
            return multiply(invert(multiply(along.T, pushed)), multiply(pushed.T, displacement))

        def improve(_: Any, s: Array) -> Array:
            motion = at(s)
            nearer: Array = s + fitted(motion.tangent, q - motion.q)
            return nearer

        s = jax.lax.fori_loop(0, _STEPS, improve, start)
        tangent, faster = at(s).tangent, self._amplitudes(v)
        speeds = fitted(tangent, v - multiply(tangent[:, d:], faster))
        return jnp.concatenate([s, amplitudes]), jnp.concatenate([speeds, faster])

    def with_full(self, full: AbstractSystem) -> "TableLift":
        grid = self.grid._replace(nodes=project_nodes(full, self.frames, self.grid))
        coefficients = tabulate(full, self.frames, grid, self.modes)
        return dataclasses.replace(self, grid=grid, coefficients=coefficients)

    def _amplitudes(self, x: Physical) -> Float[Array, " k"]:
        # Without amplitudes, programs hold the empty matrix as NumPy's.
        return multiply(jnp.asarray(self.dual), x)

    def _of_nearest(self, q: Physical) -> Float[Array, " d"]:
        """The coordinates s of the node that is nearest to a configuration."""
        inner, turn = self.grid.inner(), self.grid.turn
        *counts, n = inner.shape
        inner = inner.reshape(-1, n)
        rounds = jnp.zeros(len(inner), q.dtype)
        if turn is not None:
            size = jnp.sum(turn**2)
            # The number of rounds is that which brings q nearest to the node along the turn.
            rounds = jnp.round((q[None] - inner) @ turn / jnp.where(size > 0, size, 1))
            inner = inner + rounds[:, None] * turn[None]
        left = q[None] - inner
        nearest = jnp.argmin(jnp.sum(left @ self.frames.metric * left, axis=1))
        numbers = jnp.stack(jnp.unravel_index(nearest, tuple(counts)))
        return (numbers + rounds[nearest] * np.array(counts)) * self.grid.steps

    def _table(self, s: Float[Array, " d"]) -> tuple[tuple[Array, Array, Array], Physical]:
        """T (c, n), its derivatives by s (d, c, n) and (d, d, c, n), and what rounds add to q.

        NaN beyond the ends of an open curve or surface.
        """
        steps, turn, n = self.grid.steps, self.grid.turn, self.grid.nodes.shape[-1]
        d = len(s)
        counts = np.array(self.coefficients.shape[:d])
        shares = s / steps
        intervals = jnp.floor(shares)
        rounds = jnp.zeros_like(s) if turn is None else jnp.floor(intervals / counts)
        # After whole rounds of a closed curve the same intervals come again.
        numbers = intervals - rounds * counts
        if turn is None:
            shares = jnp.where((numbers >= 0) & (numbers < counts), shares, jnp.nan)
        own = tuple(jnp.clip(numbers, 0, counts - 1).astype(int))
        value, slopes, bends = evaluate(self.coefficients[own], shares - intervals)
        table = (
            value.reshape(-1, n),
            slopes.reshape(d, -1, n) / steps[:, None, None],
            bends.reshape(d, d, -1, n) / jnp.outer(steps, steps)[:, :, None, None],
        )
        return table, jnp.zeros(n, s.dtype) if turn is None else rounds[0] * turn
