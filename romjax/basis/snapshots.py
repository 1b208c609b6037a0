"""Snapshots of motions, weighted so that their singular values mean energy and time."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_jax, pick, untraced
from ..common.checks import check_kind, check_one_run, check_order
from ..common.errors import InputError
from ..common.identity_cache import IdentityCache
from ..compiling.program import program
from .snapshot_checks import check_snapshots
from .turns import Turns, by_turn, by_turns


@runtime_checkable
class Motion(Protocol):
    """The protocol of motions that a basis is made from; a Trajectory is one.

    Four members are optional. `noise()`: the size of integration errors in the snapshots of
    positions and of velocities, in the energy norm. `descriptions`: what the coordinates are called
    in sentences, as many as there are `labels`. `quaternions`: at which coordinates those of bodies
    in space begin. `states`: a motion at the ends of its steps, which replaces the outputs where it
    is not None.
    """

    t: Float[Array, " h"]
    q: Float[Array, "h n"]
    v: Float[Array, "h n"]

    @property
    def metric(self) -> Float[Array, "n n"]: ...

    @property
    def labels(self) -> tuple[str, ...]:
        """The coordinates as tables name them, () if unknown."""


class Noise(NamedTuple):
    """The size of integration errors in snapshots, as root mean square over time, energy norm."""

    positions: Float[Array, ""]
    velocities: Float[Array, ""]


class Sensitivity(eqx.Module):
    """The derivative of a motion by a parameter, as a snapshot beside those of motions.

    Of a subspace that holds them, reduced models have better gradients (Zahr, Farhat 2015,
    arXiv:1407.7618); of chains of beams, at equal rank, by a factor of two at most. Made by
    `sensitivities`.

    - `t` (h,) [s]; `q`, `v` (h, n): ∂q/∂p and ∂v/∂p times a change of the parameter, so that they
      are as large as what the parameter does to the motion.
    """

    t: Float[Array, " h"]
    q: Float[Array, "h n"]
    v: Float[Array, "h n"]


class Changes(eqx.Module):
    """Sensitivities, one after the other: `q`, `v` (s, n), and `weights` (s,) as of snapshots."""

    q: Float[Array, "s n"]
    v: Float[Array, "s n"]
    weights: Float[Array, " s"]


class SnapshotSet(eqx.Module):
    """The snapshots of one motion or of several, one after the other.

    - `t` (h,) [s]; `q`, `v` (h, n).
    - `weights` (h,): √w of the trapezoidal rule in time, motion by motion.
    - `metric` (n, n): mass matrix at the first start.
    - `noise`: the size of integration errors.
    - `labels`, `descriptions`: the coordinates as tables and as sentences name them, () if unknown.
    - `changes`: sensitivities, which a decomposition takes for snapshots too; None without any.
    - `turns`: the scale of quaternions, in which all of them are; None without any.
    """

    t: Float[Array, " h"]
    q: Float[Array, "h n"]
    v: Float[Array, "h n"]
    weights: Float[Array, " h"]
    metric: Float[Array, "n n"]
    noise: Noise
    labels: tuple[str, ...] = eqx.field(static=True)
    descriptions: tuple[str, ...] = eqx.field(static=True)
    changes: Changes | None = None
    turns: Turns | None = None

    @classmethod
    def of(cls, motions: "Motions") -> "SnapshotSet":
        """The snapshots of a motion, or of a list of them, with sensitivities among them or not.

        Raises InputError for a list without a motion, and for different numbers of coordinates.
        """
        if isinstance(motions, SnapshotSet):
            return motions
        given: list[Any] = [motions]
        if isinstance(motions, Iterable) and not isinstance(motions, Motion):
            given = list(motions)
        for one in given:
            check_kind("basis", "a motion", one, (Motion, Sensitivity), "runs of romjax.simulate")
            check_one_run("basis", one.t)
        runs = [one for one in given if not isinstance(one, Sensitivity)]
        if not runs:
            raise InputError("basis: no motion given; simulate one.")
        shapes = {run.q.shape[1:] for run in given}
        if len(shapes) > 1:
            raise InputError(
                f"basis: the motions have {sorted(n for (n,) in shapes)} coordinates; give motions "
                "of one mechanism."
            )
        for run in runs:
            check_order("basis", runs[0].labels, run.labels)
        dtype = jnp.result_type(*(jnp.asarray(run.q) for run in runs), float)
        for one in given:
            check_snapshots("basis", one.t, one.q, one.v)
        noises = [_noise(run, dtype) for run in runs]
        # Where a run kept the ends of its steps, these: contacts may be shorter than the time
        # between outputs.
        sampled = [getattr(run, "states", None) or run for run in runs]
        snapshots = cls(
            jnp.concatenate([jnp.asarray(run.t, dtype) for run in sampled]),
            jnp.concatenate([jnp.asarray(run.q, dtype) for run in sampled]),
            jnp.concatenate([jnp.asarray(run.v, dtype) for run in sampled]),
            jnp.concatenate([time_weights(jnp.asarray(run.t, dtype)) for run in sampled]),
            jnp.asarray(runs[0].metric, dtype),
            noises[0] if len(noises) == 1 else jax.tree.map(_largest, *noises),
            tuple(runs[0].labels),
            tuple(getattr(runs[0], "descriptions", runs[0].labels)),
            _changes([one for one in given if isinstance(one, Sensitivity)], dtype),
        )
        _motions.put(snapshots.weights, tuple(runs))
        columns = getattr(runs[0], "quaternions", ())
        if not columns:
            return snapshots
        return snapshots.turned(Turns.of(snapshots.q, snapshots.weights, columns))

    @property
    def motions(self) -> tuple["Motion", ...]:
        """The motions that the snapshots are from; () where that is not known."""
        return _motions.get(self.weights) or ()

    def turned(self, turns: Turns | None) -> "SnapshotSet":
        """The same motion by quaternions of another scale."""
        if turns is None:
            return self
        q, v = by_turns(turns, self.q, self.v)
        changes = self.changes
        if changes is not None and turns.affine:
            # Changes of each turn on the way keep those directions that the scale leaves free.
            free = jax.vmap(turns.without_length)
            changes = Changes(free(changes.q), free(changes.v), changes.weights)
        return dataclasses.replace(self, q=q, v=v, changes=changes, turns=turns)

    def of_unit_length(self, columns: Sequence[int]) -> "SnapshotSet":
        """The same motion by quaternions of unit length, which begin at `columns`."""
        if not columns:
            return self
        turns = self.turns or Turns.of(self.q, jnp.ones_like(self.t), columns)
        return self.turned(turns.of_unit_length)

    @classmethod
    def single(cls, q: Float[Array, " n"], metric: Float[Array, "n n"]) -> "SnapshotSet":
        """One snapshot at rest, of a mechanism of which nothing but its `metric` is given."""
        zero, (own,) = as_jax(np.zeros(1, q.dtype)), untraced(q)
        q, rest, least = as_jax(own[None]), as_jax(0 * own[None]), as_jax(np.zeros((), q.dtype))
        return cls(zero, q, rest, zero, metric, Noise(least, least), (), ())

    def of_coordinates(self, numbers: np.ndarray) -> "SnapshotSet":
        """Return the snapshots of the coordinates with these numbers only, without names."""
        changes = self.changes
        if changes is not None:
            q, v = (pick(x, np.s_[:, numbers]) for x in (changes.q, changes.v))
            changes = Changes(q, v, changes.weights)
        return dataclasses.replace(
            self,
            q=pick(self.q, np.s_[:, numbers]),
            v=pick(self.v, np.s_[:, numbers]),
            metric=pick(self.metric, np.ix_(numbers, numbers)),
            labels=(),
            descriptions=(),
            changes=changes,
            turns=None,
        )

    def mapped(self, matrix: Float[Array, "n n"]) -> "SnapshotSet":
        """Displacements from the first snapshot, changes and velocities, times a matrix."""
        q, v, changes = _mapped(self.q, self.v, self.changes, matrix)
        return dataclasses.replace(self, q=q, v=v, changes=changes)


# Motions are looked up by the weights of a set, which it keeps in other coordinates.
_motions = IdentityCache()

# One motion of a mechanism or several, with sensitivities or not, or the snapshots of them.
Motions = Motion | Sequence[Motion | Sensitivity] | SnapshotSet


class WeightedSnapshots(NamedTuple):
    """S (q − q̄) √w and S v √w as columns, with Sᵀ S the metric and w trapezoidal time weights.

    The metric makes the singular values independent of units, the weights of the sample rate
    (they approximate the L² norm in time), the offset of where the mechanism stands.
    """

    positions: Float[Array, "n h"]
    velocities: Float[Array, "n h"]
    offset: Float[Array, " n"]
    root: Float[Array, "n n"]  # S, upper triangular
    noise: Noise


def weigh(snapshots: SnapshotSet, offset: Any) -> WeightedSnapshots:
    """The weighted snapshots about `offset` (n,), the first configuration if that is None."""
    q = snapshots.q
    weighted: WeightedSnapshots
    offset = pick(q, 0) if offset is None else jnp.asarray(offset, q.dtype)
    if snapshots.turns is not None:
        offset = by_turn(snapshots.turns, offset)
    # Arrays alone, so that new names of coordinates do not compile it again.
    arrays = snapshots.v, snapshots.weights, snapshots.changes, snapshots.metric
    weighted = _weigh(q, *arrays, offset, snapshots.noise)
    return weighted


@program
def _weigh(
    q: Float[Array, "h n"],
    v: Float[Array, "h n"],
    weights: Float[Array, " h"],
    changes: Changes | None,
    metric: Float[Array, "n n"],
    offset: Float[Array, " n"],
    noise: Noise,
) -> WeightedSnapshots:
    displacements = q - offset[None]
    if changes is not None:
        displacements = jnp.concatenate([displacements, changes.q])
        v = jnp.concatenate([v, changes.v])
        weights = jnp.concatenate([weights, changes.weights])
    # M = SᵀS, so that |S x| is the energy norm of x and the decompositions are Euclidean.
    root = jnp.linalg.cholesky(metric).T
    positions = root @ displacements.T * weights[None]
    velocities = root @ v.T * weights[None]
    return WeightedSnapshots(positions, velocities, offset, root, noise)


@program
def time_weights(t: Float[Array, " h"]) -> Float[Array, " h"]:
    """√w of the trapezoidal rule, by which sums of squares are integrals over time."""
    step, none = jnp.diff(t), jnp.zeros(1, t.dtype)
    return jnp.sqrt(0.5 * (jnp.append(step, none) + jnp.append(none, step)))


def _changes(sensitivities: Sequence[Sensitivity], dtype: Any) -> Changes | None:
    if not sensitivities:
        return None
    return Changes(
        jnp.concatenate([jnp.asarray(one.q, dtype) for one in sensitivities]),
        jnp.concatenate([jnp.asarray(one.v, dtype) for one in sensitivities]),
        jnp.concatenate([time_weights(jnp.asarray(one.t, dtype)) for one in sensitivities]),
    )


def _largest(*sizes: Array) -> Array:
    return jnp.max(jnp.stack(sizes))


def _noise(motion: Motion, dtype: Any) -> Noise:
    estimate = getattr(motion, "noise", None)
    if estimate is None:
        return Noise(jnp.zeros((), dtype), jnp.zeros((), dtype))
    return Noise(*(jnp.asarray(x, dtype) for x in estimate()))


@program
def _mapped(
    q: Float[Array, "h n"],
    v: Float[Array, "h n"],
    changes: Changes | None,
    matrix: Float[Array, "n n"],
) -> tuple[Float[Array, "h n"], Float[Array, "h n"], Changes | None]:
    if changes is not None:
        changes = Changes(changes.q @ matrix.T, changes.v @ matrix.T, changes.weights)
    # Displacements are mapped, the start stays.
    return q[:1] + (q - q[:1]) @ matrix.T, v @ matrix.T, changes
