"""Configurations of a mechanism with one freedom, looked up in a table."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..arrays import Time
from ..linalg.dense import multiply
from ..reduction.lift.base import AbstractLift, Motion, Physical, Reduced
from ..system.base import AbstractSystem
from .curve import Curve
from .expansion import along_motion, monomials, tabulate
from .frames import Frames
from .interpolation import BEFORE, evaluate
from .moved import moved_nodes

# Gauss–Newton steps towards the nearest configuration of the table, from its nearest node.
_STEPS = 4


class TableLift(AbstractLift):
    """q = Σ_j T_j(s) μ_j(δ) of a coordinate s along a curve and amplitudes δ, z = (s, δ).

    T_0 is the curve on which undeformed bodies move, with μ_0 = 1. Small amplitudes are added to
    second order: C(q(s, δ)) = 0, differentiated once and twice, gives with the way of the frames
    back to the constraints, X, across the curve,

        T_a = Φ_a − X C_q Φ_a            μ_a = δ_a
        T_ab = −X (C_q T_a)_q T_b        μ_ab = δ_a δ_b, half of it if a = b

    The global modal parametrization of Brüls, Duysinx and Golinval (IJNME 69, 2007,
    doi:10.1002/nme.1795) tabulates the reduced mass and stiffness; with the configurations alone,
    masses, forces and stiffnesses may change without a new table, and effects are exact.
    """

    frames: Frames
    nodes: Float[Array, "P n"]
    tangents: Float[Array, "P n"]
    modes: Float[Array, "n k"]  # Φ, of the amplitudes of all bodies
    dual: Float[Array, "k n"]  # δ of a displacement
    coefficients: Float[Array, "N p columns"]
    step: Float[Array, ""]  # of s between two nodes
    turn: Float[Array, " n"] | None  # of one round; None if the curve is open

    @classmethod
    def of(
        cls,
        system: AbstractSystem,
        frames: Frames,
        curve: Curve,
        modes: Float[Array, "n k"],
    ) -> "TableLift":
        """With a table of the curve, and `modes` that are orthonormal in the mass metric."""
        nodes, tangents = map(jnp.asarray, curve.nodes)
        dtype = modes.dtype
        turn = None if curve.turn is None else jnp.asarray(curve.turn, dtype)
        coefficients = tabulate(system, frames, nodes, tangents, modes)
        # In the metric of the amplitudes alone, whatever the frames do.
        dual = modes.T @ frames.metric.at[:, np.array(frames.numbers)].set(0.0)
        step = jnp.asarray(curve.step, dtype)
        return cls(frames, nodes, tangents, modes, dual, coefficients, step, turn)

    def position(self, full: AbstractSystem, t: Time, z: Reduced) -> Physical:
        del full, t
        (table, _, _), turns = self._table(z[0])
        return multiply(monomials(z[1:]), table) + turns

    def motion(self, full: AbstractSystem, t: Time, z: Reduced, w: Reduced) -> Motion:
        del full, t
        (table, slope, bend), turns = self._table(z[0])
        one, rate, curvature = along_motion(z[1:], w[1:])
        by_amplitude = jax.jacfwd(monomials)(z[1:])  # (c, k)
        along = multiply(one, slope)
        tangent = jnp.concatenate([along[:, None], multiply(table.T, by_amplitude)], axis=1)
        bias = multiply(one, bend) * w[0] ** 2
        if self.modes.shape[1]:
            bias += 2 * w[0] * multiply(rate, slope) + multiply(curvature, table)
        return Motion(multiply(one, table) + turns, multiply(tangent, w), tangent, bias)

    def restrict(self, full: AbstractSystem, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        amplitudes, weight = self._amplitudes(q), self.frames.metric
        flat = q - multiply(jnp.asarray(self.modes), amplitudes)
        inner = self.nodes[BEFORE : BEFORE + len(self.coefficients)]
        rounds = jnp.zeros(len(inner), q.dtype)
        if self.turn is not None:
            size = jnp.sum(self.turn**2)
            rounds = jnp.round((flat[None] - inner) @ self.turn / jnp.where(size > 0, size, 1))
            inner = inner + rounds[:, None] * self.turn[None]
        left = flat[None] - inner
        nearest = jnp.argmin(jnp.sum(left @ weight * left, axis=1))
        s = (nearest + rounds[nearest] * len(inner)) * self.step

        def improve(_: Any, s: Array) -> Array:
            motion = self.motion(full, 0.0, jnp.concatenate([s[None], amplitudes]), zero)
            along = weight @ motion.tangent[:, 0]
            nearer: Array = s + multiply(along, q - motion.q) / multiply(
                along, motion.tangent[:, 0]
            )
            return nearer

        zero = jnp.zeros(1 + len(amplitudes), q.dtype)
        s = jax.lax.fori_loop(0, _STEPS, improve, s)
        z = jnp.concatenate([s[None], amplitudes])
        tangent = self.motion(full, 0.0, z, zero).tangent
        faster = self._amplitudes(v)
        along = weight @ tangent[:, 0]
        speed = multiply(along, v - multiply(tangent[:, 1:], faster)) / multiply(
            along, tangent[:, 0]
        )
        return z, jnp.concatenate([speed[None], faster])

    def with_full(self, full: AbstractSystem) -> "TableLift":
        nodes = moved_nodes(full, self.frames, self.nodes, self.tangents)
        coefficients = tabulate(full, self.frames, nodes, self.tangents, self.modes)
        return dataclasses.replace(self, nodes=nodes, coefficients=coefficients)

    def _amplitudes(self, x: Physical) -> Float[Array, " k"]:
        # Without amplitudes, programs hold the empty matrix as NumPy's.
        return multiply(jnp.asarray(self.dual), x)

    def _table(self, s: Float[Array, ""]) -> tuple[tuple[Array, Array, Array], Float[Array, " n"]]:
        """T, T′ and T″ (c, n) at s, and what rounds add to q. NaN beyond the ends of a curve."""
        count, _, columns = self.coefficients.shape
        n = self.nodes.shape[1]
        share = s / self.step
        interval = jnp.floor(share)
        rounds = jnp.floor(interval / count) if self.turn is not None else jnp.zeros_like(s)
        number = interval - rounds * count
        if self.turn is None:
            share = jnp.where((number >= 0) & (number < count), share, jnp.nan)
        own = self.coefficients[jnp.clip(number, 0, count - 1).astype(int)]
        value, slope, bend = evaluate(own, share - interval)
        shape = columns // n, n
        table = (
            value.reshape(shape),
            slope.reshape(shape) / self.step,
            bend.reshape(shape) / self.step**2,
        )
        return table, jnp.zeros(n, s.dtype) if self.turn is None else rounds * self.turn
