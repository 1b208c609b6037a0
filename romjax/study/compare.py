"""How far an approximate motion is from the true one."""

import dataclasses
import weakref
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Real

from ..common.arrays import concrete
from ..common.checks import check_kind, check_one_run, check_order
from ..common.extras import data_frame
from ..common.identity_cache import IdentityCache
from ..common.pictures import inline, picture_of
from ..compiling.program import program
from ..integrate.error_bar import hidden
from ..integrate.group_errors import (
    group_errors,
    groups_with_members,
    resolution,
    rounding,
    square_root,
)
from ..integrate.trajectory import Trajectory
from ..linalg.quaternions import columns as quaternion_columns


class Comparison(eqx.Module):
    """The errors of one motion against another.

    - `error`: ‖M₀^½ (q̃ − q)‖ / ‖M₀^½ (q − q₀)‖ over all output times, M₀ the mass matrix at the
      start: one number without units. Of a motion that rests, which differs from its start by
      rounding only, the absolute ‖M₀^½ (q̃ − q)‖; if one of both failed, NaN. In space,
      quaternions have unit length and that sign which makes the difference smallest.
    - `history` (k, n): the chapter's equation 39.17, Δq_i(t) / max |q_i − q_i(0)|. All four of a
      quaternion hold the angle between the two turns, over the largest angle from the start.
    - `per_coordinate` (n,): its largest magnitude in time.
    - `moving` (n,): which coordinates move at all; where one rests, the two above hold the
      absolute error, since a relative one has no meaning.
    - `per_group` (g,): of each of `groups`, the coordinates of one kind of one body (its position,
      its angle or quaternion, its modes), ‖Δq‖ / ‖q − q₀‖ in the norm of the diagonal of M₀. The
      norm of all is that of what moves most: where a mechanism turns, these tell of its bending.
      Of a group that moves by less than a hundred tolerances, relative to the whole motion, over
      that much motion. Runs in fixed steps have no tolerance: between these, a group that only
      the errors of the steps move errs relative to what they move it.
    - `drift`: largest |C| of the approximate motion.
    - `steps`: steps of the true and of the approximate run.
    - `labels`: of the coordinates.
    """

    error: Float[Array, ""]
    history: Float[Array, "k n"]
    per_coordinate: Float[Array, " n"]
    moving: Bool[Array, " n"]
    drift: Float[Array, ""]
    steps: tuple[Int[Array, ""], Int[Array, ""]]
    per_group: Float[Array, " g"]
    labels: tuple[str, ...] = eqx.field(static=True, default=())
    groups: tuple[str, ...] = eqx.field(static=True, default=())

    def hidden(self) -> str:
        """What the norm hides, in words: the group that errs most, such as "deflection of rod is
        wrong by 84 %", if by more than 10 % of its own motion while `error` is not; else "". Of
        several motions, those of each lane that has any.
        """
        return hidden(self.error, self.per_group, self.groups)

    def table(self) -> Any:
        """The error of each coordinate as a pandas data frame (extra `study`), largest first:
        `error`, relative where the coordinate is `moving`, else absolute.
        """
        columns = {"error": np.asarray(self.per_coordinate), "moving": np.asarray(self.moving)}
        rows = {"coordinate": list(self.labels), **columns}
        table = data_frame("Comparison.table", rows, "the errors are in .per_coordinate")
        return table.sort_values("error", ascending=False, ignore_index=True)

    def _repr_html_(self) -> str | None:
        """Return a picture of both motions for notebooks, as long as both are there."""
        motions = [reference() for reference in _motions.get(self) or ()]
        if not motions or any(motion is None for motion in motions):
            return None
        labels = ["truth", f"error {float(self.error):.1e}"]
        return inline(lambda: picture_of(*motions, labels=labels))


# Coordinates about zero round as the deflections, of some centimetres, that balance the forces.
_BALANCED = 0.01
# Motions that nobody else needs any more are not kept alive by it.
_motions = IdentityCache()


def compare(
    truth: Trajectory, approx: Trajectory, metric: Float[Array, "n n"] | None = None
) -> Comparison:
    """The errors of `approx` against `truth`, at the same times and in the same coordinates.

    `metric` (n, n): M₀; that of `truth` unless given.

    Raises ValueError if times or coordinates do not fit.
    """
    for run in (truth, approx):
        check_kind("compare", "a motion", run, Trajectory, "runs of romjax.simulate")
        check_one_run("compare", run.t)
    if truth.q.shape != approx.q.shape:
        raise ValueError(
            f"compare: the motions have shapes {truth.q.shape} and {approx.q.shape} (times, "
            "coordinates); simulate both at the same times."
        )
    check_order("compare", truth.labels, approx.labels, ValueError)
    t, other = concrete(truth.t), concrete(approx.t)
    if t is not None and other is not None and not same_times(t, other):
        raise ValueError("compare: the motions have different times; simulate both at the same.")
    steps = truth.stats.num_steps, approx.stats.num_steps
    metric = truth.metric if metric is None else metric
    groups, members = groups_with_members(truth.coordinates, truth.q.dtype)
    resolved = resolution(truth, approx)
    given = truth.q, metric, approx.q, approx.violation, steps, members, resolved
    comparison = _compare(*given, truth.quaternions)
    # Outside of the program, which does not depend on names.
    comparison = dataclasses.replace(comparison, labels=truth.labels, groups=groups)
    _motions.put(comparison, (weakref.ref(truth), weakref.ref(approx)))
    return comparison


def same_times(t: Real[np.ndarray, "*runs k"], other: Real[np.ndarray, "*runs k"]) -> bool:
    """Whether output times are the same, but for a millionth of the run and their rounding: neither
    a late start nor a short run hides a difference.
    """
    # Seconds in whole numbers have no rounding of their own.
    t, other = (x if x.dtype.kind == "f" else x.astype(float) for x in (t, other))
    eps = max(float(np.finfo(x.dtype).eps) for x in (t, other))
    length = np.max(t, axis=-1, keepdims=True) - np.min(t, axis=-1, keepdims=True)
    return bool(np.all(np.abs(t - other) <= 1e-6 * length + 4 * eps * np.abs(t)))


@program
def _compare(
    q: Float[Array, "k n"],
    metric: Float[Array, "n n"],
    approx: Float[Array, "k n"],
    violation: Float[Array, " k"],
    steps: tuple[Int[Array, ""], Int[Array, ""]],
    members: Float[Array | np.ndarray, "n g"],
    resolved: Float[Array | np.ndarray, ""],
    quaternions: tuple[int, ...],
) -> Comparison:
    difference, motion = apart(q, approx, quaternions), apart(q, q[:1], quaternions)
    own, moved = (_single(x, quaternions) for x in (difference, motion))
    moving = _moving(q, moved)
    # Equation 39.17 of the chapter: relative to the largest displacement of each coordinate; of one
    # that rests, absolute.
    history = own / jnp.where(moving, jnp.max(jnp.abs(moved), axis=0), 1)[None]
    error, size = _relative(q, difference, motion, metric, moving)
    return Comparison(
        error=error,
        history=history,
        per_coordinate=jnp.max(jnp.abs(history), axis=0),
        moving=moving,
        drift=jnp.max(violation),
        steps=steps,
        per_group=group_errors(difference, motion, jnp.diagonal(metric), members, resolved, size),
    )


def errors_between(
    q: Float[Array, "k n"],
    approx: Float[Array, "k n"],
    metric: Float[Array, "n n"],
    members: Float[Array | np.ndarray, "n g"],
    resolved: Float[Array | np.ndarray, ""],
    quaternions: Sequence[int],
) -> tuple[Float[Array, ""], Float[Array, " g"]]:
    """`Comparison.error` and `Comparison.per_group` alone, of a motion `approx` against the true
    one, as part of a program.
    """
    difference, motion = apart(q, approx, quaternions), apart(q, q[:1], quaternions)
    moving = _moving(q, _single(motion, quaternions))
    error, size = _relative(q, difference, motion, metric, moving)
    weights = jnp.diagonal(metric)
    return error, group_errors(difference, motion, weights, members, resolved, size)


def _moving(q: Float[Array, "k n"], moved: Float[Array, "k n"]) -> Bool[Array, " n"]:
    """Mark the coordinates that move, by more than rounding of one of order one."""
    scale = jnp.maximum(1.0, jnp.max(jnp.abs(q), axis=0))
    return jnp.max(jnp.abs(moved), axis=0) > rounding(q.dtype) * scale


def _relative(
    q: Float[Array, "k n"],
    difference: Float[Array, "k n"],
    motion: Float[Array, "k n"],
    metric: Float[Array, "n n"],
    moving: Bool[Array, " n"],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The norm of a difference over that of the motion, and that of the motion; the absolute one,
    and 0, of a motion that rests, whose coordinates, and whose norm, do not differ from the start
    by more than rounding.
    """
    root = jnp.linalg.cholesky(metric)
    # |x|² = xᵀ M x of all rows together, by the factor of M.
    size = _norm(motion @ root)
    # In single precision small motions are less than rounding of order one, but not of their own.
    own = jnp.maximum(_BALANCED, jnp.abs(q)) * jnp.sqrt(jnp.diagonal(metric))[None]
    moves = jnp.any(moving) | (size > rounding(q.dtype) * _norm(own))
    moves &= size > 0
    return _norm(difference @ root) / jnp.where(moves, size, 1), jnp.where(moves, size, 0)


def apart(
    q: Float[Array, "k n"], other: Float[Array, "_ n"], quaternions: Sequence[int]
) -> Float[Array, "k n"]:
    """The difference q − q̃; of the quaternions that begin at some columns, whose length and sign
    mean nothing, by those of unit length that are nearest to each other.
    """
    difference = q - other
    if not quaternions:
        return difference
    table = quaternion_columns(quaternions)
    p, opposed = (
        x / jnp.sqrt(jnp.sum(x**2, axis=2, keepdims=True)) for x in (q[:, table], other[:, table])
    )
    # p and −p are the same turn: the nearer one is compared.
    turned = jnp.sum(p * opposed, axis=2, keepdims=True) < 0
    return difference.at[:, table].set(p - jnp.where(turned, -opposed, opposed))


def _single(difference: Float[Array, "k n"], quaternions: Sequence[int]) -> Float[Array, "k n"]:
    """Return the difference of each coordinate; of a quaternion the angle [rad], in all four."""
    if not quaternions:
        return difference
    table = quaternion_columns(quaternions)
    chord = _norm(difference[:, table], axis=2, keepdims=True)
    # Quaternions lie apart by half the angle; rounding must not put a half turn beyond ½ √2.
    angle = 4 * jnp.arcsin(jnp.minimum(0.5 * chord, np.sin(np.pi / 4)))
    return difference.at[:, table].set(jnp.broadcast_to(angle, (*angle.shape[:2], 4)))


def _norm(x: Float[Array, "..."], axis: int | None = None, keepdims: bool = False) -> Array:
    """Euclidean norm whose gradient is zero, not NaN, where x vanishes; NaN where x is."""
    return square_root(jnp.sum(x**2, axis=axis, keepdims=keepdims))
