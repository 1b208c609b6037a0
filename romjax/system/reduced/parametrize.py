"""From a system and a basis to a reduced system in minimal coordinates."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Float

from ...basis.basis import Basis
from ...basis.pod import pod
from ...basis.rank import FLOOR
from ...basis.snapshots import Recording, weigh
from ...basis.sod import sod
from ...basis.subspace import singular_values
from ..base import AbstractSystem
from ..doubt import Training
from .base import ReductionError, start
from .chart import WORST, Chart, choose_chart
from .minimal import MinimalSystem

# Snapshots that Newton's method may start from.
_GUESSES = 200


def minimal(system: AbstractSystem, basis: Basis, chart: Chart | None) -> MinimalSystem:
    """The system in a subspace of minimal coordinates.

    The snapshots are decomposed once more, as the basis was, but in the coordinates that are
    independent: a subspace of these holds the curvature of the mechanism's motion without modes
    of its own. Of a basis without snapshots, the modes are taken as they are.
    """
    recording = basis.recording
    if chart is None:
        chart = _choose(system, basis)
    slopes, metric = _at_start(system, chart, recording.t[0], recording.q[0])
    read = jnp.asarray(chart.read, metric.dtype)
    moved = recording.q - basis.offset[None]
    part = Recording(
        recording.t,
        moved @ read.T,
        recording.v @ read.T,
        recording.weights,
        metric,
        recording.noise,
        (),
    )
    if basis.kind == "given":
        root = jnp.linalg.cholesky(metric).T
        vectors, _ = jnp.linalg.qr(root @ read @ basis.modes)
        inner = jsl.solve_triangular(root, vectors)
    else:
        origin = jnp.zeros_like(metric[0])
        rank = min(basis.rank, _most(part, origin, basis.kind))
        inner = {"POD": pod, "SOD": sod}[basis.kind](part, rank, offset=origin).modes
    r, dual = inner.shape[1], inner.T @ metric @ read
    affine = chart.affine and bool(chart.rows)
    stride = len(recording.t) if affine else -(-len(recording.t) // _GUESSES)
    others = np.linalg.pinv(chart.bound) @ (np.eye(system.n) - chart.free @ chart.read)
    q, v = start(system, basis)
    return MinimalSystem(
        full=system,
        offset=basis.offset,
        modes=jnp.asarray(chart.free, metric.dtype) @ inner,
        dual=dual,
        near=moved[::stride] @ dual.T,
        guesses=moved[::stride] @ jnp.asarray(others.T, metric.dtype),
        inverse=jnp.linalg.inv(slopes) if affine else None,
        time=recording.t[0],
        q0=dual @ (q - basis.offset),
        v0=dual @ v,
        chart=chart,
        training=None if basis.kind == "given" else Training.of(moved @ dual.T, jnp.zeros(())),
        reason=f"{r} modes of {len(metric)} minimal coordinates, no constraints"
        + (f"; {basis.rank} modes were asked for" if r < basis.rank else ""),
    )


def _choose(system: AbstractSystem, basis: Basis) -> Chart:
    if any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves((system, basis))):
        raise ValueError(
            "reduce: under jit, grad or vmap say which coordinates are independent, such as "
            "chart=rom.chart of a reduced model that was made outside."
        )
    chart, condition, place = choose_chart(system, basis.recording)
    if condition <= WORST:
        return chart
    raise ReductionError(
        "reduce: no choice of independent coordinates holds over all snapshots. The best one has "
        f"a condition of {condition:.1e} at t = {float(basis.recording.t[place]):g} s, where the "
        'mechanism is near a singular position; use formulation="galerkin".'
    )


@eqx.filter_jit
def _at_start(
    system: AbstractSystem, chart: Chart, t: Float[Array, ""], q: Float[Array, " n"]
) -> tuple[Float[Array, "m m"], Float[Array, "d d"]]:
    """Coefficients of the dependent coordinates, and the metric of the minimal ones."""
    free, bound = jnp.asarray(chart.free, q.dtype), jnp.asarray(chart.bound, q.dtype)
    rows = system.jacobian(t, q)[np.array(chart.rows, int)]
    slopes = rows @ bound
    tangent = free - bound @ jnp.linalg.solve(slopes, rows @ free) if chart.rows else free
    return slopes, tangent.T @ system.momentum(q, tangent)


def _most(part: Recording, offset: Float[Array, " d"], kind: str) -> int:
    """How many directions the snapshots span above rounding; all, while JAX traces."""
    snapshots = weigh(part, offset)
    values = singular_values(snapshots.positions if kind == "POD" else snapshots.velocities)
    if isinstance(values, jax.core.Tracer):
        return len(values)
    return int(np.sum(np.asarray(values) > FLOOR[values.dtype] * values[0]))
