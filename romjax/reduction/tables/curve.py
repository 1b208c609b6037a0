"""The curve of all configurations of a mechanism with one freedom, node by node."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import as_jax
from ...common.errors import ReductionError, UnsuitedError
from ...system.base import AbstractSystem
from ..charts.survey import jacobians
from .frames import BLOCK, Frames, Point, advance, start, violations
from .grid import CLOSED, Goal, Grid, check, refined
from .interpolation import SIDE

# Blocks of steps after which a curve that has not closed is left open.
_MOST = 64
# Largest change of the unit tangent over one step while the curve is surveyed.
_TURN = 0.2
# Corrections of the length of a closed curve, and its share at which they end.
_CORRECTIONS, _CLOSED = 8, 1e-13
# Share of an open curve that is added at both ends of what the snapshots need.
_MARGIN = 0.1


class Points(NamedTuple):
    """Configurations (K, n) one after the other along a curve, with its unit tangents there."""

    q: np.ndarray
    tangent: np.ndarray


def trace_curve(
    system: AbstractSystem,
    frames: Frames,
    q: Float[Array, " n"],
    snapshots: Float[Array, "K n"] | None,
    goal: Goal,
) -> Grid:
    """The whole curve through q if it closes, else as much of it as the snapshots need.

    Halfway between the nodes the constraints hold to the `goal`. Raises ReductionError for
    constraints that change with time, at a singular position, and for an open curve without
    snapshots.
    """
    rows = np.asarray(jacobians(system, frames.time[None], q[None]))[0]
    free, direction = np.array(frames.numbers), np.zeros(q.size)
    direction[free] = np.linalg.svd(rows[:, free])[2][-1]
    begin = start(system, frames, q, jnp.asarray(direction, q.dtype))
    walk = _Walk(system, frames)
    step, closing = walk.survey(begin)
    make: Callable[[int], Grid]
    if closing is not None:
        length, turn = closing
        make = lambda count: walk.around(begin, length, turn, count)  # noqa: E731
    elif snapshots is not None:
        begin, length = walk.ends(begin, step, np.asarray(snapshots))
        make = lambda count: walk.along(begin, length, count)  # noqa: E731
    else:
        raise ReductionError(
            "reduce: the mechanism does not come back to where it starts, so that a table of all "
            "its configurations has no end; give a basis, whose snapshots say how far it goes."
        )
    count = BLOCK * max(1, round(length / step / BLOCK))
    return refined(system, frames, make, count, goal, BLOCK)


class _Walk(NamedTuple):
    """Ways along the curve of a system."""

    system: AbstractSystem
    frames: Frames

    def survey(self, begin: Point) -> tuple[float, tuple[float, np.ndarray] | None]:
        """A step over which the tangent turns little, and length and turn if the curve closes."""
        step = 1.0
        while step > np.finfo(begin.q.dtype).eps:
            points = _first(begin)
            for _ in range(_MOST):
                points = self.on(points, step)
                changes = np.diff(points.tangent[-BLOCK - 1 :], axis=0)
                if not np.max(self.size(changes)) <= _TURN:  # or NaN
                    break
                closing = self.closing(points, step)
                if closing is not None:
                    return step, closing
            else:
                return step, None
            step /= 2
        raise ReductionError(
            "reduce: the mechanism starts in a singular position, where a table cannot begin."
        )

    def closing(self, points: Points, step: float) -> tuple[float, np.ndarray] | None:
        """Length and turn, if the last block of points passes the first one again."""
        last = slice(-BLOCK - 1, None)
        displacements = points.q[last] - points.q[0]
        # Angles of parts that go round have advanced by multiples of 2π, all else comes back as it
        # was.
        turns = 2 * np.pi * np.round(displacements / (2 * np.pi))
        left = displacements - turns
        metric = np.asarray(self.frames.metric)
        along = left @ metric @ points.tangent[0]
        alike = points.tangent[last] @ metric @ points.tangent[0] > 1 - _TURN
        close = (self.size(left) < 2 * step) & alike
        passes = close[1:] & (along[:-1] < 0) & (along[1:] >= 0)
        first = max(0, BLOCK + 3 - len(points.q))  # not as it leaves
        for i in np.flatnonzero(passes):
            if i >= first and np.array_equal(turns[i], turns[i + 1]):
                share = float(along[i] / (along[i] - along[i + 1]))
                passed: int = len(points.q) - 1 - BLOCK + int(i)
                return (passed + share) * step, turns[i]
        return None

    def around(self, begin: Point, length: float, turn: np.ndarray, count: int) -> Grid:
        """`count` nodes of a closed curve of about this length; the last step ends at the first."""
        metric = np.asarray(self.frames.metric)
        step = length / count
        for _ in range(_CORRECTIONS):
            points = self.points(begin, step, count)
            gap = float((points.q[count] - points.q[0] - turn) @ metric @ points.tangent[0])
            if abs(gap) <= _CLOSED * length:
                break
            # The gap along the tangent is shared by all steps, as Newton's method for the length
            # does.
            step -= gap / count
        left = np.max(np.abs(points.q[count] - points.q[0] - turn))
        violated = np.abs(violations(self.system, self.frames.time, as_jax(points.q + turn)))
        if left > CLOSED * (1 + np.max(np.abs(points.q))) or np.max(violated) > CLOSED:
            check(self.system, self.frames, *_grid(points, step, turn).in_a_row())
            raise UnsuitedError(
                f"reduce: after one round the mechanism is {left:.1e} beside where it started, so "
                "that no table holds all of its rounds."
            )
        before, after = slice(count - SIDE, count), slice(SIDE + 1)
        q = np.concatenate([points.q[before] - turn, points.q[:count], points.q[after] + turn])
        tangents = [points.tangent[part] for part in (before, slice(count), after)]
        return _grid(Points(q, np.concatenate(tangents)), step, turn)

    def ends(self, begin: Point, step: float, snapshots: np.ndarray) -> tuple[Point, float]:
        """The lower end of what the snapshots need of an open curve, and the length from there."""
        forth = self.points(begin, step, _MOST * BLOCK)
        back = self.points(Point(begin.q, -begin.tangent), step, _MOST * BLOCK)
        q = np.concatenate([back.q[:0:-1], forth.q])
        root = np.linalg.cholesky(np.asarray(self.frames.metric))
        # Squared distances |q|² − 2 q · s + |s|² without the last term, which all nodes have in
        # common.
        far = np.sum((q @ root) ** 2, 1)[:, None] - 2 * (q @ root) @ (snapshots @ root).T
        nearest = np.argmin(far, axis=0)
        margin = 1 + int(np.ceil(_MARGIN * np.ptp(nearest)))
        low = int(np.clip(np.min(nearest) - margin, 0, len(q) - 1))
        high = int(np.clip(np.max(nearest) + margin, 0, len(q) - 1))
        tangents = np.concatenate([-back.tangent[:0:-1], forth.tangent])
        return Point(jnp.asarray(q[low]), jnp.asarray(tangents[low])), (high - low) * step

    def along(self, begin: Point, length: float, count: int) -> Grid:
        """`count` steps of an open curve."""
        step = length / count
        return _grid(self.points(begin, step, count), step, None)

    def points(self, begin: Point, step: float, count: int) -> Points:
        """The first point, and `count` or some more after it."""
        points = _first(begin)
        while len(points.q) <= count:
            points = self.on(points, step)
        return Points(points.q[: count + 1], points.tangent[: count + 1])

    def on(self, points: Points, step: float) -> Points:
        """The points with a block more of them."""
        last = Point(jnp.asarray(points.q[-1]), jnp.asarray(points.tangent[-1]))
        block = advance(self.system, self.frames, last, jnp.asarray(step, last.q.dtype))
        return Points(
            np.concatenate([points.q, np.asarray(block.q)]),
            np.concatenate([points.tangent, np.asarray(block.tangent)]),
        )

    def size(self, x: np.ndarray) -> np.ndarray:
        """Lengths in the mass metric of x (k, n)."""
        metric = np.asarray(self.frames.metric)
        return np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", x, metric, x)))


def _first(point: Point) -> Points:
    return Points(np.asarray(point.q)[None], np.asarray(point.tangent)[None])


def _grid(points: Points, step: float, turn: np.ndarray | None) -> Grid:
    q, tangents = (as_jax(x) for x in points)
    steps = jnp.full(1, step, q.dtype)
    return Grid(
        q, tangents[:, :, None], steps, None if turn is None else jnp.asarray(turn, q.dtype)
    )
