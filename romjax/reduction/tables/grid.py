"""The nodes of a table: configurations at equal steps of one or two coordinates."""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.errors import UnsuitedError
from ...compiling.program import program_once
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from ...system.constraints import differentiate
from ..charts.choose import WORST_CONDITION
from ..charts.survey import jacobians
from .frames import Frames, violations
from .interpolation import SIDE, evaluate, patches

# The order in which the error of accelerations between the nodes falls: polynomials of degree seven
# err by h⁸, and their second derivatives by h⁶. Where twice as many nodes do not halve it, rounding
# is what is left.
_ORDER = 6
# The most nodes by the number of freedoms: a table of two has eight times as many numbers for each
# node.
_MOST_NODES = {1: 2**14, 2: 2**12}
# Largest violation of the constraints, as a share of the coordinates, that Newton's method leaves.
CLOSED = 1e-9


class Goal(NamedTuple):
    """How well a table is to hold the constraints, and what is `enough` if nothing more helps."""

    tol: float
    enough: float


class Grid(NamedTuple):
    """Nodes along a curve or on a surface of configurations.

    - `nodes`: configurations. `along`: directions A at each of them, between which and the
      constraints the coordinates of a displacement are unique.
    - `steps`: of the coordinates s, which are zero at the first node.
    - `turn`: what one round of a closed curve adds to q, multiples of 2π for the angles of parts
      that go round; None if it is open. The first and last `SIDE` nodes of a closed curve, and one
      more, repeat others; s is zero at the first one that does not.
    """

    nodes: Float[Array, "*P n"]
    along: Float[Array, "*P n d"]
    steps: Float[Array, " d"]
    turn: Float[Array, " n"] | None

    @property
    def summary(self) -> str:
        """Describe the grid in words."""
        counts = self.inner().shape[:-1]
        if len(counts) == 2:
            return f"two freedoms on a surface of {counts[0]} × {counts[1]} nodes"
        kind = "an open" if self.turn is None else "a closed"
        return f"one freedom along {kind} curve of {counts[0]} nodes"

    def inner(self) -> Float[Array, "*N n"]:
        """The nodes at the beginnings of the intervals."""
        if self.turn is not None:
            return self.nodes[SIDE : -SIDE - 1]
        return self.nodes[(slice(-1),) * self.steps.size]

    def in_a_row(self) -> tuple[Float[Array, "K n"], Float[Array, "K n d"]]:
        """The nodes and their directions, one after the other."""
        n, d = self.along.shape[-2:]
        return self.nodes.reshape(-1, n), self.along.reshape(-1, n, d)

    def polynomials(self, values: Float[Array, "P *c"]) -> Float[Array, "..."]:
        """Coefficients (*N, *p, c) on the intervals, of values at the nodes in one row."""
        values = values.reshape(*self.nodes.shape[:-1], -1)
        return patches(values, self.steps.size, self.turn is not None)


@program_once
def curvature_errors(
    system: AbstractSystem, frames: Frames, grid: Grid
) -> Float[Array, "*N ways M"]:
    """C̈ halfway between the nodes, of motions along and across the coordinates at unit speed."""
    d, dtype = grid.steps.size, grid.nodes.dtype
    coefficients = grid.polynomials(grid.nodes)
    ways = jnp.asarray([[1]] if d == 1 else [[1, 0], [0, 1], [1, 1]], dtype)

    def one(coefficients: Array, way: Array) -> Array:
        # Between the nodes, where interpolation errs most: at the middle of each cell.
        q, slopes, bends = evaluate(coefficients, jnp.full(d, 0.5, dtype))
        rates = way / grid.steps
        v = multiply(rates, slopes)
        # The speed is one in the kinetic energy, so that errors are accelerations at a speed that
        # is the same everywhere.
        energy = multiply(v, multiply(frames.metric, v))
        a = jnp.einsum("i,j,ijn->n", rates, rates, bends)
        v, a = v / jnp.sqrt(energy), a / energy
        return differentiate(system.constraint, frames.time, q, v, a).curvature

    every = jax.vmap(one, (None, 0))
    for _ in range(d):
        every = jax.vmap(every, (0, None))
    return every(coefficients, ways)


def refined(
    system: AbstractSystem,
    frames: Frames,
    make: Callable[[int], Grid],
    count: int,
    goal: Goal,
    multiple: int = 1,
    margin: float = 0.0,
) -> Grid:
    """The grid of about the fewest nodes, of which `make` takes the number in each direction and
    `count` is the first, at which the constraints hold halfway between them as well as the `goal`
    says; else the best of all, if that is enough.

    Numbers are multiples of `multiple`; errors do not count in a `margin` at both ends, a share of
    the whole width. Raises UnsuitedError where more nodes do not help, and for
    a grid that a table cannot hold.
    """
    tried, nodes, error, least = 0, 0, np.inf, np.inf
    best: Grid | None = None
    while error > goal.tol and count**frames.freedoms <= _MOST_NODES[frames.freedoms]:
        grid = make(count)
        errors = np.asarray(curvature_errors(system, frames, grid))
        judged = slice(math.floor(margin * count), count - math.floor(margin * count))
        last, error = error, float(np.max(np.abs(errors[(judged,) * frames.freedoms])))
        if error < least:
            least, best, nodes = error, grid, count**frames.freedoms
        doubled, tried = count >= 2 * tried > 0, count
        if doubled and error > last / 2:
            break
        # The order of the error tells how many more nodes are needed, and a tenth is added.
        more = min(2.0, 1.1 * (error / goal.tol) ** (1 / _ORDER))
        count = multiple * math.ceil(more * count / multiple)
    if best is not None and least <= goal.enough:
        check(system, frames, *best.in_a_row())
        return best
    raise UnsuitedError(
        f"reduce: a table of {nodes} nodes violates the constraints by {least:.1e}, more than "
        f"tol={goal.tol:g}, and more of them do not help; take tol={1.1 * least:.1e}, which it "
        "holds."
    )


def check(
    system: AbstractSystem,
    frames: Frames,
    q: Float[Array, "K n"],
    along: Float[Array, "K n d"],
) -> None:
    """Raise UnsuitedError for configurations and directions that no table holds: where the
    constraints change with time, or come to a singular position.
    """
    now = np.asarray(violations(system, frames.time, q))
    # These two have no period in common: a drive that is back after one is not after the other.
    for later in (1.0, np.e):
        if np.max(np.abs(violations(system, frames.time + later, q) - now)) > CLOSED:
            raise UnsuitedError(
                "reduce: the constraints change with time, so that a table of configurations "
                "does not hold."
            )
    free, rows = np.array(frames.numbers), np.array(frames.rows)
    block = np.asarray(jacobians(system, jnp.full(len(q), frames.time), q))[:, rows][:, :, free]
    root = np.linalg.cholesky(np.asarray(frames.metric)[np.ix_(free, free)])
    scaled = block @ np.linalg.inv(root).T
    directions = np.swapaxes(np.asarray(along)[:, free], 1, 2) @ root
    # The constraints have to determine what the directions leave.
    complement = np.linalg.qr(np.swapaxes(directions, 1, 2), "complete")[0][:, :, along.shape[2] :]
    worst = np.max(np.linalg.cond(scaled @ complement))
    # Where two branches of configurations cross, the orientation changes.
    signs = np.sign(np.linalg.det(np.concatenate([scaled, directions], axis=1)))
    if not worst <= WORST_CONDITION or np.any(signs != signs[0]):
        raise UnsuitedError(
            "reduce: the mechanism passes a singular position, where its configurations branch "
            "and no table leads on."
        )
