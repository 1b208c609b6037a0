"""Minimal coordinates: a subspace of those that the constraints leave independent."""

import dataclasses
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...basis.basis import AbstractDecomposition, Basis
from ...basis.passed import passed
from ...basis.snapshots import Motions, SnapshotSet
from ...basis.subspace import span
from ...common import compat
from ...common.arrays import as_jax, namespace, pick, untraced
from ...common.errors import ReductionError, UnsuitedError
from ...compiling.program import program_once
from ...linalg.branches import inverted
from ...system.base import AbstractSystem
from ...system.validity import TrainingBox
from ..charts.atlas import Atlas, choose_atlas
from ..charts.chart import Chart
from ..charts.choose import WORST_CONDITION, choose_chart
from ..charts.follow import Way
from ..charts.guesses import with_way
from ..charts.survey import mass_at
from ..lift.atlas import AtlasLift
from ..lift.closed_form import ClosedFormLift
from ..lift.implicit import ImplicitLift
from ..system import ReducedSystem
from .base import AbstractFormulation, start

# Configurations that Newton's method may start from.
_GUESSES = 200


class Minimal(AbstractFormulation):
    """Gᵀ M G z̈ = Gᵀ (Q − M β): no constraints are left, since the lift satisfies them.

    The modes of the basis, read in the independent coordinates, span the subspace: it holds the
    curvature of the mechanism's motion without modes of its own, so modes that differ in dependent
    coordinates only count once. Where no choice of independent coordinates holds over all
    snapshots, all freedoms are taken in several charts, which the simulation changes on the way.
    Without freedom, where drives prescribe the whole motion, no coordinate is left: the model is
    kinematics, C(t, q) = 0 solved from the nearest snapshot, whose accelerations give the forces.

    **Arguments:**

    - `chart`: which coordinates are independent, that of another reduced model (`rom.lift.chart`);
      needed under jit and grad through the basis.
    """

    name: ClassVar[str] = "minimal"
    in_subspace: ClassVar[bool] = False
    # Along the tangent at the start; elsewhere errors of dependent coordinates may be smaller.
    most_missed: ClassVar[float] = 2.0
    is_general: ClassVar[bool] = True

    chart: Chart | Atlas | None = None

    def basis(
        self, system: AbstractSystem, motion: Motions, decomposition: AbstractDecomposition
    ) -> Basis:
        """The decomposition of the independent coordinates s alone, since the others follow: of
        q₀ + T s with the tangent T at the first snapshot, without the curvature of the mechanism.
        """
        snapshots = SnapshotSet.of(motion).of_unit_length(system.structure.quaternions)
        chart, _ = _choose(system, snapshots, self.chart)
        if isinstance(chart, Atlas) or not chart.independent.size:
            return decomposition(snapshots)
        tangent = chart.tangent(system, pick(snapshots.t, 0), pick(snapshots.q, 0))
        onto, read = untraced(tangent, chart.read)
        basis = decomposition(snapshots.mapped(as_jax(onto @ read.astype(tangent.dtype))))
        return dataclasses.replace(basis, snapshots=snapshots)

    def reduce(self, system: AbstractSystem, basis: Basis) -> ReducedSystem:
        """Raises ReductionError if the mechanism passes a singular position, if a subspace would
        have to change charts, or if there are neither freedoms nor snapshots.
        """
        basis = basis.of_unit_length(system.structure.quaternions)
        snapshots = basis.snapshots
        chart, way = _choose(system, snapshots, self.chart)
        if isinstance(chart, Atlas):
            return _in_atlas(system, basis, chart)
        metric = chart.metric(system, pick(snapshots.t, 0), pick(snapshots.q, 0))
        read, modes = untraced(chart.read, basis.modes)
        inner = span(as_jax(read.astype(metric.dtype) @ modes), metric) if len(metric) else metric
        # Without freedom, Newton's method only follows the drives.
        t, q = (snapshots.t, snapshots.q) if way is None else (as_jax(way.t), as_jax(way.q))
        count = 1 if chart.affine else _GUESSES if len(metric) else len(t)
        if not len(metric) and basis.decomposition is None:
            raise ReductionError(
                "reduce: joints and drives prescribe the whole motion, which modes of one's own do "
                "not show; give a basis of a run, as rj.pod(run) is."
            )
        domain = np.unique(np.linspace(0, len(t) - 1, count).astype(int))
        guesses = pick(t, domain), pick(q, domain)
        lift = _lift(system, basis, chart, inner, metric, guesses)
        validity = None
        if basis.decomposition is not None:
            validity = _box(snapshots.t, passed(snapshots), basis.offset, lift.dual)
        r = inner.shape[1]
        summary = f"{r} modes of {len(metric)} minimal coordinates, no constraints"
        if not r:
            summary = "no freedom: joints and drives prescribe the motion, no constraints"
        elif r < basis.rank:
            summary += f"; {basis.rank} modes were asked for"
        given = None, validity, summary, snapshots.turns
        return ReducedSystem.of(system, lift, start(system, basis), *given)


def _in_atlas(system: AbstractSystem, basis: Basis, atlas: Atlas) -> ReducedSystem:
    freedoms = system.n - len(atlas.charts[0].rows)
    if basis.rank < freedoms:
        raise UnsuitedError(
            "reduce: no choice of independent coordinates holds over all snapshots, and between "
            f"several only all {freedoms} of them carry over, not {basis.rank} modes; take "
            f"rank={freedoms} or more."
        )
    unit = as_jax(np.eye(freedoms, dtype=basis.modes.dtype))
    lifts = []
    for chart, domain in zip(atlas.charts, atlas.domains, strict=True):
        guesses = pick(basis.snapshots.t, domain), pick(basis.snapshots.q, domain)
        one = _lift(system, basis, chart, unit, unit, guesses)
        assert isinstance(one, ImplicitLift)  # a chart in closed form needs no others
        lifts.append(one)
    snapshots = basis.snapshots
    (metric,) = untraced(mass_at(system, pick(snapshots.q, 0)))
    root = as_jax(namespace(metric).linalg.cholesky(metric).T)
    lift = AtlasLift.of(lifts, snapshots.q, root, atlas)
    validity = TrainingBox.of(lift.seen, root=root)
    summary = f"{freedoms} minimal coordinates in {len(lifts)} charts, no constraints"
    given = None, validity, summary, snapshots.turns
    return ReducedSystem.of(system, lift, start(system, basis), *given)


def _choose(
    system: AbstractSystem, snapshots: SnapshotSet, given: Chart | Atlas | None
) -> tuple[Chart | Atlas, Way | None]:
    """The chart, and the way through the snapshots in it where these are far apart."""
    if given is not None:
        return given, None
    t, q = snapshots.t, snapshots.q
    if any(compat.is_traced(x) for x in jax.tree.leaves((system, t, q))):
        raise ValueError(
            "reduce: under jit, grad or vmap say which coordinates are independent, such as "
            "romjax.Minimal(chart=rom.lift.chart) of a reduced model that was made outside."
        )
    best = choose_chart(system, t, q)
    if best.condition <= WORST_CONDITION:
        return best.chart, best.way
    return choose_atlas(system, t, q), None


def _lift(
    system: AbstractSystem,
    basis: Basis,
    chart: Chart,
    inner: Float[Array, "d r"],
    metric: Float[Array, "d d"],
    guesses: tuple[Float[Array, " K"], Float[Array, "K n"]],
) -> ClosedFormLift | ImplicitLift:
    """The lift on one chart; Newton's method starts from the `guesses` t, q."""
    others = None
    if not chart.affine:
        # The dependent coordinates of a displacement.
        left_out = np.eye(system.n) - chart.independent @ chart.read
        others = as_jax(np.linalg.pinv(chart.dependent) @ left_out)
    lift = _lift_from(system, *guesses, basis.offset, chart, inner, metric, others)
    # The chart keeps its own arrays, which no transformation traces.
    return dataclasses.replace(lift, chart=chart)


@program_once
def _lift_from(
    system: AbstractSystem,
    t: Float[Array, " K"],
    q: Float[Array, "K n"],
    offset: Float[Array, " n"],
    chart: Chart,
    inner: Float[Array, "d r"],
    metric: Float[Array, "d d"],
    others: Float[Array, "m n"] | None,
) -> ClosedFormLift | ImplicitLift:
    dtype = metric.dtype
    dual = inner.T @ metric @ jnp.asarray(chart.read, dtype)
    displacements = q - offset[None]
    if chart.affine:
        guess = displacements[0] @ jnp.asarray(chart.dependent, dtype)
        inverse = inverted(chart.dependent_matrix(system, t[0], q[0]), chart.forest)
        return ClosedFormLift(offset, inner, dual, guess, inverse, t[0], chart)
    assert others is not None
    modes = jnp.asarray(chart.independent, dtype) @ inner
    z, guesses = displacements @ dual.T, displacements @ others.astype(dtype).T
    inverses = chart.dependent_inverses(system, t, q)
    drives = jax.vmap(lambda t, q: chart.drives(system, t, q))(t, q)
    # The rate at which drives alone move d is (C_q W)⁻¹ C_t, here in the mean square.
    pace = jnp.sqrt(jnp.mean(jnp.sum(jnp.einsum("kij,kj->ki", inverses, drives) ** 2, axis=1)))
    known = with_way(z), with_way(guesses), with_way(t), with_way(inverses)
    return ImplicitLift(offset, modes, dual, *known, pace, chart)


@program_once
def _box(
    t: Float[Array, " h"],
    q: Float[Array, "k n"],
    offset: Float[Array, " n"],
    dual: Float[Array, "r n"],
) -> TrainingBox:
    """The box of snapshots in the minimal coordinates, or in time where there are none."""
    return TrainingBox.of((q - offset[None]) @ dual.T if len(dual) else t[:, None])
