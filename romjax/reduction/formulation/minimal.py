"""Minimal coordinates: a subspace of those that the constraints leave independent."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Float

from ...basis.basis import Basis
from ...basis.subspace import leading, singular_values
from ...errors import ReductionError
from ...system.base import AbstractSystem
from ..atlas import Atlas, choose_atlas
from ..charts import WORST_CONDITION, Chart, choose_chart
from ..lift.atlas import AtlasLift
from ..lift.closed_form import ClosedFormLift
from ..lift.implicit import ImplicitLift
from ..system import ReducedSystem
from ..validity import TrainingBox
from .base import AbstractFormulation, start

# Snapshots that Newton's method may start from.
_GUESSES = 200
# Modes that are less independent than this, seen in the independent coordinates, are one.
_DEPENDENT = 1e-6


class Minimal(AbstractFormulation):
    """Gᵀ M G z̈ = Gᵀ (Q − M β): no constraints are left, since the lift satisfies them.

    The modes of the basis, read in the independent coordinates, span the subspace: it holds the
    curvature of the mechanism's motion without modes of its own, so modes that differ in dependent
    coordinates only count once. Where no choice of independent coordinates holds over all
    snapshots, all freedoms are taken in several charts, which the simulation changes on the way.

    **Arguments:**

    - `chart`: which coordinates are independent, that of another reduced model (`rom.lift.chart`);
      needed under jit and grad through the basis.
    """

    name: ClassVar[str] = "minimal"

    chart: Chart | Atlas | None = None

    def reduce(self, system: AbstractSystem, basis: Basis) -> ReducedSystem:
        """Raises ReductionError if the mechanism passes a singular position, or if a subspace would
        have to change charts.
        """
        chart = _choose(system, basis) if self.chart is None else self.chart
        if isinstance(chart, Atlas):
            return _in_atlas(system, basis, chart)
        metric = _metric(system, chart, basis)
        inner = _subspace(jnp.asarray(chart.read, metric.dtype) @ basis.modes, metric)
        count = 1 if chart.affine else _GUESSES
        domain = np.linspace(0, len(basis.snapshots.t) - 1, count).astype(int)
        lift = _lift(system, basis, chart, inner, metric, np.unique(domain))
        r = inner.shape[1]
        z = (basis.snapshots.q - basis.offset[None]) @ lift.dual.T
        q, v, time = start(system, basis)
        return ReducedSystem.of(
            system,
            lift,
            lift.restrict(system, q, v),
            time=time,
            validity=None if basis.decomposition is None else TrainingBox.of(z),
            summary=f"{r} modes of {len(metric)} minimal coordinates, no constraints"
            + (f"; {basis.rank} modes were asked for" if r < basis.rank else ""),
        )


def _in_atlas(system: AbstractSystem, basis: Basis, atlas: Atlas) -> ReducedSystem:
    freedoms = system.n - len(atlas.charts[0].rows)
    if basis.rank < freedoms:
        raise ReductionError(
            "reduce: no choice of independent coordinates holds over all snapshots, and between "
            f"several only all {freedoms} of them carry over, not {basis.rank} modes; take "
            f"rank={freedoms} or more, or formulation=romjax.Galerkin()."
        )
    unit = jnp.eye(freedoms, dtype=basis.modes.dtype)
    lifts = [
        _lift(system, basis, chart, unit, unit, domain)
        for chart, domain in zip(atlas.charts, atlas.domains, strict=True)
    ]
    snapshots = basis.snapshots
    root = jnp.linalg.cholesky(snapshots.metric).T
    lift = AtlasLift.of(lifts, snapshots.q, root, atlas)
    return ReducedSystem.of(
        system,
        lift,
        lift.restrict(system, snapshots.q[0], snapshots.v[0]),
        time=snapshots.t[0],
        validity=TrainingBox.of(lift.seen, root=root),
        summary=f"{freedoms} minimal coordinates in {len(lifts)} charts, no constraints",
    )


def _choose(system: AbstractSystem, basis: Basis) -> Chart | Atlas:
    if any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves((system, basis))):
        raise ValueError(
            "reduce: under jit, grad or vmap say which coordinates are independent, such as "
            "romjax.Minimal(chart=rom.lift.chart) of a reduced model that was made outside."
        )
    best = choose_chart(system, basis.snapshots)
    if best.condition <= WORST_CONDITION:
        return best.chart
    return choose_atlas(system, basis.snapshots)


def _lift(
    system: AbstractSystem,
    basis: Basis,
    chart: Chart,
    inner: Float[Array, "d r"],
    metric: Float[Array, "d d"],
    domain: np.ndarray,
) -> ClosedFormLift | ImplicitLift:
    """The lift on one chart; Newton's method starts from the snapshots of the `domain`."""
    dtype = metric.dtype
    dual = inner.T @ metric @ jnp.asarray(chart.read, dtype)
    others = np.eye(system.n) - chart.independent @ chart.read
    read_others = jnp.asarray(np.linalg.pinv(chart.dependent) @ others, dtype)
    t, moved = basis.snapshots.t[domain], basis.snapshots.q[domain] - basis.offset[None]
    guesses = moved @ read_others.T
    inverses = _inverses(system, chart, t, basis.snapshots.q[domain])
    if chart.affine:
        return ClosedFormLift(basis.offset, inner, dual, guesses[0], inverses[0], t[0], chart)
    modes = jnp.asarray(chart.independent, dtype) @ inner
    return ImplicitLift(basis.offset, modes, dual, moved @ dual.T, guesses, t, inverses, chart)


def _subspace(modes: Float[Array, "d r"], metric: Float[Array, "d d"]) -> Float[Array, "d k"]:
    """A basis of the span of modes, orthonormal in a metric, first along the first mode."""
    root = jnp.linalg.cholesky(metric).T
    weighted = root @ modes
    values, most = singular_values(weighted), min(modes.shape)
    if not isinstance(values, jax.core.Tracer):
        most = int(np.sum(np.asarray(values) > _DEPENDENT * float(values[0])))
    vectors, _ = leading(weighted, most)
    # A turn within the subspace is no matter of its derivative.
    turn, _ = jnp.linalg.qr(jax.lax.stop_gradient(vectors.T @ weighted)[:, :most])
    return jsl.solve_triangular(root, vectors @ turn)


@eqx.filter_jit
def _metric(system: AbstractSystem, chart: Chart, basis: Basis) -> Float[Array, "d d"]:
    """The mass matrix of the independent coordinates at the start."""
    t, q = basis.snapshots.t[0], basis.snapshots.q[0]
    independent = jnp.asarray(chart.independent, q.dtype)
    state = system.state(t, q, jnp.zeros_like(q))
    tangent = independent
    if chart.rows:
        dependent = jnp.asarray(chart.dependent, q.dtype)
        rows = chart.regular(state.jacobian())
        tangent -= dependent @ jnp.linalg.solve(rows @ dependent, rows @ independent)
    return tangent.T @ state.apply_mass(tangent)


@eqx.filter_jit
def _inverses(
    system: AbstractSystem, chart: Chart, t: Float[Array, " K"], q: Float[Array, "K n"]
) -> Float[Array, "K m m"]:
    """(C_q W)⁻¹ at snapshots."""
    rows = jax.vmap(lambda t, q: chart.dependent_jacobian(system, t, q))(t, q)
    return jnp.linalg.inv(rows)
