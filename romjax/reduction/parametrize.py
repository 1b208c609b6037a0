"""From a system and a basis to a reduced system in minimal coordinates."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Float

from ..basis.basis import Basis
from ..basis.decomposition.base import AbstractDecomposition
from ..basis.snapshots import SnapshotSet, weigh
from ..errors import ReductionError
from ..system.base import AbstractSystem
from .atlas import Atlas, AtlasSystem, choose_atlas
from .base import start
from .chart import WORST, Chart, choose_chart
from .minimal import MinimalSystem
from .validity import Training

# Snapshots that Newton's method may start from.
_GUESSES = 200


def minimal(
    system: AbstractSystem, basis: Basis, chart: Chart | Atlas | None
) -> MinimalSystem | AtlasSystem:
    """The system in a subspace of minimal coordinates, or where one choice of them does not hold
    over all snapshots, in all of them by several charts.
    """
    if chart is None:
        chart = _choose(system, basis)
    if isinstance(chart, Chart):
        return _in_chart(system, basis, chart)
    pairs = zip(chart.charts, chart.domains, strict=True)
    parts = [_in_chart(system, basis, one, domain) for one, domain in pairs]
    freedoms = system.n - len(chart.charts[0].rows)
    if basis.rank < freedoms:
        raise ReductionError(
            "reduce: no choice of independent coordinates holds over all snapshots, and between "
            f"several only all {freedoms} of them carry over, not {basis.rank} modes; take "
            f'rank={freedoms} or more, or formulation="galerkin".'
        )
    reason = f"{freedoms} minimal coordinates in {len(parts)} charts, no constraints"
    return AtlasSystem.of(parts, chart, basis.snapshots, reason)


def _in_chart(
    system: AbstractSystem, basis: Basis, chart: Chart, domain: np.ndarray | None = None
) -> MinimalSystem:
    """The system in one chart; Newton's method starts from the snapshots of its domain.

    The snapshots are decomposed once more, as the basis was, but in the coordinates that are
    independent: a subspace of these holds the curvature of the mechanism's motion without modes
    of its own. Of a basis without snapshots, the modes are taken as they are; in one of several
    charts, all coordinates are.
    """
    recording = basis.snapshots
    metric = _metric(system, chart, recording.t[0], recording.q[0])
    read = jnp.asarray(chart.read, metric.dtype)
    moved = recording.q - basis.offset[None]
    part = SnapshotSet(
        recording.t,
        moved @ read.T,
        recording.v @ read.T,
        recording.weights,
        metric,
        recording.noise,
        (),
    )
    if domain is not None:
        inner = jnp.eye(len(metric), dtype=metric.dtype)
        metric = inner
    elif basis.decomposition is None:
        root = jnp.linalg.cholesky(metric).T
        vectors, _ = jnp.linalg.qr(root @ read @ basis.modes)
        inner = jsl.solve_triangular(root, vectors)
    else:
        origin = jnp.zeros_like(metric[0])
        rank = min(basis.rank, _most(part, origin, basis.decomposition))
        inner = basis.decomposition.with_rank(rank, origin)(part).modes
    r, dual = inner.shape[1], inner.T @ metric @ read
    if domain is None:
        count = 1 if chart.affine else min(_GUESSES, len(recording.t))
        domain = np.linspace(0, len(recording.t) - 1, count).astype(int)
    others = np.linalg.pinv(chart.bound) @ (np.eye(system.n) - chart.free @ chart.read)
    q, v = start(system, basis)
    return MinimalSystem(
        full=system,
        offset=basis.offset,
        inner=inner,
        modes=jnp.asarray(chart.free, metric.dtype) @ inner,
        dual=dual,
        near=moved[domain] @ dual.T,
        guesses=moved[domain] @ jnp.asarray(others.T, metric.dtype),
        inverses=_inverses(system, chart, recording.t[domain], recording.q[domain]),
        time=recording.t[0],
        q0=dual @ (q - basis.offset),
        v0=dual @ v,
        chart=chart,
        training=basis.decomposition and Training.of(moved @ dual.T, jnp.zeros(())),
        reason=f"{r} modes of {len(metric)} minimal coordinates, no constraints"
        + (f"; {basis.rank} modes were asked for" if r < basis.rank else ""),
    )


def _choose(system: AbstractSystem, basis: Basis) -> Chart | Atlas:
    if any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves((system, basis))):
        raise ValueError(
            "reduce: under jit, grad or vmap say which coordinates are independent, such as "
            "chart=rom.chart of a reduced model that was made outside."
        )
    found = choose_chart(system, basis.snapshots)
    return found.chart if found.condition <= WORST else choose_atlas(system, basis.snapshots)


@eqx.filter_jit
def _metric(
    system: AbstractSystem, chart: Chart, t: Float[Array, ""], q: Float[Array, " n"]
) -> Float[Array, "d d"]:
    """The metric of the minimal coordinates."""
    free, bound = jnp.asarray(chart.free, q.dtype), jnp.asarray(chart.bound, q.dtype)
    rows = system.jacobian(t, q)[np.array(chart.rows, int)]
    tangent = free - bound @ jnp.linalg.solve(rows @ bound, rows @ free) if chart.rows else free
    return tangent.T @ system.momentum(q, tangent)


@eqx.filter_jit
def _inverses(
    system: AbstractSystem, chart: Chart, t: Float[Array, " K"], q: Float[Array, "K n"]
) -> Float[Array, "K m m"]:
    """Those of the coefficients of the dependent coordinates."""
    rows = jax.vmap(system.jacobian)(t, q)[:, np.array(chart.rows, int)]
    return jnp.linalg.inv(rows @ jnp.asarray(chart.bound, q.dtype))


def _most(
    part: SnapshotSet, offset: Float[Array, " d"], decomposition: AbstractDecomposition
) -> int:
    """How many directions the snapshots span above rounding; all, while JAX traces."""
    values, rounding, _ = decomposition.criterion(weigh(part, offset))
    if isinstance(values, jax.core.Tracer):
        return len(values)
    return int(np.sum(np.asarray(values) > rounding * values[0]))
