"""How many modes: by number, by tolerance, or by the drop point."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ..common.arrays import as_jax
from ..common.errors import InputError, RankError

Rank = int | str  # a number of modes, or "drop"

# A drop point is a fall by two decades. The values of a falling chain of bars decrease by 2 to 20
# at each step, all the way to rounding: they have none.
DROP = 100.0


class Choice(NamedTuple):
    """A rank and why; `floor` is relative to the largest value."""

    rank: int
    reason: str
    floor: Float[Array, ""]  # directions below are noise


def choose_rank(
    name: str,
    values: Float[Array, " k"],
    rank: Rank | None,
    tol: Float[Array, ""] | float | None,
    rounding: float,
    noise: Float[Array, ""],
) -> Choice:
    """Choose from singular values, largest first; without `rank` and `tol`, the drop point.

    Directions below `rounding` (relative to the largest value) never count, and ones below the
    `noise` of the integration (absolute) only where they are asked for by number. While JAX traces,
    only a number is possible, since the rank shapes all that follows.

    Raises RankError for a number that the snapshots do not allow, InputError for what is no rank
    or tolerance, and for snapshots that are not finite or do not move.
    """
    if rank is not None and tol is not None:
        raise InputError(f"{name}: give rank={rank} or tol={tol}, not both.")
    if isinstance(rank, int) and not 1 <= rank <= len(values):
        raise RankError(
            f"{name}: rank={rank}, but the snapshots allow 1 to {len(values)}: no more than there "
            "are coordinates, and no more than there are snapshots."
        )
    if any(isinstance(x, Tracer) for x in (values, noise)):
        if not isinstance(rank, int):
            raise InputError(
                f"{name}: under jit, grad or vmap the rank must be a number, such as rank=5; "
                "find it first, outside."
            )
        return Choice(rank, f"rank {rank}: as asked", jnp.maximum(rounding, noise / values[0]))
    spectrum = np.asarray(values)
    if not np.all(np.isfinite(spectrum)):
        raise InputError(f"{name}: the snapshots are not finite; did the simulation succeed?")
    if not spectrum[0] > 0:
        raise InputError(
            f"{name}: the snapshots do not move, so no direction stands out; simulate a motion."
        )
    level = float(np.maximum(rounding, np.asarray(noise) / spectrum[0]))
    levels = _Levels(spectrum / spectrum[0], rounding, level)
    if isinstance(rank, int):
        count, why = rank, _as_asked(name, levels, rank)
    elif tol is not None:
        count, why = _by_tolerance(name, levels, float(tol))
    elif rank in (None, "drop"):
        count, why = _by_drop(levels)
    else:
        raise InputError(f'{name}: rank={rank!r}; give a whole number or "drop".')
    return Choice(count, f"rank {count}: {why}", as_jax(np.asarray(level, spectrum.dtype)))


class _Levels(NamedTuple):
    """Singular values, and below which ones are errors, all relative to the largest value."""

    values: np.ndarray
    rounding: float
    floor: float  # of rounding or of the integration, whichever is higher

    @property
    def source(self) -> str:
        """The cause of the floor, in words."""
        return "rounding" if self.floor <= self.rounding else "integration errors"

    def above(self, level: float) -> int:
        """How many values are above a level."""
        return int(np.sum(self.values > level))

    def following(self, rank: int) -> str:
        """The first value that is left out, in words."""
        left = self.values[rank:]
        return "the next value is " + (f"{left[0]:.1e} of the largest" if left.size else "none")


def _as_asked(name: str, levels: _Levels, rank: int) -> str:
    significant = levels.above(levels.rounding)
    if rank > significant:
        raise RankError(
            f"{name}: rank={rank}, but the snapshots span only {significant} directions above "
            f"rounding (the next value is {levels.values[significant]:.1e} of the largest); "
            f"ask for at most {significant}, or simulate a richer motion."
        )
    why, certain = "as asked", levels.above(levels.floor)
    if rank > certain:
        why += f", {rank - certain} of them below {levels.source} of {levels.floor:.1e}"
    return f"{why}; {levels.following(rank)}"


def _by_tolerance(name: str, levels: _Levels, tol: float) -> tuple[int, str]:
    if not 0 < tol < 1:
        raise InputError(f"{name}: tol={tol}, but it must lie between 0 and 1.")
    floor = levels.floor
    count = max(1, levels.above(max(tol, floor)))
    why = f"tolerance {tol:g}" if tol >= floor else f"{levels.source} of {floor:.1e} hide the rest"
    return count, f"{why}; {levels.following(count)}"


def _by_drop(levels: _Levels) -> tuple[int, str]:
    # Down to rounding: what falls at once to the noise stands out, and noise itself does not fall.
    heights = np.maximum(levels.values, levels.rounding)
    significant = max(1, levels.above(levels.rounding))
    drops = heights[:significant] / np.append(heights[1:], levels.rounding)[:significant]
    if significant == len(heights):
        drops = drops[:-1]  # the fall from the last value to rounding is no drop
    if np.any(drops >= DROP):
        count = int(np.argmax(drops)) + 1
        return count, f"drop point, {levels.following(count)}"
    count = max(1, levels.above(levels.floor))
    why = f"no drop point, every direction above {levels.source} of {levels.floor:.1e} is kept"
    return count, why
