"""The surface of the configurations of a mechanism with two freedoms, as far as snapshots go."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import as_jax
from ...common.errors import ReductionError, UnsuitedError
from ...compiling.program import program_once
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from ..charts.choose import WORST_CONDITION, best_directions
from ..charts.survey import survey
from .frames import Frames, violations
from .grid import CLOSED, Goal, Grid, refined

# Snapshots at which coordinates are judged.
_SNAPSHOTS = 100
# Share of what the snapshots need that is added at each end; and the width of a narrow side, as a
# share of the wide one.
_MARGIN, _NARROW = 0.1, 0.05
# Nodes in each direction at first.
_FIRST = 14
# Steps of the way from a snapshot to a node, and Newton steps in each. Nodes of one call.
_WAY, _NEWTON, _BLOCK = 12, 2, 512


def trace_surface(
    system: AbstractSystem, frames: Frames, snapshots: Float[Array, "K n"] | None, goal: Goal
) -> Grid:
    """A grid over the rectangle of the snapshots in the two coordinates that suit them best.

    The coordinates are s = Aᵀ M₀ (q − q̄) with constant directions A, from which the constraints
    determine all others. Halfway between the nodes the constraints hold to the `goal`. Raises
    ReductionError without snapshots, for constraints that change with time, and where the rectangle
    comes to a singular position.
    """
    if snapshots is None:
        raise ReductionError(
            "reduce: a table of two freedoms holds what a motion needs of them; give a basis, "
            "whose snapshots say how far it goes."
        )
    free = np.array(frames.numbers)
    times = jnp.full(len(snapshots), frames.time)
    seen = survey(system, times, snapshots, _SNAPSHOTS, free)
    directions = best_directions(seen)
    if not directions.condition <= WORST_CONDITION:
        raise UnsuitedError(
            "reduce: no two coordinates determine all others at every snapshot, since the "
            "mechanism passes a singular position of each pair."
        )
    along = np.zeros((system.n, 2))
    # Directions were chosen in coordinates of unit kinetic energy.
    along[free] = np.linalg.inv(seen.root) @ directions.independent
    read, begins = along.T @ np.asarray(frames.metric), np.asarray(snapshots)
    reached = begins @ read.T
    width = np.ptp(reached, axis=0)
    # A motion along a line needs a strip that is wide enough for other starts.
    width = np.maximum(width, _NARROW * np.max(width))
    middle = (np.max(reached, axis=0) + np.min(reached, axis=0)) / 2
    low, high = (middle + sign * (0.5 + _MARGIN) * width for sign in (-1, 1))

    def make(count: int) -> Grid:
        lines = [np.linspace(*ends, count) for ends in zip(low, high, strict=True)]
        targets = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
        # The way to a node begins at the snapshot that is nearest to it in units of the widths.
        far = (targets[:, None] - reached) / width
        nearest = np.argmin(np.sum(far**2, axis=2), axis=1)
        q = _on_surface(system, frames, along, begins[nearest], targets)
        shape, steps = (count, count, system.n), (high - low) / (count - 1)
        every = np.broadcast_to(along, (*shape, 2))
        return Grid(as_jax(q.reshape(shape)), as_jax(every), as_jax(steps), None)

    # The rectangle has grown by this share of itself at each end, where errors do not count.
    margin = _MARGIN / (1 + 2 * _MARGIN)
    return refined(system, frames, make, _FIRST, goal, margin=margin)


def _on_surface(
    system: AbstractSystem,
    frames: Frames,
    along: np.ndarray,
    begins: np.ndarray,
    targets: np.ndarray,
) -> np.ndarray:
    """The configurations (P, n) with these coordinates (P, 2), each on a way from another one.

    Raises UnsuitedError if the mechanism cannot take one of them.
    """
    blocks, directions = list[np.ndarray](), as_jax(along)
    for first in range(0, len(targets), _BLOCK):
        # Equally many in each call, so that one program does for all.
        numbers = np.minimum(np.arange(first, first + _BLOCK), len(targets) - 1)
        starts, ends = as_jax(begins[numbers]), as_jax(targets[numbers])
        blocks.append(np.asarray(_ways(system, frames, directions, starts, ends)))
    q = np.concatenate(blocks)[: len(targets)]
    violated = np.max(np.abs(violations(system, frames.time, as_jax(q))), axis=1)
    missed = np.flatnonzero(~(violated <= CLOSED * (1 + np.max(np.abs(begins)))))  # or NaN
    if missed.size:
        raise UnsuitedError(
            f"reduce: the mechanism cannot take {missed.size} of {len(targets)} positions in the "
            "rectangle around its snapshots, of which a table has to hold all."
        )
    return q


@program_once
def _ways(
    system: AbstractSystem,
    frames: Frames,
    along: Float[Array, "n d"],
    begins: Float[Array, "P n"],
    targets: Float[Array, "P d"],
) -> Float[Array, "P n"]:
    read = multiply(along.T, frames.metric)

    def one(begin: Array, target: Array) -> Array:
        start = multiply(read, begin)

        def newton(q: Array, wanted: Array) -> Array:
            correction, tangents = frames.slice(system, q, along)
            # Along the tangents to the wanted coordinates, and across them back to C = 0.
            displacement = multiply(tangents, wanted - multiply(read, q))
            return q + displacement - multiply(correction, frames.violation(system, q))

        def step(q: Array, share: Array) -> tuple[Array, None]:
            for _ in range(_NEWTON):
                q = newton(q, start + share * (target - start))
            return q, None

        # Newton's method doubles the digits once more at the end.
        shares = np.minimum(np.arange(1, _WAY + 2) / _WAY, 1.0)
        return jax.lax.scan(step, begin, jnp.asarray(shares, begin.dtype))[0]

    return jax.vmap(one)(begins, targets)
