"""How many modes: by number, by tolerance, or by the drop point."""

from typing import NamedTuple

import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

Rank = int | str  # a number of modes, or "drop"

# A drop point is a fall by two decades. The values of a falling chain of bars decrease by 2 to 20
# at each step, all the way to rounding: they have none.
DROP = 100.0


class Choice(NamedTuple):
    """A rank and why."""

    rank: int
    reason: str


def choose_rank(
    name: str,
    values: Float[Array, " k"],
    rank: Rank | None,
    tol: float | None,
    snapshots: int,
) -> Choice:
    """Choose from singular values, largest first; without `rank` and `tol`, the drop point.

    Directions below the rounding errors of the snapshots never count. While JAX traces, only a
    number is possible, since the rank shapes all that follows.
    """
    if rank is not None and tol is not None:
        raise ValueError(f"{name}: give rank={rank} or tol={tol}, not both.")
    found = None if isinstance(values, Tracer) else np.asarray(values)
    if found is None:
        if not isinstance(rank, int):
            raise ValueError(
                f"{name}: under jit, grad or vmap the rank must be a number, such as rank=5; "
                "find it first, outside."
            )
        return Choice(_in_range(name, rank, len(values), snapshots), f"rank {rank}: as asked")
    if not np.all(np.isfinite(found)):
        raise ValueError(f"{name}: the snapshots are not finite; did the simulation succeed?")
    if not found[0] > 0:
        raise ValueError(
            f"{name}: the snapshots do not move, so no direction stands out; simulate a motion."
        )
    relative = found / found[0]
    floor = 4 * np.finfo(found.dtype).eps * np.sqrt(max(len(found), snapshots))
    significant = int(np.sum(relative > floor))
    if isinstance(rank, int):
        _in_range(name, rank, len(found), snapshots)
        if rank > significant:
            raise ValueError(
                f"{name}: rank={rank}, but the snapshots span only {significant} directions above "
                f"rounding (the next value is {relative[significant]:.1e} of the largest); "
                f"ask for at most {significant}, or simulate a richer motion."
            )
        return Choice(rank, f"rank {rank}: as asked; the next value is {_next(relative, rank)}")
    if tol is not None:
        if not 0 < tol < 1:
            raise ValueError(f"{name}: tol={tol}, but it must lie between 0 and 1.")
        count = int(np.sum(relative > max(tol, floor)))
        why = f"tolerance {tol:g}" if tol >= floor else f"rounding floor {floor:.1e}"
        return Choice(count, f"rank {count}: {why}; the next value is {_next(relative, count)}")
    if rank not in (None, "drop"):
        raise ValueError(f'{name}: rank={rank!r}; give a whole number or "drop".')
    # Where all values are significant, the fall from the last one to rounding is no drop.
    above = np.maximum(relative[: significant + 1], floor)
    drops = above[:-1] / above[1:]
    if not np.any(drops >= DROP):
        return Choice(significant, f"rank {significant}: no drop point, every direction is kept")
    count = int(np.argmax(drops)) + 1
    return Choice(count, f"rank {count}: drop point, the next value is {_next(relative, count)}")


def _next(relative: np.ndarray, rank: int) -> str:
    return f"{relative[rank]:.1e} of the largest" if rank < len(relative) else "none"


def _in_range(name: str, rank: int, n: int, snapshots: int) -> int:
    most = min(n, snapshots)
    if not 1 <= rank <= most:
        raise ValueError(
            f"{name}: rank={rank}, but {snapshots} snapshots of {n} coordinates allow 1 to {most}."
        )
    return rank
