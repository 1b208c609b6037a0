"""Proper orthogonal decomposition of snapshots that do not fit into memory."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common import precision
from ..common.arrays import Numbers
from ..common.checks import check_shape
from ..common.errors import InputError
from .basis import Basis
from .build import modes_of
from .decomposition.pod import POD
from .rank import Rank, choose_rank
from .snapshot_checks import check_snapshots
from .snapshots import Noise, SnapshotSet, time_weights

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
    # Time and q of the last block.
    last: tuple[Float[Numbers, "one"], Float[Numbers, "one n"]] | None
    sample: tuple[np.ndarray, np.ndarray, np.ndarray]  # some snapshots: t, q, v
    stride: int = eqx.field(static=True)
    count: int = eqx.field(static=True)

    @classmethod
    def start(cls, metric: Any, offset: Any, most: int | None = None) -> "PodStream":
        """Return an empty stream, to which blocks of snapshots can be added.

        **Arguments:**

        - `metric` (n, n): mass matrix, such as `Trajectory.metric`; `offset` (n,): q̄.
        - `most`: how many directions are kept; all n unless given.
        """
        metric = jnp.asarray(metric)
        n, dtype = len(metric), metric.dtype
        if most is not None and not 1 <= most <= n:
            raise InputError(f"PodStream: most={most}, but it must lie between 1 and {n}.")
        return cls(
            factor=jnp.zeros((n, most or n), dtype),
            root=jnp.linalg.cholesky(metric).T,
            metric=metric,
            offset=jnp.asarray(offset, dtype),
            lost=jnp.zeros((), dtype),
            last=None,
            sample=(np.zeros(0, dtype), np.zeros((0, n), dtype), np.zeros((0, n), dtype)),
            stride=1,
            count=0,
        )

    def add(self, t: Any, q: Any, v: Any) -> "PodStream":
        """Return the stream with the snapshots `q`, `v` (h, n) at the times `t` (h,) appended."""
        # NumPy compiles nothing for blocks of another length.
        t, q = np.asarray(t, self.factor.dtype), np.asarray(q, self.factor.dtype)
        for name, x in (("q", q), ("v", v)):
            check_shape("PodStream.add", name, x, (len(t), len(self.offset)))
        block_t, block_q = t, q
        if self.last is not None:
            # The trapezoid between two blocks belongs to the later one.
            block_t = np.concatenate([self.last[0], t])
            block_q = np.concatenate([self.last[1], q])
        check_snapshots("PodStream.add", block_t, block_q, v)
        factor, lost = _merge(self.factor, self.root, self.offset, block_t, block_q)
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
        zero = jnp.zeros((), values.dtype)
        floor = precision.of(values.dtype).singular_values
        chosen = choose_rank("PodStream", values, rank, tol, floor, zero)
        squares = values**2
        missed = jnp.sum(squares[chosen.rank :]) + self.lost
        t, q, v = (jnp.asarray(x, values.dtype) for x in self.sample)
        weights, noise = time_weights(t), Noise(zero, zero)
        return Basis(
            modes=modes_of(self.root, vectors[:, : chosen.rank]),
            offset=self.offset,
            values=values,
            spectrum=values,
            snapshots=SnapshotSet(t, q, v, weights, self.metric, noise, (), ()),
            projection_error=jnp.sqrt(missed / (jnp.sum(squares) + self.lost)),
            floor=chosen.floor,
            decomposition=POD(rank, tol, self.offset),
            summary=chosen.reason,
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
    joined = jnp.concatenate([factor, new], axis=1)
    vectors, values, _ = jnp.linalg.svd(joined, full_matrices=False)
    most = factor.shape[1]
    return (vectors * values[None])[:, :most], jnp.sum(values[most:] ** 2)
