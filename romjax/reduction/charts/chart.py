"""A chart: which coordinates of a mechanism are independent, and which follow from them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common import precision
from ...common.arrays import Time
from ...compiling.program import program_once
from ...linalg.branches import Forest
from ...linalg.dense import multiply
from ...system import unit_length
from ...system.base import AbstractSystem

# Up to so many dependent coordinates a matrix is as fast as sums along branches.
_DENSE = 100
# Steps of Newton's method towards the coordinates that another system holds.
_STEPS = 8


class Chart(eqx.Module):
    """q = q̄ + Y s + W d: independent coordinates s, and d that the constraints determine.

    - `independent` Y (n, d), `dependent` W (n, m); `read` (d, n) gives s of a displacement.
    - `rows`: numbers of the constraints that do not repeat others; in space, |p|² = 1 are among
      them.
    - `affine`: the constraints are affine in d with constant coefficients, so that q(s) has a
      closed form. Y and W are then columns of the unit matrix, and `order` says which:
      q − q̄ is (s, d)[order]. Else the columns are orthonormal in the mass metric.
    - `forest`: the pattern of ∂C/∂d, where it is constant and links many d like a forest.
    - `held`: whether that holds only while coordinates stay which joints to the ground hold.
    """

    independent: np.ndarray
    dependent: np.ndarray
    read: np.ndarray
    rows: tuple[int, ...] = eqx.field(static=True)
    affine: bool = eqx.field(static=True)
    order: tuple[int, ...] = eqx.field(static=True, default=())
    forest: Forest | None = eqx.field(static=True, default=None)
    held: bool = eqx.field(static=True, default=False)

    @classmethod
    def of_coordinates(
        cls,
        dependent: np.ndarray,
        rows: tuple[int, ...],
        slopes: np.ndarray,
        held: bool = False,
    ) -> "Chart":
        """An affine chart whose dependent coordinates have the numbers `dependent`, of a system
        with ∂C/∂q = `slopes` (m, n) of the constraints `rows`.
        """
        n = slopes.shape[1]
        unit, others = np.eye(n), np.setdiff1d(np.arange(n), dependent)
        order = tuple(int(i) for i in np.argsort(np.concatenate([others, dependent])))
        forest = Forest.of(slopes[:, dependent]) if len(dependent) > _DENSE else None
        columns = unit[:, others], unit[:, dependent], unit[others]
        return cls(*columns, rows, True, order, forest, held)

    def ordered(self, s: Float[Array, "d *r"], d: Float[Array, "m *r"]) -> Float[Array, "n *r"]:
        """The coordinates of an affine chart in the order of q."""
        return jnp.concatenate([s, d])[np.array(self.order)]

    def dependent_of(self, displacement: Float[Array, " n"]) -> Float[Array, " m"]:
        """The dependent coordinates of a displacement: of W d = q − q̄ − Y s, by least squares."""
        parts = self.independent, self.dependent, self.read
        independent, dependent, read = (jnp.asarray(x, displacement.dtype) for x in parts)
        left = displacement - multiply(independent, multiply(read, displacement))
        d: Array = jnp.linalg.solve(dependent.T @ dependent, multiply(dependent.T, left))
        return d

    def constraint(
        self, system: AbstractSystem, t: Time, q: Float[Array, " n"]
    ) -> Float[Array, " m"]:
        """The constraints that do not repeat others."""
        return self._regular(unit_length.extended(system, t, q))

    def jacobian(
        self, system: AbstractSystem, t: Time, q: Float[Array, " n"]
    ) -> Float[Array, "m n"]:
        """Return C_q of the constraints of the chart."""
        return self._regular(unit_length.jacobian(system, t, q))

    def drives(self, system: AbstractSystem, t: Time, q: Float[Array, " n"]) -> Float[Array, " m"]:
        """Return C_t of the constraints of the chart."""
        t = jnp.asarray(t, q.dtype)
        along: tuple[Array, Array]
        along = jax.jvp(lambda t: self.constraint(system, t, q), (t,), (jnp.ones_like(t),))
        return along[1]

    def _regular(self, rows: Float[Array, "M *n"]) -> Float[Array, "m *n"]:
        return rows if len(self.rows) == len(rows) else rows[np.array(self.rows, int)]

    def tangent(
        self, system: AbstractSystem, t: Time, q: Float[Array, " n"]
    ) -> Float[Array, "n d"]:
        """Return the derivative of q by the independent coordinates, T = Y − W (C_q W)⁻¹ C_q Y."""
        return _tangent(self, system, t, q)

    def metric(self, system: AbstractSystem, t: Time, q: Float[Array, " n"]) -> Float[Array, "d d"]:
        """The mass matrix of the independent coordinates, TᵀMT with the tangent T."""
        return _metric(self, system, t, q)

    def dependent_matrix(
        self, system: AbstractSystem, t: Time, q: Float[Array, " n"]
    ) -> Float[Array, "m m"]:
        """∂C/∂d = C_q W."""
        return _dependent_matrix(self, system, t, q)

    def step(
        self, system: AbstractSystem, t: Time, q: Float[Array, " n"]
    ) -> tuple[Float[Array, " m"], Float[Array, ""]]:
        """Return a step of Newton's method, which is to be taken from d, and how long it is,
        relative to the coordinates.
        """
        matrix = multiply(self.jacobian(system, t, q), jnp.asarray(self.dependent, q.dtype))
        step = jnp.linalg.solve(matrix, self.constraint(system, t, q))
        return step, jnp.max(jnp.abs(step)) / jnp.maximum(1, jnp.max(jnp.abs(q)))

    def held_by(
        self, system: AbstractSystem, t: Time, offset: Float[Array, " n"], d: Float[Array, " m"]
    ) -> tuple[Float[Array, " m"], Float[Array, "m m"]]:
        """Return d at s = 0 in an affine chart of another system, as it is unless that may hold
        coordinates elsewhere, where the start of that system has them, and the constant ∂C/∂d.
        """
        q = offset
        if self.held:
            d, q = _held_by(self, system, t, offset, d)
        return d, self.dependent_matrix(system, t, q)

    def dependent_inverses(
        self, system: AbstractSystem, t: Float[Array, " K"], q: Float[Array, "K n"]
    ) -> Float[Array, "K m m"]:
        """(∂C/∂d)⁻¹ = (C_q W)⁻¹ at several configurations."""
        return _dependent_inverses(self, system, t, q)


@program_once
def _tangent(
    chart: Chart, system: AbstractSystem, t: Time, q: Float[Array, " n"]
) -> Float[Array, "n d"]:
    tangent = jnp.asarray(chart.independent, q.dtype)
    if chart.rows:
        dependent = jnp.asarray(chart.dependent, q.dtype)
        rows = chart.jacobian(system, t, q)
        # C_q (Y + W X) = 0 solved for X: how the dependent coordinates follow.
        tangent -= dependent @ jnp.linalg.solve(rows @ dependent, rows @ tangent)
    return tangent


@program_once
def _metric(
    chart: Chart, system: AbstractSystem, t: Time, q: Float[Array, " n"]
) -> Float[Array, "d d"]:
    tangent = chart.tangent(system, t, q)
    return tangent.T @ system.state(t, q, jnp.zeros_like(q)).apply_mass(tangent)


@program_once
def _dependent_matrix(
    chart: Chart, system: AbstractSystem, t: Time, q: Float[Array, " n"]
) -> Float[Array, "m m"]:
    if not chart.rows:
        return jnp.zeros((0, 0), q.dtype)
    return chart.jacobian(system, t, q) @ jnp.asarray(chart.dependent, q.dtype)


@program_once
def _held_by(
    chart: Chart, system: AbstractSystem, t: Time, offset: Float[Array, " n"], d: Float[Array, " m"]
) -> tuple[Float[Array, " m"], Float[Array, " n"]]:
    none = jnp.zeros(len(offset) - len(d), offset.dtype)

    def closed(d: Array) -> tuple[Array, Array]:
        def newton(d: Array, _: None) -> tuple[Array, Array]:
            step, size = chart.step(system, t, offset + chart.ordered(none, d))
            return d - step, size

        d, sizes = jax.lax.scan(newton, d, None, length=_STEPS)
        return d, sizes[-1] <= precision.of(d.dtype).newton_accepted

    # A turn by more than a radian is too far for Newton's method, and the start of the other
    # system has made it; if nobody has moved that along, it begins where the first system is.
    starts = jnp.stack([chart.dependent_of(system.q0 - offset), d])
    tried, converged = jax.vmap(closed)(starts)
    d = jnp.where(converged[0], tried[0], tried[1])
    # Where the other system cannot be closed at s = 0, no coordinates are right.
    d = jnp.where(jnp.any(converged), d, jnp.nan)
    return d, offset + chart.ordered(none, d)


@program_once
def _dependent_inverses(
    chart: Chart, system: AbstractSystem, t: Float[Array, " K"], q: Float[Array, "K n"]
) -> Float[Array, "K m m"]:
    dependent = jnp.asarray(chart.dependent, q.dtype)
    rows = jax.vmap(lambda t, q: chart.jacobian(system, t, q))(t, q)
    inverses: Array = jnp.linalg.inv(rows @ dependent)
    return inverses
