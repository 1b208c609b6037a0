"""The equations of an equilibrium, and their solution in a metric of statics."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..linalg.dense import multiply
from ..system import unit_length
from ..system.base import AbstractSystem

# What is left of the forces in an equilibrium, relative to the largest of them, and of the
# constraints, relative to the mechanism.
_BALANCED, _CLOSED = 1e-11, 1e-12
# Times the relative rounding: what rounding leaves of terms of some size; and the share of the
# largest singular value of the stiffness below which are those of neutral motions.
_LEFT, _NEUTRAL = 16, 500
# The share of the forces below which nobody asks whether anything resists them.
_RESISTED = 1e-3


class Statics(NamedTuple):
    """C_qᵀ λ = Q(t, q, 0) and C(t, q) = 0, with the length of each quaternion as at the `start`.

    States of effects are in their places in q, and at rest as well: their rates are zero.

    No force holds these lengths. As the torque of a force on p is in proportion to |p|, they would
    change so that forces which balance a start do so for ever.
    """

    system: AbstractSystem
    t: Float[Array, ""]
    start: Float[Array, " n"]

    def constraint(self, q: Float[Array, " n"]) -> Float[Array, " M"]:
        """C, and the changes of ½ |p|²."""
        values, m = unit_length.extended(self.system, self.t, q), self.system.m
        lengths = unit_length.extended(self.system, self.t, self.start)[m:]
        return jnp.concatenate([values[:m], values[m:] - lengths])

    def force(self, q: Float[Array, " n"]) -> Float[Array, " n"]:
        """Q at rest."""
        return self.system.state(self.t, q, self.system.structure.at_rest(q)).slow_force()

    def residual(
        self, q: Float[Array, " n"], multipliers: Float[Array, " M"]
    ) -> Float[Array, " n_plus_M"]:
        """C_qᵀ λ − Q, and C."""
        force = -self.force(q)
        if not multipliers.size:
            return force
        reaction = jax.grad(lambda q: multiply(multipliers, self.constraint(q)))(q)
        return jnp.concatenate([force + reaction, self.constraint(q)])

    def linearized(
        self, q: Float[Array, " n"], multipliers: Float[Array, " M"]
    ) -> tuple[Float[Array, "n_plus_M n_plus_M"], Float[Array, " n_plus_M"]]:
        """The derivatives of the residual, the stiffness bordered by C_q, and the residual."""

        def both(*at: Array) -> tuple[Array, Array]:
            residual = self.residual(*at)
            return residual, residual

        slopes, residual = jax.jacfwd(both, argnums=(0, 1), has_aux=True)(q, multipliers)
        return jnp.concatenate(slopes, axis=1), residual


class Linear(NamedTuple):
    """A `matrix` of statics and its sizes: `displacements` (n,) of the coordinates, of the `rows`
    of C_q by them (M,), the `energy` [J] of the stiffest one, and what `stays` of the `states` of
    effects, rows (k, k) of the changes that their rates know nothing of.
    """

    matrix: Float[Array, "n_plus_M n_plus_M"]
    displacements: Float[Array, " n"]
    rows: Float[Array, " M"]
    energy: Float[Array, ""]
    stays: Float[Array, "k k"] | None = None
    states: tuple[int, ...] = ()

    @classmethod
    def of(
        cls,
        matrix: Float[Array, "n_plus_M n_plus_M"],
        displacements: Float[Array, " n"],
        states: tuple[int, ...] = (),
    ) -> "Linear":
        n = len(displacements)
        rows = jnp.max(jnp.abs(matrix[n:, :n]) * displacements[None], axis=1, initial=0.0)
        stiffness = displacements[:, None] * jnp.abs(matrix[:n, :n]) * displacements[None]
        energy = jnp.max(stiffness, initial=0.0)
        linear = cls(
            matrix, displacements, jnp.where(rows > 0, rows, 1), jnp.where(energy > 0, energy, 1)
        )
        return linear._replace(stays=linear._staying(states), states=states) if states else linear

    def solve(
        self, right: Float[Array, " n_plus_M"], begun: Float[Array, " k"] | None = None
    ) -> Float[Array, " n_plus_M"]:
        """The least squares solution that moves neutral directions least.

        Displacements are as large as the mechanism, and joints as stiff as the stiffest part, so
        that a singular value is the stiffness of a motion relative to that. What stays of states is
        that of `begun`, of nothing unless given.
        """
        scale = self._scale
        rounded = _NEUTRAL * float(jnp.finfo(right.dtype).eps)
        scaled, right = scale[:, None] * self.matrix * scale[None], scale * right
        if self.stays is not None:
            rows = np.array(self.states)
            scaled = scaled.at[rows[:, None], rows].add(self.stays)
            if begun is not None:
                right = right.at[rows].add(multiply(self.stays, begun / scale[rows]))
        solution: Array = jnp.linalg.lstsq(scaled, right, rcond=rounded)[0]
        return scale * solution

    def _staying(self, states: tuple[int, ...]) -> Float[Array, "k k"]:
        """The rows of sums of states whose rates are zero whatever moves, such as the integral part
        of a controller without one: no motion changes these, which act as forces all the same.
        """
        scale, rows = self._scale, np.array(states)
        rates = scale[rows][:, None] * self.matrix[rows] * scale[None]
        lengths = jnp.linalg.norm(rates, axis=1, keepdims=True)
        lengths = jnp.where(lengths > 0, lengths, 1)
        # Rows of unit length, since rates of a pressure and of an angle differ by any factor.
        rates = rates / lengths
        rounded = float(jnp.finfo(rates.dtype).eps) ** 0.5
        onto = multiply(rates, jnp.linalg.pinv(rates, rtol=rounded))
        return lengths * (jnp.eye(len(rows), dtype=rates.dtype) - onto) / lengths.T

    def unresisted(
        self,
        right: Float[Array, " n_plus_M"],
        solution: Float[Array, " n_plus_M"],
        forces: Float[Array, " n_plus_M"],
    ) -> Float[Array, " n_plus_M"]:
        """The motion along forces that nothing resists, of any length: in the metric of `solve`,
        what its solution leaves of the equations is in the null space of the matrix.

        Zero where it leaves next to nothing of them, or of the `forces` of the whole load.
        """
        scale = self._scale
        left = scale * (right - multiply(self.matrix, solution))
        counts = jnp.linalg.norm(left) > _RESISTED * jnp.linalg.norm(
            scale * jnp.maximum(jnp.abs(right), jnp.abs(forces))
        )
        return jnp.where(counts, scale * left, 0)

    @property
    def _scale(self) -> Float[Array, " n_plus_M"]:
        root = jnp.sqrt(self.energy)
        return jnp.concatenate([self.displacements / root, root / self.rows])

    def balances(
        self,
        left: Float[Array, " n_plus_M"],
        q: Float[Array, " n"],
        multipliers: Float[Array, " M"],
        largest: Float[Array, ""],
    ) -> Array:
        """Whether what is `left` of the equations is small beside the `largest` force [J], or
        beside the rounding of its terms.
        """
        sizes = jnp.concatenate([jnp.maximum(jnp.abs(q), self.displacements), jnp.abs(multipliers)])
        rounding = _LEFT * jnp.finfo(q.dtype).eps * multiply(jnp.abs(self.matrix), sizes)
        allowed = jnp.concatenate([_BALANCED * largest / self.displacements, _CLOSED * self.rows])
        return jnp.all(jnp.abs(left) <= allowed + rounding)
