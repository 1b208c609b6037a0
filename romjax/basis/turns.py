"""How snapshots choose one of the quaternions of any length that turn a body alike."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..common.arrays import concrete
from ..compiling.program import program
from .subspace import leading

# Cosine of half the angle from the mean turn up to which bodies are said to turn about it: 150°.
# Farther away quaternions with p·p̄ = 1 grow without bounds.
_FARTHEST = float(np.cos(np.radians(75)))


class Turns(eqx.Module):
    """The scale of quaternions, which means nothing to a mechanism in space, and much to a basis.

    With p·p̄ = 1 the snapshots span just what a body turns by: one direction for a hinge whose axis
    is fixed, where quaternions of unit length fill two. Bodies that turn farther than 150° from
    their mean have quaternions of unit length instead, as all have that are not `affine`.

    - `means` p̄ (bodies, 4): the mean turn of each body, zero for one that turns too far.
    - `columns`: at which coordinate the quaternion of each body begins.
    """

    means: Float[Array, "bodies 4"]
    columns: tuple[int, ...] = eqx.field(static=True)
    affine: bool = eqx.field(static=True, default=True)

    @classmethod
    def of(
        cls, q: Float[Array, "h n"], weights: Float[Array, " h"], columns: Sequence[int]
    ) -> "Turns":
        """Return the turns about the mean turns p̄ of snapshots `q` with `weights`.

        p̄ is the eigenvector of Σ w p pᵀ (Markley et al. 2007, doi:10.2514/1.28949), with its
        largest component positive.
        """
        return cls(_means(q, weights, tuple(columns)), tuple(columns))

    @property
    def of_unit_length(self) -> "Turns":
        """The same turns by quaternions of unit length, with the signs of their means."""
        return Turns(self.means, self.columns, affine=False)

    def __call__(
        self, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """A configuration and its velocities, by the quaternions of this scale."""
        scaled, rate = jax.jvp(self._scaled, (q,), (v,))
        return scaled, rate

    @property
    def without_lengths(self) -> int:
        """How many quaternions have p·p̄ = 1, which leaves three directions to each; none where
        JAX traces them.
        """
        far = concrete(self._too_far)
        return 0 if far is None or not self.affine else int(np.sum(~far))

    def normalised(self, q: Float[Array, " n"]) -> Float[Array, " n"]:
        """A configuration by quaternions of unit length where p·p̄ = 1; those of bodies that turn
        too far stay as they are.
        """
        table = _table(self.columns)
        return q.at[table].set(q[table] / self._lengths(q)[:, None])

    def normalised_motion(
        self, q: Float[Array, " n"], changes: Float[Array, "n k"]
    ) -> tuple[Float[Array, " n"], Float[Array, "n k"], Float[Array, " n"]]:
        """`normalised`, its change by each column of `changes`, and its second change by the last.

        Of p = x/|x| and u = (ẋ − p (p·ẋ))/|x| they are u and, for ẍ = 0, −2 u (p·ẋ)/|x| − p |u|².
        """
        table, lengths = _table(self.columns), self._lengths(q)[:, None]
        p, rates = q[table] / lengths, changes[table] / lengths[:, :, None]
        near = ~self._too_far[:, None]
        along = jnp.sum(p[:, :, None] * rates, axis=1) * near
        turning = rates - p[:, :, None] * along[:, None]
        last = turning[:, :, -1]
        second = -2 * last * along[:, -1:] - p * jnp.sum(last**2, axis=1, keepdims=True)
        bias = jnp.zeros_like(q).at[table].set(jnp.where(near, second, 0))
        return q.at[table].set(p), changes.at[table].set(turning), bias

    def _lengths(self, q: Float[Array, " n"]) -> Float[Array, " bodies"]:
        lengths = jnp.sqrt(jnp.sum(q[_table(self.columns)] ** 2, axis=1))
        return jnp.where(self._too_far, jnp.ones_like(lengths), lengths)

    def without_length(self, change: Float[Array, " n"]) -> Float[Array, " n"]:
        """A change of coordinates that leaves p·p̄ as it is."""
        table = _table(self.columns)
        along = jnp.sum(change[table] * self.means, axis=1, keepdims=True)
        return change.at[table].add(-along * self.means)

    def _scaled(self, q: Float[Array, " n"]) -> Float[Array, " n"]:
        table = _table(self.columns)
        p = q[table]
        along, length = jnp.sum(p * self.means, axis=1), jnp.sqrt(jnp.sum(p**2, axis=1))
        if self.affine:
            scale = jnp.where(self._too_far, length, along)
        else:
            scale = jnp.where(along < 0, -length, length)
        return q.at[table].set(p / scale[:, None])

    @property
    def _too_far(self) -> Bool[Array, " bodies"]:
        return jnp.all(self.means == 0, axis=1)


@program
def by_turns(
    turns: Turns, q: Float[Array, "h n"], v: Float[Array, "h n"]
) -> tuple[Float[Array, "h n"], Float[Array, "h n"]]:
    """Configurations and their velocities, by the quaternions of a scale."""
    scaled, rates = jax.vmap(turns)(q, v)
    return scaled, rates


@program
def by_turn(turns: Turns, q: Float[Array, " n"]) -> Float[Array, " n"]:
    """One configuration by the quaternions of a scale."""
    scaled: Float[Array, " n"] = turns._scaled(q)
    return scaled


@program
def _means(
    q: Float[Array, "h n"], weights: Float[Array, " h"], columns: tuple[int, ...]
) -> Float[Array, "bodies 4"]:
    return jax.vmap(lambda p: _mean(p, weights), 1)(q[:, _table(columns)])


def _mean(p: Float[Array, "h 4"], weights: Float[Array, " h"]) -> Float[Array, "4"]:
    unit = p / jnp.linalg.norm(p, axis=1, keepdims=True)
    vectors, _ = leading((unit * weights[:, None]).T, 1)
    mean = vectors[:, 0]
    near = jnp.min(jnp.abs(unit @ mean)) >= _FARTHEST
    sign = jnp.sign(mean[jnp.argmax(jnp.abs(mean))])
    return jnp.where(near, sign * mean, jnp.zeros_like(mean))


def _table(columns: Sequence[int]) -> np.ndarray:
    return np.array(columns)[:, None] + np.arange(4)
