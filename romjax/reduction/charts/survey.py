"""The constraints of a mechanism along a motion."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from ...common.arrays import as_jax
from ...compiling.program import program_once
from ...system import unit_length
from ...system.base import AbstractSystem
from ...system.mobility import slopes_by_signals
from ...system.structure import COUNTER_INERTIA
from .chart import Chart

# Singular values of C_q below this share of the largest come from constraints that repeat others.
_REDUNDANT = 1e-9


class Survey(NamedTuple):
    """The constraints at some snapshots of a motion, in coordinates R q with RᵀR = M.

    q may be some of the coordinates alone. Each constraint is divided by the length of its row at
    one snapshot, so that no unit makes some of them large beside others.
    """

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


def survey(
    system: AbstractSystem,
    t: Float[Array, " h"],
    q: Float[Array, "h n"],
    count: int,
    of: np.ndarray | None = None,
) -> Survey:
    """The constraints at `count` of the snapshots t, q, spread evenly, as functions of all
    coordinates, or `of` those with these numbers.
    """
    numbers = np.linspace(0, len(t) - 1, min(count, len(t))).astype(int)
    t, q = np.asarray(t)[numbers], np.asarray(q)[numbers]
    own = np.arange(system.n) if of is None else of
    root = mass_root(system, as_jax(q[0]), own)
    scaled = np.asarray(jacobians(system, t, q))[:, :, own] @ np.linalg.inv(root)
    # The snapshot farthest from a singular position tells which constraints repeat others.
    farthest = np.argmax([np.linalg.svd(x, compute_uv=False)[-1] for x in scaled])
    lengths = np.linalg.norm(scaled[farthest], axis=1)
    scaled /= np.where(lengths > 0, lengths, 1)[:, None]
    typical = scaled[farthest]
    tol = _REDUNDANT * np.linalg.norm(typical, 2)
    rank = int(np.linalg.matrix_rank(typical, tol=tol))
    # The pivots of QR are the rows that are most independent of those before them.
    _, _, order = scipy.linalg.qr(typical.T, pivoting=True)
    rows = tuple(sorted(int(i) for i in order[:rank]))
    scaled = scaled[:, rows]
    # Right singular vectors beyond the rank are what C_q maps to zero.
    null_spaces = np.stack([scipy.linalg.svd(x)[2][rank:].T for x in scaled])
    return Survey(numbers, rows, scaled, null_spaces, root)


def mass_root(
    system: AbstractSystem, q: Float[Array, " n"], of: np.ndarray | slice = np.s_[:]
) -> np.ndarray:
    """R with RᵀR = M at a configuration, `of` some of the coordinates or of all."""
    return np.linalg.cholesky(np.asarray(mass_at(system, q))[of][:, of]).T


@program_once
def mass_at(system: AbstractSystem, q: Float[Array, " n"]) -> Float[Array, "n n"]:
    """The mass matrix at a configuration, with counters as heavy as the angles that they count."""
    counters = np.array(system.structure.counters, int)
    sizes = jnp.ones(system.n, q.dtype).at[counters].set(COUNTER_INERTIA**-0.5)
    return sizes[:, None] * system.mass(q) * sizes[None]


@program_once
def jacobians(
    system: AbstractSystem, t: Float[Array, " K"], q: Float[Array, "K n"]
) -> Float[Array, "K m n"]:
    """C_q at several configurations, with the rows of quaternions of unit length."""
    return jax.vmap(lambda t, q: unit_length.jacobian(system, t, q))(t, q)


@program_once
def violations(
    system: AbstractSystem, t: Float[Array, " K"], q: Float[Array, " n"]
) -> Float[Array, "K m"]:
    """C at several times in one configuration, with the lengths of quaternions."""
    return jax.vmap(lambda t: unit_length.extended(system, t, q))(t)


@program_once
def slopes(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"]
) -> Float[Array, "m k"]:
    """The derivatives of C, with the lengths of quaternions, by the values of all signals."""
    return slopes_by_signals(system, t, q)
