"""Minimal coordinates of a mechanism, and what follows from them."""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
import scipy.linalg

from ..basis.snapshots import SnapshotSet
from ..system.base import AbstractSystem

# Minimal coordinates from which the others follow with a larger condition are none.
WORST = 1e4
# How many snapshots are looked at.
_LOOKS = 100
# Sweeps towards the chart whose worst place is best; few, as none is needed far from singular ones.
_SWEEPS = 10
# A column of C_q that varies by less is constant.
_CONSTANT = 1e-12


class Chart(eqx.Module):
    """q = q̄ + Y s + W d: minimal coordinates s, and others d that the constraints determine.

    `affine`: the constraints are affine in d with constant coefficients, as they are in the places
    of the bodies of an open chain; q(s) then has a closed form. Both Y and W are columns of the
    unit matrix there, and `order` says which: q − q̄ is (s, d)[order]. Else they are orthonormal in
    the mass metric.
    """

    free: np.ndarray  # Y (n, d)
    bound: np.ndarray  # W (n, m)
    read: np.ndarray  # (d, n): s of a displacement
    rows: tuple[int, ...] = eqx.field(static=True)  # of the constraints; the others repeat these
    affine: bool = eqx.field(static=True)
    order: tuple[int, ...] = eqx.field(static=True, default=())

    @classmethod
    def of_coordinates(cls, n: int, bound: np.ndarray, rows: tuple[int, ...]) -> "Chart":
        """An affine chart whose dependent coordinates are those of the numbers `bound`."""
        unit, free = np.eye(n), np.setdiff1d(np.arange(n), bound)
        order = tuple(int(i) for i in np.argsort(np.concatenate([free, bound])))
        return cls(unit[:, free], unit[:, bound], unit[free], rows, True, order)


class Survey(NamedTuple):
    """The constraints at some snapshots of a motion."""

    places: np.ndarray  # of the snapshots
    kept: tuple[int, ...]  # rows that do not repeat others
    rows: np.ndarray  # their Jacobians in the mass metric of the start
    moves: list[np.ndarray]  # null spaces Z of these
    root: np.ndarray  # R with Rᵀ R = M at the start


class Candidate(NamedTuple):
    """A chart, the worst condition of d over the snapshots, and where that is."""

    chart: Chart
    condition: float
    place: int


def survey(system: AbstractSystem, recording: SnapshotSet, looks: int) -> Survey:
    """Look at a motion's snapshots, or at so many of them."""
    places = np.linspace(0, len(recording.t) - 1, min(looks, len(recording.t))).astype(int)
    t, q = recording.t[places], recording.q[places]
    root = np.linalg.cholesky(np.asarray(system.mass(q[0]))).T
    rows = np.asarray(_jacobians(system, t, q)) @ np.linalg.inv(root)
    typical = rows[np.argmax([np.linalg.svd(x, compute_uv=False)[-1] for x in rows])]
    rank = int(np.linalg.matrix_rank(typical, tol=1e-9 * np.linalg.norm(typical, 2)))
    _, _, order = scipy.linalg.qr(typical.T, pivoting=True)
    kept = tuple(sorted(int(i) for i in order[:rank]))
    rows = rows[:, kept]
    moves = [scipy.linalg.svd(x)[2][rank:].T for x in rows]
    return Survey(places, kept, rows, moves, root)


def choose_chart(system: AbstractSystem, recording: SnapshotSet) -> Candidate:
    """The chart that suits all snapshots of a motion best.

    Closed form where the columns of C_q that never change determine enough coordinates. Else the
    best of two kinds, measured by the null spaces Z of C_q in the mass metric: single coordinates,
    and directions averaged over the motion.
    """
    n = system.n
    if system.m == 0:
        return Candidate(Chart.of_coordinates(n, np.zeros(0, int), ()), 1.0, 0)
    found = survey(system, recording, _LOOKS)
    t, q = recording.t[0], np.asarray(recording.q[0])
    root, kept, rank = found.root, found.kept, len(found.kept)

    # Any configuration is as good as another for finding out what is constant.
    anywhere = q[None] + np.cos(np.arange(3 * n).reshape(3, n) ** 1.5)
    varied = np.asarray(_jacobians(system, t + np.arange(3.0), anywhere))[:, kept]
    steady = np.ptp(varied, axis=0).max(axis=0) <= _CONSTANT * np.abs(varied).max()
    _, r, pivots = scipy.linalg.qr(varied[0] * steady / np.diagonal(root), pivoting=True)
    if abs(r[-1, rank - 1]) > abs(r[0, 0]) / WORST:
        dependent = np.sort(pivots[:rank])
        chart = Chart.of_coordinates(n, dependent, kept)
        return Candidate(chart, float(np.linalg.cond(varied[0][:, dependent])), 0)

    candidates = []
    for turned in (_coordinates(found.moves), *_means(found.moves)):
        free, bound = turned[:, rank:], turned[:, :rank]
        condition, place = _worst(free, bound, found.rows, found.moves)
        chart = linear_chart(found, free, bound)
        candidates.append(Candidate(chart, condition, int(found.places[place])))
    return min(candidates, key=lambda candidate: candidate.condition)


def linear_chart(found: Survey, free: np.ndarray, bound: np.ndarray) -> Chart:
    """The chart with free and bound directions that are orthonormal in the metric."""
    inverse = np.linalg.inv(found.root)
    return Chart(inverse @ free, inverse @ bound, free.T @ found.root, found.kept, False)


def _coordinates(moves: list[np.ndarray]) -> np.ndarray:
    """Unit vectors (n, n), last the coordinates that move most where they move least.

    Such as the angle of a crank, which turns on where means of directions come back.
    """
    n, d = moves[0].shape
    rest, chosen = [z.copy() for z in moves], list[int]()
    for _ in range(d):
        reach = np.min([np.linalg.norm(z, axis=1) for z in rest], axis=0)
        reach[chosen] = -1
        best = int(np.argmax(reach))
        chosen.append(best)
        for z in rest:
            row = z[best] / max(np.linalg.norm(z[best]), 1e-12)
            z -= np.outer(z @ row, row)
    return np.eye(n)[:, [*np.setdiff1d(np.arange(n), chosen), *chosen]]


def _means(moves: list[np.ndarray]) -> Iterator[np.ndarray]:
    """Eigenvectors (n, n) of Σ w ZZᵀ, the largest last; w grows where the last ones fit worst."""
    d, weights = moves[0].shape[1], np.ones(len(moves))
    for _ in range(_SWEEPS):
        _, vectors = np.linalg.eigh(sum(w * z @ z.T for w, z in zip(weights, moves, strict=True)))
        yield vectors
        fit = [np.linalg.svd(vectors[:, -d:].T @ z, compute_uv=False)[-1] for z in moves]
        weights = weights / np.maximum(fit, 1e-3)
        weights /= np.mean(weights)


def _worst(
    free: np.ndarray, bound: np.ndarray, rows: np.ndarray, moves: list[np.ndarray]
) -> tuple[float, int]:
    """The largest condition of the dependent coordinates, and at which snapshot."""
    conditions = np.array([np.linalg.cond(x @ bound) for x in rows])
    signs = np.array([np.linalg.det(free.T @ z) for z in moves])
    turns = np.array([np.linalg.det(a.T @ b) for a, b in itertools.pairwise(moves)])
    # Where the sign of the determinant changes, a singular place lies in between.
    conditions[:-1][signs[:-1] * signs[1:] * turns < 0] = np.inf
    place = int(np.argmax(conditions))
    return float(conditions[place]), place


@eqx.filter_jit
def _jacobians(system: AbstractSystem, t, q):  # type: ignore[no-untyped-def]
    return jax.vmap(system.jacobian)(t, q)
