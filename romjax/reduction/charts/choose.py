"""The choice of independent coordinates."""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from ...common.arrays import as_jax
from ...common.identity_cache import IdentityCache
from ...system import unit_length
from ...system.base import AbstractSystem
from ...system.mobility import moves
from .chart import Chart
from .follow import Way, followed
from .survey import Survey, jacobians, mass_root, slopes, survey, violations

# A chart whose dependent coordinates follow with a larger condition is refused.
WORST_CONDITION = 1e4
# Snapshots at which charts are judged.
_SNAPSHOTS = 100
# Where allowed directions turn farther than that from one snapshot to the next (the cosine), no
# sign tells whether a singular position lies in between.
_RESOLVED = 0.5
# Charts that are then tried by following them.
_FOLLOWED = 2
# Sweeps towards the chart whose worst snapshot is best; few, as none is needed far from singular
# positions.
_SWEEPS = 10
# A column of C_q that varies by less is constant.
_CONSTANT = 1e-12
# Changes of C_q are looked for at so many configurations.
_VARIED = 3
# A coordinate that moves by a smaller share of what moves most is held.
_HELD = 1e-9
# Times at which constraints are looked at for drives [s], up to two hundred years.
_TIMES = np.concatenate([np.zeros(1), 0.0137 * 2.7183 ** np.arange(28.0)])


class Candidate(NamedTuple):
    """A chart, and the worst condition of its dependent coordinates over the snapshots; `way`: from
    each of these to the next, where they are far apart.
    """

    chart: Chart
    condition: float
    way: Way | None = None


class Directions(NamedTuple):
    """Orthonormal directions of independent (n, d) and dependent (n, m) coordinates of a survey,
    the worst condition of the dependent ones over the snapshots, and whether they seem to cross a
    singular position between two of these.
    """

    independent: np.ndarray
    dependent: np.ndarray
    worst: float
    crossed: bool

    @property
    def condition(self) -> float:
        """The worst condition on the way; infinite across a singular position."""
        return np.inf if self.crossed else self.worst


# Charts are looked up by snapshots, since a basis and the models made with it ask for the same one.
_chosen = IdentityCache()


def choose_chart(
    system: AbstractSystem, t: Float[Array, " h"], q: Float[Array, "h n"]
) -> Candidate:
    """The chart that suits all snapshots t, q of a motion best; remembered with them.

    One in closed form, where the columns of C_q that never change determine enough coordinates.
    Else the best of two kinds: single coordinates, and directions averaged over the motion.
    """
    known = _chosen.get(q)
    if known is None or known[0] is not system or known[1] is not t:
        known = _chosen.put(q, (system, t, _best(system, t, q)))
    best: Candidate = known[2]
    return best


def _best(system: AbstractSystem, t: Float[Array, " h"], q: Float[Array, "h n"]) -> Candidate:
    n = system.n
    total = unit_length.count(system)
    if total == 0:
        none = np.zeros(0, int)
        return Candidate(Chart.of_coordinates(none, (), np.zeros((0, n))), 1.0)
    # In a tree of joints all constraints count, and no snapshot needs to be looked at.
    seen = survey(system, t, q, _SNAPSHOTS) if system.structure.loops else None
    rows = tuple(range(total)) if seen is None else seen.rows
    root = mass_root(system, q[0]) if seen is None else seen.root

    nothing, sizes = np.zeros(0, int), np.diagonal(root)
    affine = _closed_form(system, t, q, rows, sizes, nothing)
    if affine is None and (held := _fixed_coordinates(system, t, q)).size:
        affine = _closed_form(system, t, q, rows, sizes, held)
    if affine is not None:
        return affine

    seen = seen or survey(system, t, q, _SNAPSHOTS)
    if not _resolved(seen) and (followed := _followed(system, t, q, seen)) is not None:
        return followed
    best = best_directions(seen)
    return Candidate(seen.chart(best.independent, best.dependent), best.condition)


def _followed(
    system: AbstractSystem, t: Float[Array, " h"], q: Float[Array, "h n"], seen: Survey
) -> Candidate | None:
    """The best chart in which the way from each snapshot to the next can be followed, if any."""
    times, configurations = np.asarray(t)[seen.snapshots], np.asarray(q)[seen.snapshots]
    for directions in sorted(_candidates(seen), key=lambda one: one.worst)[:_FOLLOWED]:
        if directions.worst <= WORST_CONDITION:
            chart = seen.chart(directions.independent, directions.dependent)
            way = followed(system, chart, times, configurations)
            if way is not None:
                return Candidate(chart, directions.worst, way)
    return None


def _resolved(seen: Survey) -> bool:
    """Whether the allowed directions of each snapshot are near those of the next."""
    before, after = seen.null_spaces[:-1], seen.null_spaces[1:]
    if not seen.null_spaces.shape[2]:
        return True
    # The smallest singular value of the product is the cosine of the largest angle between the
    # subspaces.
    cosines = np.linalg.svd(np.swapaxes(before, 1, 2) @ after, compute_uv=False)[:, -1]
    return bool(np.min(cosines, initial=1.0) >= _RESOLVED)


def _closed_form(
    system: AbstractSystem,
    t: Float[Array, " h"],
    q: Float[Array, "h n"],
    rows: tuple[int, ...],
    sizes: np.ndarray,
    held: np.ndarray,
) -> Candidate | None:
    """The chart whose dependent coordinates enter the constraints with constant coefficients while
    those that are `held` stay where they are, if there are enough; `sizes` (n,): roots of masses.
    """
    varied = _varied(system, t, q, held)[:, rows]
    steady = np.ptp(varied, axis=0).max(axis=0) <= _CONSTANT * np.abs(varied).max()
    # Columns that vary are no candidates; the pivots of the others are the dependent coordinates of
    # best condition, by QR with pivots.
    scaled, rank = varied[0] * steady / sizes, len(rows)
    r, pivots = scipy.linalg.qr(scaled, mode="r", pivoting=True)
    if abs(r[-1, rank - 1]) <= abs(r[0, 0]) / WORST_CONDITION:
        return None
    dependent = np.sort(pivots[:rank])
    chart = Chart.of_coordinates(dependent, rows, varied[0], held.size > 0)
    return Candidate(chart, float(np.linalg.cond(varied[0][:, dependent])))


def _varied(
    system: AbstractSystem, t: Float[Array, " h"], q: Float[Array, "h n"], held: np.ndarray
) -> np.ndarray:
    """C_q at some configurations, but for what is `held`: any are as good as others for telling
    which columns are constant.
    """
    first = np.asarray(q)[:1]
    # Fixed configurations without any order, so that the same mechanism has the same chart.
    anywhere = first + np.cos(np.arange(_VARIED * system.n).reshape(_VARIED, -1) ** 1.5)
    anywhere[:, held] = first[:, held]
    times = np.asarray(t)[0] + np.arange(float(_VARIED))
    return np.asarray(jacobians(system, times, anywhere))


def _fixed_coordinates(
    system: AbstractSystem, t: Float[Array, " h"], q: Float[Array, "h n"]
) -> np.ndarray:
    """Return the numbers of coordinates that joints to the ground hold, wherever all others are.

    The angle of a body that is clamped is one.
    """
    moved, first = np.ptp(np.asarray(q), axis=0), np.zeros(_VARIED, int)
    still = _immobile_coordinates(np.asarray(jacobians(system, t[first], q[first])))
    held: np.ndarray = still[moved[still] <= _HELD * np.max(moved)]
    while held.size:
        fewer = np.intersect1d(held, _immobile_coordinates(_varied(system, t, q, held)))
        if fewer.size == held.size:
            break
        held = fewer
    return held[~_driven(system, t, q)[held]] if held.size and moves(system) else held


def _driven(system: AbstractSystem, t: Float[Array, " h"], q: Float[Array, "h n"]) -> np.ndarray:
    """Mark the coordinates (n,) that constraints move with time, also where no snapshot shows it,
    as modes of one's own and runs that end before a drive begins do not.
    """
    first, start = np.asarray(q)[0], np.asarray(t)[0]
    # What is no signal is looked for at times of all sizes, which no period has in common.
    times = (start + _TIMES).astype(q.dtype)
    later = np.asarray(violations(system, as_jax(times), as_jax(first)))
    pushed = (later[1:] - later[0]).T
    # A drive that grows for ever overflows at times that no run reaches.
    finite = np.all(np.isfinite(pushed), axis=0)
    pushed = pushed[:, finite] if np.any(finite) else pushed
    signals = np.asarray(slopes(system, as_jax(start), as_jax(first)))
    rows = np.asarray(jacobians(system, as_jax(times[:1]), as_jax(first[None])))[0]
    columns = np.concatenate([pushed, signals], axis=1)
    shifts = np.abs(np.linalg.pinv(rows) @ columns)
    # Written so that NaN, of a drive that has no such times, counts as moved.
    moved: np.ndarray = np.any(~(shifts <= _HELD * np.max(shifts, axis=0)), axis=1)
    return moved


def _immobile_coordinates(slopes: np.ndarray) -> np.ndarray:
    """Return the numbers of coordinates that no velocity moves that the constraints allow.

    `slopes`: C_q (K, m, n) at some configurations.
    """
    free = [scipy.linalg.null_space(x) for x in slopes]
    return np.flatnonzero(
        np.max([np.max(np.abs(x), axis=1, initial=0) for x in free], axis=0) <= _HELD
    )


def best_directions(seen: Survey) -> Directions:
    """Return the directions whose worst snapshot is best: coordinates, or averages over the motion.

    Of a mechanism without freedom all coordinates are dependent.
    """
    return min(_candidates(seen), key=lambda candidate: candidate.condition)


def _candidates(seen: Survey) -> list[Directions]:
    rank, candidates = len(seen.rows), []
    means = _means(seen.null_spaces) if seen.null_spaces.shape[2] else ()
    for vectors in (_coordinates(seen.null_spaces), *means):
        independent, dependent = vectors[:, rank:], vectors[:, :rank]
        judged = _worst_condition(dependent, seen), _crossed(independent, seen)
        candidates.append(Directions(independent, dependent, *judged))
    return candidates


def _coordinates(null_spaces: np.ndarray) -> np.ndarray:
    """Unit vectors (n, n), last the coordinates that move most where they move least.

    Such as the angle of a crank, which grows where means of directions return.
    """
    _, n, d = null_spaces.shape
    left, chosen = null_spaces.copy(), list[int]()
    for _ in range(d):
        # How much of a coordinate the allowed motions move, in the worst snapshot.
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
        # Snapshots that the mean fits worst count more in the next sweep.
        weights = weights / np.maximum(fit, 1e-3)
        weights /= np.mean(weights)


def _worst_condition(dependent: np.ndarray, seen: Survey) -> float:
    """The largest condition of C_q W over the snapshots."""
    return float(np.max(np.linalg.cond(seen.jacobians @ dependent)))


def _crossed(independent: np.ndarray, seen: Survey) -> bool:
    """Whether the sign of the determinant changes, so that a singular position lies in between."""
    signs = np.linalg.det(independent.T @ seen.null_spaces)
    # Bases of null spaces have signs of their own, which the turn from one to the next takes out.
    turns = [np.linalg.det(a.T @ b) for a, b in itertools.pairwise(seen.null_spaces)]
    return bool(np.any(signs[:-1] * signs[1:] * np.array(turns) < 0))
