"""Minimal coordinates of a mechanism, and what follows from them."""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
import scipy.linalg

from ...basis.snapshots import Recording
from ..base import AbstractSystem

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
    unit matrix there, else orthonormal in the mass metric.
    """

    free: np.ndarray  # Y (n, d)
    bound: np.ndarray  # W (n, m)
    read: np.ndarray  # (d, n): s of a displacement
    rows: tuple[int, ...] = eqx.field(static=True)  # of the constraints; the others repeat these
    affine: bool = eqx.field(static=True)


class Candidate(NamedTuple):
    """A chart, the worst condition of d over the snapshots, and where that is."""

    chart: Chart
    condition: float
    place: int


def choose_chart(system: AbstractSystem, recording: Recording) -> Candidate:
    """The chart that suits all snapshots of a motion best.

    Closed form where the columns of C_q that never change determine enough coordinates. Else the
    directions in which the mechanism moves, averaged over the snapshots: the d leading eigenvectors
    of Σ w ZZᵀ, Z the null space of C_q in the mass metric; the weights w grow where the average
    fits worst.
    """
    chosen = np.linspace(0, len(recording.t) - 1, min(_LOOKS, len(recording.t))).astype(int)
    t, q = recording.t[chosen], recording.q[chosen]
    n, root = system.n, np.linalg.cholesky(np.asarray(system.mass(q[0]))).T
    if system.m == 0:
        none = np.zeros((n, 0))
        return Candidate(Chart(np.eye(n), none, np.eye(n), (), True), 1.0, 0)
    inverse = scipy.linalg.solve_triangular(root, np.eye(n))
    plain = np.asarray(_jacobians(system, t, q))
    rows = plain @ inverse
    typical = rows[np.argmax([np.linalg.svd(x, compute_uv=False)[-1] for x in rows])]
    rank = int(np.linalg.matrix_rank(typical, tol=1e-9 * np.linalg.norm(typical, 2)))
    _, _, order = scipy.linalg.qr(typical.T, pivoting=True)
    kept = tuple(sorted(int(i) for i in order[:rank]))
    rows = rows[:, kept]

    # Any configuration is as good as another for finding out what is constant.
    anywhere = q[0][None] + np.cos(np.arange(3 * n).reshape(3, n) ** 1.5)
    varied = np.asarray(_jacobians(system, t[:1] + np.arange(3.0), anywhere))[:, kept]
    steady = np.ptp(varied, axis=0).max(axis=0) <= _CONSTANT * np.abs(varied).max()
    _, r, pivots = scipy.linalg.qr(varied[0] * steady / np.diagonal(root), pivoting=True)
    if abs(r[-1, rank - 1]) > abs(r[0, 0]) / WORST:
        dependent = np.sort(pivots[:rank])
        unit, free = np.eye(n), np.setdiff1d(np.arange(n), dependent)
        chart = Chart(unit[:, free], unit[:, dependent], unit[free], kept, True)
        return Candidate(chart, float(np.linalg.cond(varied[0][:, dependent])), 0)

    moves = [scipy.linalg.svd(x)[2][rank:].T for x in rows]
    weights = np.ones(len(moves))
    best = None
    for _ in range(_SWEEPS):
        _, vectors = np.linalg.eigh(sum(w * z @ z.T for w, z in zip(weights, moves, strict=True)))
        free, bound = vectors[:, rank:], vectors[:, :rank]
        conditions = np.array([np.linalg.cond(x @ bound) for x in rows])
        signs = np.array([np.linalg.det(free.T @ z) for z in moves])
        turns = np.array([np.linalg.det(a.T @ b) for a, b in itertools.pairwise(moves)])
        # Where the sign of the determinant changes, a singular place lies in between.
        conditions[:-1][signs[:-1] * signs[1:] * turns < 0] = np.inf
        place = int(np.argmax(conditions))
        if best is None or conditions[place] < best.condition:
            chart = Chart(inverse @ free, inverse @ bound, free.T @ root, kept, False)
            best = Candidate(chart, float(conditions[place]), int(chosen[place]))
        fit = [np.linalg.svd(free.T @ z, compute_uv=False)[-1] for z in moves]
        weights = weights / np.maximum(fit, 1e-3)
        weights /= np.mean(weights)
    assert best is not None
    return best


@eqx.filter_jit
def _jacobians(system: AbstractSystem, t, q):  # type: ignore[no-untyped-def]
    return jax.vmap(system.jacobian)(t, q)
