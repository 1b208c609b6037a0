"""Snapshots of motions, weighted so that their singular values mean energy and time."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@runtime_checkable
class Motion(Protocol):
    """What a basis is made from; a Trajectory is one.

    A `noise()` is optional: the size of integration errors in the snapshots of positions and of
    velocities, in the energy norm.
    """

    t: Float[Array, " h"]
    q: Float[Array, "h n"]
    v: Float[Array, "h n"]
    metric: Float[Array, "n n"]
    labels: tuple[str, ...]


class Noise(NamedTuple):
    """The size of integration errors in snapshots, as root mean square over time, energy norm."""

    positions: Float[Array, ""]
    velocities: Float[Array, ""]


class Recording(eqx.Module):
    """The snapshots of one motion or of several, one after the other.

    - `t` (h,) [s]; `q`, `v` (h, n).
    - `weights` (h,): √w of the trapezoidal rule in time, run by run.
    - `metric` (n, n): mass matrix at the first start.
    """

    t: Float[Array, " h"]
    q: Float[Array, "h n"]
    v: Float[Array, "h n"]
    weights: Float[Array, " h"]
    metric: Float[Array, "n n"]
    noise: Noise
    labels: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, motions: "Motion | Sequence[Motion] | Recording") -> "Recording":
        """The record of a motion, or of a list of them."""
        if isinstance(motions, Recording):
            return motions
        runs = [motions] if isinstance(motions, Motion) else list(motions)
        if not runs:
            raise ValueError("basis: no motion given; simulate one.")
        shapes = {run.q.shape[1:] for run in runs}
        if len(shapes) > 1:
            raise ValueError(
                f"basis: the motions have {sorted(n for (n,) in shapes)} coordinates; give motions "
                "of one mechanism."
            )
        kind = jnp.result_type(*(jnp.asarray(run.q) for run in runs), float)
        noises = [_noise(run, kind) for run in runs]
        return cls(
            jnp.concatenate([jnp.asarray(run.t, kind) for run in runs]),
            jnp.concatenate([jnp.asarray(run.q, kind) for run in runs]),
            jnp.concatenate([jnp.asarray(run.v, kind) for run in runs]),
            jnp.concatenate([time_weights(jnp.asarray(run.t, kind)) for run in runs]),
            jnp.asarray(runs[0].metric, kind),
            jax.tree.map(lambda *x: jnp.max(jnp.stack(x)), *noises),
            runs[0].labels,
        )

    @classmethod
    def still(cls, q: Float[Array, " n"]) -> "Recording":
        """One snapshot at rest, of a mechanism of which nothing else is known."""
        zero = jnp.zeros(1, q.dtype)
        none = Noise(zero[0], zero[0])
        return cls(zero, q[None], 0 * q[None], zero, jnp.eye(len(q), dtype=q.dtype), none, ())


class Snapshots(NamedTuple):
    """S (q − q̄) √w and S v √w as columns, with Sᵀ S the metric and w trapezoidal time weights.

    The metric makes the singular values independent of units, the weights of the sample rate
    (they approximate the L² norm in time), the offset of where the mechanism stands.
    """

    positions: Float[Array, "n h"]
    velocities: Float[Array, "n h"]
    offset: Float[Array, " n"]
    root: Float[Array, "n n"]  # S, upper triangular


def weigh(recording: Recording, offset: Any) -> Snapshots:
    """The weighted snapshots about `offset` (n,), the first configuration if that is None."""
    q = recording.q
    weighted: Snapshots
    weighted = _weigh(recording, q[0] if offset is None else jnp.asarray(offset, q.dtype))
    return weighted


@jax.jit
def _weigh(recording: Recording, offset: Float[Array, " n"]) -> Snapshots:
    root = jnp.linalg.cholesky(recording.metric).T
    weights = recording.weights[None]
    positions = root @ (recording.q - offset[None]).T * weights
    return Snapshots(positions, root @ recording.v.T * weights, offset, root)


@jax.jit
def time_weights(t: Float[Array, " h"]) -> Float[Array, " h"]:
    """√w of the trapezoidal rule."""
    step, none = jnp.diff(t), jnp.zeros(1, t.dtype)
    return jnp.sqrt(0.5 * (jnp.append(step, none) + jnp.append(none, step)))


def _noise(motion: Motion, kind: Any) -> Noise:
    known = getattr(motion, "noise", None)
    if known is None:
        return Noise(jnp.zeros((), kind), jnp.zeros((), kind))
    return Noise(*(jnp.asarray(x, kind) for x in known()))


SnapshotSet = Recording
