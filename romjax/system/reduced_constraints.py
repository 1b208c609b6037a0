"""The constraints that a reduced model still needs, and the freedom that the snapshots use."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..basis.basis import Basis
from ..basis.subspace import leading
from ..common.arrays import Numbers
from ..compiling.program import program_once
from .base import AbstractSystem

# A combination of constraints is kept if the basis can move along it by this share of what the
# full model can. Cart-pendulum: the shares are 0.018 | 1.0, 6e-5 | 1.0, 0.77 for POD with
# r = 3 | 4 | 5. Keeping the small ones locks the mechanism, dropping the large ones frees it.
THRESHOLD = 0.05
# A motion that violates the constraints by more than this share of what free parts would is no
# motion of the mechanism. Reduced models with 0.1 err by 1 %, with 0.2 by 50 %.
LOOSE = 0.15
# Kept constraints may stop so many times the share of the velocities that the basis misses: 0.1 to
# 1.6 for reduced models that are right, 27 and more for ones that are locked.
LOCKED = 4.0
_SLOW = 1e-6  # and this much more, of integration errors
_STOPPED = 0.3  # but never so much of the motion itself
_ZERO = 1e-9  # singular values of scaled rows below this are zero
_SNAPSHOTS = 200


class ReducedConstraints(NamedTuple):
    """The constraint Jacobian at the snapshots, in the basis; rows of unit length in the metric."""

    rows: Float[Array, "K m r"]
    drives: Float[Array, "K m"]  # C_t, scaled as the rows
    scale: Float[Array, " m"]  # of the rows, on average
    speeds: Float[Array, "K r"]  # velocities of the snapshots, in the basis
    missed: Float[Array, ""]  # the share of them that the basis misses

    def combinations(self, count: int) -> Float[Array, "m count"]:
        """The principal ones: columns U, so that UᵀC are combinations of the constraints."""
        return _combinations(self.rows, self.scale, count)


@program_once
def _combinations(
    rows: Float[Numbers, "K m r"], scale: Float[Numbers, " m"], count: int
) -> Float[Array, "m count"]:
    vectors, _ = leading(jnp.asarray(_side_by_side(rows)), count)
    return scale[:, None] * vectors


def _side_by_side(rows: Any) -> Any:
    """The rows (K, m, r) of all snapshots as one matrix (m, K r)."""
    count, m, r = rows.shape
    return rows.transpose(1, 0, 2).reshape(m, count * r) / count**0.5


@program_once
def reduced_constraints(system: AbstractSystem, basis: Basis) -> ReducedConstraints:
    """Find the constraints that motions in the basis can violate, at the snapshots.

    Linear constraints vanish in the subspace, since all snapshots satisfy them; what is left of
    their Jacobian is rounding noise, which a plain solver takes for a pivot. The rows are scaled to
    unit length in the mass metric, so that the shares know no units.
    """
    stride = -(-len(basis.snapshots.t) // _SNAPSHOTS)
    z, t = basis.coordinates[::stride], basis.snapshots.t[::stride]

    def reduced(t: Array, z: Array) -> tuple[Array, Array, Array]:
        q = basis.offset + basis.modes @ z
        state = system.state(t, q, jnp.zeros_like(q))
        rows = state.jacobian()
        # The length of a row in the metric of M⁻¹: the acceleration that its force makes, whatever
        # its unit.
        squares = jnp.sum(rows.T * state.kkt().solve_mass(rows.T), axis=0)
        scale = 1 / jnp.sqrt(jnp.where(squares > 0, squares, 1))
        _, driven = jax.jvp(lambda t: system.constraint(t, q), (t,), (jnp.ones_like(t),))
        return scale[:, None] * rows @ basis.modes, scale * driven, scale

    rows, drives, scales = jax.vmap(reduced)(t, z)
    metric, velocities = basis.snapshots.metric, basis.snapshots.v[::stride]
    root, speeds = jnp.linalg.cholesky(metric), velocities @ metric @ basis.modes
    # In the energy norm, |x|² = xᵀ M x, by the factor of M = L Lᵀ.
    missed = jnp.linalg.norm((velocities - speeds @ basis.modes.T) @ root)
    size = jnp.linalg.norm(velocities @ root)
    missed = missed / jnp.where(size > 0, size, 1)
    return ReducedConstraints(rows, drives, jnp.mean(scales, axis=0), speeds, missed)


def most_kept(candidates: ReducedConstraints) -> int:
    """How many combinations the basis can move along, and does at any one snapshot."""
    rows = np.asarray(candidates.rows)
    shares = np.linalg.svd(_side_by_side(rows), compute_uv=False)
    ranks = [np.linalg.matrix_rank(jacobian, tol=_ZERO) for jacobian in rows]
    return min(int(np.sum(shares > THRESHOLD)), max(ranks, default=0))


def locks(candidates: ReducedConstraints, count: int) -> bool:
    """Whether keeping `count` combinations would stop the snapshots' own motion.

    Of a velocity w they leave what satisfies C_q Φ w + C_t = 0: with the drives C_t, prescribed
    motions are no motions that they stop. A subspace misses some of the velocities anyway.
    Constraints that stop more than that do not belong in it: the motion satisfies them by the
    curvature that the subspace lacks.
    """
    speeds, drives = np.asarray(candidates.speeds), np.asarray(candidates.drives)
    changes = [
        split.to_rows @ (split.kept @ driven) + split.held @ speed
        for split, driven, speed in zip(_splits(candidates, count), drives, speeds, strict=True)
    ]
    stopped = float(np.sqrt(sum(np.sum(change**2) for change in changes)))
    size = float(np.linalg.norm(speeds))
    return bool(stopped > min(LOCKED * float(candidates.missed) + _SLOW, _STOPPED) * size)


def looseness(candidates: ReducedConstraints, count: int) -> tuple[float, int]:
    """How far the motion that is left free violates the constraints, and the one it violates most.

    The largest singular value over the snapshots of the scaled Jacobian, on the null space of the
    `count` combinations that are kept: zero where all joints hold, one for parts without joints.
    """
    pairs = zip(np.asarray(candidates.rows), _splits(candidates, count), strict=True)
    violated = [jacobian @ split.free.T for jacobian, split in pairs]
    sizes = [float(np.linalg.norm(x, 2)) if x.size else 0.0 for x in violated]
    worst = int(np.argmax(sizes))
    return sizes[worst], int(np.argmax(np.linalg.norm(violated[worst], axis=1)))


class _Split(NamedTuple):
    """The velocities at one snapshot, by the combinations UᵀC that are kept.

    `held` (k, r) and `free` (r - k, r): the directions that they stop, and those left free.
    `kept` (count, m): Uᵀ, of scaled constraints; `to_rows` (k, count): what a violation of their
    rates takes along the held directions.
    """

    held: np.ndarray
    free: np.ndarray
    kept: np.ndarray
    to_rows: np.ndarray


def _splits(candidates: ReducedConstraints, count: int) -> Iterator[_Split]:
    """Split the coordinates at each snapshot by the constraints that are kept."""
    scale = np.asarray(candidates.scale)
    kept = (np.asarray(candidates.combinations(count)) / scale[:, None]).T
    for jacobian in np.asarray(candidates.rows):
        # Rows of `right` with singular values span what the kept constraints hold, the others what
        # they leave free.
        left, values, right = np.linalg.svd(kept @ jacobian)
        rank = int(np.sum(values > _ZERO))
        to_rows = left[:, :rank].T / values[:rank, None]
        yield _Split(right[:rank], right[rank:], kept, to_rows)
