"""Proper orthogonal decomposition of snapshots that do not fit into memory."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .basis import Basis
from .build import modes_of
from .rank import FLOOR, Rank, choose_rank
from .snapshots import Noise, Recording, time_weights

# Snapshots that are kept as they are, for a reduced model to look at.
_SAMPLE = 400


class PodStream(eqx.Module):
    """The proper orthogonal decomposition of a motion that comes in blocks, in one pass.

    Each block is merged into the left singular vectors and values so far, of which the first
    `most` are kept: memory does not grow with the number of snapshots. Exact if the motion has no
    more than `most` directions. An immutable value:

        stream = PodStream.start(metric, offset)
        stream = stream.add(t, q, v)  # for each block
        basis = stream.basis(rank=5)
    """

    factor: Float[Array, "n most"]  # U Σ of S (q − q̄) √w
    root: Float[Array, "n n"]
    metric: Float[Array, "n n"]
    offset: Float[Array, " n"]
    lost: Float[Array, ""]  # sum of the squares of the values that were left out
    last: tuple[Float[Array, "one"], Float[Array, "one n"]] | None  # time and q of the last block
    sample: tuple[np.ndarray, np.ndarray, np.ndarray]  # some snapshots: t, q, v
    stride: int = eqx.field(static=True)
    count: int = eqx.field(static=True)

    @classmethod
    def start(cls, metric: Any, offset: Any, most: int | None = None) -> "PodStream":
        """Before the first block.

        **Arguments:**

        - `metric` (n, n): mass matrix, such as `Trajectory.metric`; `offset` (n,): q̄.
        - `most`: how many directions are kept; all n unless given.
        """
        metric = jnp.asarray(metric)
        n, kind = len(metric), metric.dtype
        if most is not None and not 1 <= most <= n:
            raise ValueError(f"PodStream: most={most}, but it must lie between 1 and {n}.")
        return cls(
            factor=jnp.zeros((n, most or n), kind),
            root=jnp.linalg.cholesky(metric).T,
            metric=metric,
            offset=jnp.asarray(offset, kind),
            lost=jnp.zeros((), kind),
            last=None,
            sample=(np.zeros(0, kind), np.zeros((0, n), kind), np.zeros((0, n), kind)),
            stride=1,
            count=0,
        )

    def add(self, t: Any, q: Any, v: Any) -> "PodStream":
        """With the snapshots `q`, `v` (h, n) at the times `t` (h,), which follow those before."""
        t, q = jnp.asarray(t, self.factor.dtype), jnp.asarray(q, self.factor.dtype)
        times, places = t, q
        if self.last is not None:
            # The trapezoid between two blocks belongs to the later one.
            times = jnp.concatenate([self.last[0], t])
            places = jnp.concatenate([self.last[1], q])
        factor, lost = _merge(self.factor, self.root, self.offset, times, places)
        first = -self.count % self.stride
        parts = zip(self.sample, (t, q, v), strict=True)
        sample = [
            np.concatenate([old, np.asarray(new)[first :: self.stride]]) for old, new in parts
        ]
        stride = self.stride
        while len(sample[0]) > _SAMPLE:
            sample, stride = [x[::2] for x in sample], 2 * stride
        return dataclasses.replace(
            self,
            factor=factor,
            lost=self.lost + lost,
            last=(t[-1:], q[-1:]),
            sample=(sample[0], sample[1], sample[2]),
            stride=stride,
            count=self.count + len(t),
        )

    def basis(self, rank: Rank | None = None, *, tol: float | None = None) -> Basis:
        """The basis of all snapshots so far; `rank` and `tol` as in `pod`."""
        vectors, values, _ = jnp.linalg.svd(self.factor, full_matrices=False)
        none = jnp.zeros((), values.dtype)
        chosen = choose_rank("PodStream", values, rank, tol, FLOOR[values.dtype], none)
        squares = values**2
        missed = jnp.sum(squares[chosen.rank :]) + self.lost
        t, q, v = (jnp.asarray(x, values.dtype) for x in self.sample)
        return Basis(
            modes=modes_of(self.root, vectors[:, : chosen.rank]),
            offset=self.offset,
            values=values,
            spectrum=values,
            recording=Recording(t, q, v, time_weights(t), self.metric, Noise(none, none), ()),
            leak=jnp.sqrt(missed / (jnp.sum(squares) + self.lost)),
            kind="POD",
            reason=chosen.reason,
            floor=chosen.floor,
            tol=chosen.tol,
        )


@jax.jit
def _merge(
    factor: Float[Array, "n most"],
    root: Float[Array, "n n"],
    offset: Float[Array, " n"],
    t: Float[Array, " h"],
    q: Float[Array, "h n"],
) -> tuple[Float[Array, "n most"], Float[Array, ""]]:
    new = root @ (q - offset[None]).T * time_weights(t)[None]
    both = jnp.concatenate([factor, new], axis=1)
    vectors, values, _ = jnp.linalg.svd(both, full_matrices=False)
    most = factor.shape[1]
    kept = (vectors * values[None])[:, :most]
    return kept, jnp.sum(values[most:] ** 2)
