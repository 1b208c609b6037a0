"""How many modes: by number, by tolerance, or by the drop point."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

Rank = int | str  # a number of modes, or "drop"

# A drop point is a fall by two decades. The values of a falling chain of bars decrease by 2 to 20
# at each step, all the way to rounding: they have none.
DROP = 100.0

# Directions below this share of the largest one are rounding, whatever the number of snapshots.
FLOOR = {jnp.dtype("float64"): 1e-12, jnp.dtype("float32"): 1e-6}


class Choice(NamedTuple):
    """A rank and why; `floor` and `tol` are relative to the largest value."""

    rank: int
    reason: str
    floor: Float[Array, ""]  # directions below are noise
    tol: float | None  # what was asked for


def choose_rank(
    name: str,
    values: Float[Array, " k"],
    rank: Rank | None,
    tol: float | None,
    rounding: float,
    noise: Float[Array, ""],
) -> Choice:
    """Choose from singular values, largest first; without `rank` and `tol`, the drop point.

    Directions below `rounding` (relative to the largest value) never count, and ones below the
    `noise` of the integration (absolute) only where they are asked for by number. While JAX traces,
    only a number is possible, since the rank shapes all that follows.
    """
    if rank is not None and tol is not None:
        raise ValueError(f"{name}: give rank={rank} or tol={tol}, not both.")
    if isinstance(rank, int) and not 1 <= rank <= len(values):
        raise ValueError(
            f"{name}: rank={rank}, but the snapshots allow 1 to {len(values)}: no more than there "
            "are coordinates, and no more than there are snapshots."
        )
    floor = jnp.maximum(rounding, noise / values[0])
    if any(isinstance(x, Tracer) for x in (values, noise)):
        if not isinstance(rank, int):
            raise ValueError(
                f"{name}: under jit, grad or vmap the rank must be a number, such as rank=5; "
                "find it first, outside."
            )
        return Choice(rank, f"rank {rank}: as asked", floor, None)
    found = np.asarray(values)
    if not np.all(np.isfinite(found)):
        raise ValueError(f"{name}: the snapshots are not finite; did the simulation succeed?")
    if not found[0] > 0:
        raise ValueError(
            f"{name}: the snapshots do not move, so no direction stands out; simulate a motion."
        )
    relative = found / found[0]
    count, why = _count(name, relative, rank, tol, rounding, float(floor))
    return Choice(count, f"rank {count}: {why}", floor, tol)


def _count(
    name: str,
    relative: np.ndarray,
    rank: Rank | None,
    tol: float | None,
    rounding: float,
    floor: float,
) -> tuple[int, str]:
    """The rank and why, from values relative to the largest."""
    what = "rounding" if floor <= rounding else "integration errors"
    certain = int(np.sum(relative > floor))
    if isinstance(rank, int):
        significant = int(np.sum(relative > rounding))
        if rank > significant:
            raise ValueError(
                f"{name}: rank={rank}, but the snapshots span only {significant} directions above "
                f"rounding (the next value is {relative[significant]:.1e} of the largest); "
                f"ask for at most {significant}, or simulate a richer motion."
            )
        why = "as asked" + (
            f", {rank - certain} of them below {what} of {floor:.1e}" if rank > certain else ""
        )
        return rank, f"{why}; the next value is {_next(relative, rank)}"
    if tol is not None:
        if not 0 < tol < 1:
            raise ValueError(f"{name}: tol={tol}, but it must lie between 0 and 1.")
        count = max(1, int(np.sum(relative > max(tol, floor))))
        why = f"tolerance {tol:g}" if tol >= floor else f"{what} of {floor:.1e} hide the rest"
        return count, f"{why}; the next value is {_next(relative, count)}"
    if rank not in (None, "drop"):
        raise ValueError(f'{name}: rank={rank!r}; give a whole number or "drop".')
    # Down to rounding: what falls at once to the noise stands out, and noise itself does not fall.
    above = np.maximum(relative, rounding)
    significant = max(1, int(np.sum(relative > rounding)))
    drops = above[:significant] / np.append(above[1:], rounding)[:significant]
    if significant == len(relative):
        drops = drops[:-1]  # the fall from the last value to rounding is no drop
    if not np.any(drops >= DROP):
        count = max(1, certain)
        return count, f"no drop point, every direction above {what} of {floor:.1e} is kept"
    count = int(np.argmax(drops)) + 1
    return count, f"drop point, the next value is {_next(relative, count)}"


def _next(relative: np.ndarray, rank: int) -> str:
    return f"{relative[rank]:.1e} of the largest" if rank < len(relative) else "none"
