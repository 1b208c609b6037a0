"""The inverse of a block-diagonal mass matrix, in rates that suit each kind of body."""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .dense import invert, multiply
from .indexing import take

Rows = Float[Array, "k _"]
Blocks = Float[Array, "count k _"]


class AbstractBodyInverse(eqx.Module):
    """M⁻¹ = T W Tᵀ of one body.

    T maps rates in which the inertia is simple, such as angular velocities by the axes of the body,
    to the rates of its coordinates. All methods take rows, such as those of C_q, and forces as one.
    """

    @abc.abstractmethod
    def to_rates(self, x: Rows) -> Rows:
        """Return X T, which makes rows by coordinates rows by rates."""

    @abc.abstractmethod
    def weigh(self, x: Rows) -> Rows:
        """Return X W, with a symmetric W."""

    @abc.abstractmethod
    def from_rates(self, x: Rows) -> Rows:
        """Return X Tᵀ."""

    def apply(self, x: Rows) -> Rows:
        """Return X M⁻¹."""
        return self.from_rates(self.weigh(self.to_rates(x)))


class PlainInverse(AbstractBodyInverse):
    """M⁻¹ itself, or its diagonal: the rates are those of the coordinates."""

    weights: Float[Array, "size *size"]

    def to_rates(self, x: Rows) -> Rows:
        return x

    def weigh(self, x: Rows) -> Rows:
        if self.weights.ndim == 2:
            return multiply(x, self.weights)
        # Blocks are as wide as the widest body: columns beyond the own ones hold zeros, which any
        # weight leaves.
        more = x.shape[1] - len(self.weights)
        return x * jnp.pad(self.weights, (0, more), constant_values=1)[None]

    def from_rates(self, x: Rows) -> Rows:
        return x


class InverseMass(eqx.Module):
    """M⁻¹ of all bodies, which come in groups of one kind.

    All methods take rows (count, k, size) of some `bodies`, by their numbers.
    """

    groups: tuple[AbstractBodyInverse, ...]  # each stacked

    @classmethod
    def of(cls, mass: Float[Array, "bodies size *size"]) -> "InverseMass":
        """Invert mass matrices, or their diagonals (bodies, size)."""
        return cls((PlainInverse(1 / mass if mass.ndim == 2 else invert(mass)),))

    def to_rates(self, x: Blocks, bodies: np.ndarray) -> Blocks:
        """Return X T."""
        return self._each(lambda one, x: one.to_rates(x), x, bodies)

    def weigh(self, x: Blocks, bodies: np.ndarray) -> Blocks:
        """Return X W."""
        return self._each(lambda one, x: one.weigh(x), x, bodies)

    def from_rates(self, x: Blocks, bodies: np.ndarray) -> Blocks:
        """Return X Tᵀ."""
        return self._each(lambda one, x: one.from_rates(x), x, bodies)

    def apply(self, x: Blocks, bodies: np.ndarray) -> Blocks:
        """Return X M⁻¹."""
        return self._each(lambda one, x: one.apply(x), x, bodies)

    def _each(
        self,
        function: Callable[[AbstractBodyInverse, Rows], Rows],
        x: Blocks,
        bodies: np.ndarray,
    ) -> Blocks:
        """A function of the inverse of each body and its rows."""
        # Groups are stored one after another, and bodies numbered so.
        ends = np.cumsum([0, *(len(jax.tree.leaves(group)[0]) for group in self.groups)])
        results, order = [], []
        for group, first, end in zip(self.groups, ends[:-1], ends[1:], strict=True):
            # Which of the asked bodies are of this group is static, so that nothing is chosen while
            # a program runs.
            own = np.flatnonzero((first <= bodies) & (bodies < end))
            if not own.size:
                continue
            members = bodies[own] - first
            inverses = jax.tree.map(lambda a, members=members: take(a, members), group)
            results.append(jax.vmap(function)(inverses, take(x, own)))
            order.append(own)
        if len(results) == 1:
            return results[0]
        return take(jnp.concatenate(results), np.argsort(np.concatenate(order)))
