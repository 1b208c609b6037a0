"""Which coordinates of a mechanism are independent, and which follow from them."""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from ..arrays import Time
from ..basis.snapshots import SnapshotSet
from ..system.base import AbstractSystem
from ..system.dynamics import jacobian

# A chart whose dependent coordinates follow with a larger condition is refused.
WORST_CONDITION = 1e4
# Snapshots at which charts are judged.
_SNAPSHOTS = 100
# Sweeps towards the chart whose worst snapshot is best; few, as none is needed far from singular
# positions.
_SWEEPS = 10
# A column of C_q that varies by less is constant.
_CONSTANT = 1e-12
# Singular values of C_q below this share of the largest come from constraints that repeat others.
_REDUNDANT = 1e-9


class Chart(eqx.Module):
    """q = q̄ + Y s + W d: independent coordinates s, and d that the constraints determine.

    - `independent` Y (n, d), `dependent` W (n, m); `read` (d, n) gives s of a displacement.
    - `rows`: numbers of the constraints that do not repeat others.
    - `affine`: the constraints are affine in d with constant coefficients, so that q(s) has a
      closed form. Y and W are then columns of the unit matrix, and `order` says which:
      q − q̄ is (s, d)[order]. Else the columns are orthonormal in the mass metric.
    """

    independent: np.ndarray
    dependent: np.ndarray
    read: np.ndarray
    rows: tuple[int, ...] = eqx.field(static=True)
    affine: bool = eqx.field(static=True)
    order: tuple[int, ...] = eqx.field(static=True, default=())

    @classmethod
    def of_coordinates(cls, n: int, dependent: np.ndarray, rows: tuple[int, ...]) -> "Chart":
        """An affine chart whose dependent coordinates have the numbers `dependent`."""
        unit, others = np.eye(n), np.setdiff1d(np.arange(n), dependent)
        order = tuple(int(i) for i in np.argsort(np.concatenate([others, dependent])))
        return cls(unit[:, others], unit[:, dependent], unit[others], rows, True, order)

    def ordered(self, s: Float[Array, "d *r"], d: Float[Array, "m *r"]) -> Float[Array, "n *r"]:
        """The coordinates of an affine chart in the order of q."""
        return jnp.concatenate([s, d])[np.array(self.order)]

    def regular(self, rows: Float[Array, "M *n"]) -> Float[Array, "m *n"]:
        """Of quantities for each constraint, those of the constraints that do not repeat others."""
        return rows if len(self.rows) == len(rows) else rows[np.array(self.rows, int)]

    def dependent_jacobian(
        self, system: AbstractSystem, t: Time, q: Float[Array, " n"]
    ) -> Float[Array, "m m"]:
        """∂C/∂d = C_q W."""
        rows = self.regular(jacobian(system, t, q))
        return rows @ jnp.asarray(self.dependent, q.dtype)


class Survey(NamedTuple):
    """The constraints at some snapshots of a motion, in coordinates R q with RᵀR = M."""

    snapshots: np.ndarray  # numbers of the snapshots
    rows: tuple[int, ...]  # constraints that do not repeat others
    jacobians: np.ndarray  # C_q R⁻¹ of these, (K, m, n)
    null_spaces: np.ndarray  # orthonormal Z with C_q R⁻¹ Z = 0, (K, n, d)
    root: np.ndarray  # R at the start

    def chart(self, independent: np.ndarray, dependent: np.ndarray) -> Chart:
        """The chart of directions (n, d) and (n, m) that are orthonormal in these coordinates."""
        inverse = np.linalg.inv(self.root)
        read = independent.T @ self.root
        return Chart(inverse @ independent, inverse @ dependent, read, self.rows, False)


class Candidate(NamedTuple):
    """A chart, and the worst condition of its dependent coordinates over the snapshots."""

    chart: Chart
    condition: float


def survey(system: AbstractSystem, snapshots: SnapshotSet, count: int) -> Survey:
    """The constraints at `count` snapshots, spread evenly."""
    numbers = np.linspace(0, len(snapshots.t) - 1, min(count, len(snapshots.t))).astype(int)
    t, q = snapshots.t[numbers], snapshots.q[numbers]
    root = np.linalg.cholesky(np.asarray(system.mass(q[0]))).T
    jacobians = np.asarray(_jacobians(system, t, q)) @ np.linalg.inv(root)
    # The snapshot farthest from a singular position tells which constraints repeat others.
    least = [np.linalg.svd(x, compute_uv=False)[-1] for x in jacobians]
    typical = jacobians[np.argmax(least)]
    tol = _REDUNDANT * np.linalg.norm(typical, 2)
    rank = int(np.linalg.matrix_rank(typical, tol=tol))
    _, _, order = scipy.linalg.qr(typical.T, pivoting=True)
    rows = tuple(sorted(int(i) for i in order[:rank]))
    jacobians = jacobians[:, rows]
    null_spaces = np.stack([scipy.linalg.svd(x)[2][rank:].T for x in jacobians])
    return Survey(numbers, rows, jacobians, null_spaces, root)


def choose_chart(system: AbstractSystem, snapshots: SnapshotSet) -> Candidate:
    """The chart that suits all snapshots of a motion best.

    One in closed form, where the columns of C_q that never change determine enough coordinates.
    Else the best of two kinds: single coordinates, and directions averaged over the motion.
    """
    n = system.n
    if system.m == 0:
        return Candidate(Chart.of_coordinates(n, np.zeros(0, int), ()), 1.0)
    seen = survey(system, snapshots, _SNAPSHOTS)
    t, q, rank = snapshots.t[0], np.asarray(snapshots.q[0]), len(seen.rows)

    # Any configuration is as good as another for telling which columns are constant.
    anywhere = q[None] + np.cos(np.arange(3 * n).reshape(3, n) ** 1.5)
    varied = np.asarray(_jacobians(system, t + np.arange(3.0), anywhere))[:, seen.rows]
    steady = np.ptp(varied, axis=0).max(axis=0) <= _CONSTANT * np.abs(varied).max()
    _, r, pivots = scipy.linalg.qr(varied[0] * steady / np.diagonal(seen.root), pivoting=True)
    if abs(r[-1, rank - 1]) > abs(r[0, 0]) / WORST_CONDITION:
        dependent = np.sort(pivots[:rank])
        chart = Chart.of_coordinates(n, dependent, seen.rows)
        return Candidate(chart, float(np.linalg.cond(varied[0][:, dependent])))

    candidates = []
    for directions in (_coordinates(seen.null_spaces), *_means(seen.null_spaces)):
        independent, dependent = directions[:, rank:], directions[:, :rank]
        condition = _worst_condition(independent, dependent, seen)
        candidates.append(Candidate(seen.chart(independent, dependent), condition))
    return min(candidates, key=lambda candidate: candidate.condition)


def _coordinates(null_spaces: np.ndarray) -> np.ndarray:
    """Unit vectors (n, n), last the coordinates that move most where they move least.

    Such as the angle of a crank, which grows where means of directions return.
    """
    _, n, d = null_spaces.shape
    left, chosen = null_spaces.copy(), list[int]()
    for _ in range(d):
        reach = np.min(np.linalg.norm(left, axis=2), axis=0)
        reach[chosen] = -1
        best = int(np.argmax(reach))
        chosen.append(best)
        # Take the direction of this coordinate out of each null space.
        row = left[:, best] / np.maximum(np.linalg.norm(left[:, best], axis=1), 1e-12)[:, None]
        left -= np.einsum("kna,ka,kb->knb", left, row, row)
    return np.eye(n)[:, [*np.setdiff1d(np.arange(n), chosen), *chosen]]


def _means(null_spaces: np.ndarray) -> Iterator[np.ndarray]:
    """Eigenvectors (n, n) of Σ w ZZᵀ, the largest last; w grows where the last ones fit worst."""
    d, weights = null_spaces.shape[2], np.ones(len(null_spaces))
    for _ in range(_SWEEPS):
        _, vectors = np.linalg.eigh(np.einsum("k,kna,kma->nm", weights, null_spaces, null_spaces))
        yield vectors
        fit = np.linalg.svd(vectors[:, -d:].T @ null_spaces, compute_uv=False)[:, -1]
        weights = weights / np.maximum(fit, 1e-3)
        weights /= np.mean(weights)


def _worst_condition(independent: np.ndarray, dependent: np.ndarray, seen: Survey) -> float:
    """The largest condition of C_q W over the snapshots; infinite across a singular position."""
    conditions = np.linalg.cond(seen.jacobians @ dependent)
    signs = np.linalg.det(independent.T @ seen.null_spaces)
    turns = [np.linalg.det(a.T @ b) for a, b in itertools.pairwise(seen.null_spaces)]
    # Where the sign of the determinant changes, a singular position lies in between.
    crossed = np.any(signs[:-1] * signs[1:] * np.array(turns) < 0)
    return float(np.inf if crossed else np.max(conditions))


@eqx.filter_jit
def _jacobians(
    system: AbstractSystem, t: Float[Array, " K"], q: Float[Array, "K n"]
) -> Float[Array, "K m n"]:
    return jax.vmap(lambda t, q: jacobian(system, t, q))(t, q)
