"""A reduced model of a chosen accuracy."""

import dataclasses
from collections.abc import Sequence

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from ..basis.basis import Basis
from ..basis.decomposition.pod import pod
from ..errors import ReductionError
from ..integrate.simulate import simulate
from ..integrate.trajectory import Trajectory
from ..reduction.base import AbstractReducedSystem
from ..reduction.reduce import reduce
from ..system.base import AbstractSystem
from .compare import compare
from .variation import begin, vary

# The next rank shows the error of this one up to a factor of two.
_SAFETY = 2.0
# The singular values that are left out may hold this share of the tolerance.
_TAIL = 0.2
# Runs of reduced models are more accurate than what is asked of them by this factor.
_SHARPER = 1e-3


@dataclasses.dataclass(frozen=True)
class _Model:
    rom: AbstractReducedSystem
    basis: Basis
    runs: list[Trajectory]  # one for each training run


def reduce_to(
    system: AbstractSystem,
    training: Trajectory,
    tol: float,
    *,
    variations: Sequence[AbstractSystem] = (),
    formulation: str = "galerkin",
    progress: bool = False,
) -> AbstractReducedSystem:
    """A reduced system whose runs err by at most `tol`, of the smallest rank that does.

    The rank goes up until the change from one rank to the next, a good estimate of the error, and
    the error on the training are half of `tol`, and the singular values that are left out hold a
    fifth of it. Then the model is tried on a variation it has not seen; if it fails, that run joins
    the training, and so on.

    **Arguments:**

    - `system`: the full system; `training`: a run of it, at a tolerance well below `tol`.
    - `tol`: relative error in the energy norm, as `Comparison.error`.
    - `variations`: systems of the same structure with other numbers: amplitudes, frequencies,
      starts. They are simulated in one batch, at the times of the training; the last is tried
      first, and each as often as needed.
    - `formulation`: "galerkin" or "minimal".
    - `progress`: show a progress bar.

    Returns the reduced system. Its `training` holds the estimated `error` and the box of the
    snapshots; a later run outside of it is flagged, see `Trajectory.doubts`. Its `reason` says in
    words what was done.

    Raises ReductionError if no rank is good enough, naming the best one.
    """
    if not 0 < tol < 1:
        raise ValueError(f"reduce_to: tol={tol}, but it must lie between 0 and 1.")
    if formulation not in ("galerkin", "minimal"):
        raise ReductionError(
            f'reduce_to: formulation={formulation!r}; it must be "galerkin" or "minimal".'
        )
    systems, truths = [system], [training]
    rest = list(variations)
    unseen = _simulate_all(rest, training) if rest else []
    held_out = None
    with tqdm(disable=not progress, unit=" models", desc="reduce_to") as bar:
        rank = 1
        while True:
            model, estimate, rank = _smallest(systems, truths, tol, formulation, rank, bar)
            if not rest:
                break
            held_out = _held_out(model, rest[-1], unseen[-1], tol)
            if held_out <= tol:
                break
            systems.append(rest.pop())
            truths.append(unseen.pop())
    error = max(estimate, held_out or 0.0)
    words = f"; estimated error {estimate:.1e} for tol {tol:g}, {len(truths)} training run" + (
        "s" if len(truths) > 1 else ""
    )
    if held_out is not None:
        words += f", {held_out:.1e} on the last variation tried" + (
            "" if rest else ", which then joined the training"
        )
    rom = eqx.tree_at(lambda r: r.training.error, model.rom, jnp.asarray(error))
    return dataclasses.replace(rom, reason=rom.reason + words)


def _smallest(
    systems: list[AbstractSystem],
    truths: list[Trajectory],
    tol: float,
    formulation: str,
    rank: int,
    bar: tqdm,
) -> tuple[_Model, float, int]:
    """The model of the smallest rank from `rank` on that is good enough, and its estimate."""
    most = min(truths[0].q.shape[1], sum(len(run.t) for run in truths))
    previous, best, refusal = None, np.inf, ""
    for r in range(rank, most + 1):
        bar.set_postfix_str(f"rank {r}")
        bar.update()
        try:
            basis = pod(truths, rank=r)
            rom = reduce(systems[0], basis, formulation)
            pairs = list(zip(systems, truths, strict=True))
            model = _Model(rom, basis, [])
            model.runs.extend(_run(model, s, run, tol) for s, run in pairs)
        except ValueError as error:  # a refused basis, or no more directions
            refusal = str(error)
            continue
        if previous is not None:
            estimate = max(_change(truths, previous, model), _error(truths, previous))
            best = min(best, estimate)
            # In minimal coordinates, the values of the physical ones say nothing.
            tail = float(previous.basis.projection_error) if formulation == "galerkin" else 0.0
            if estimate <= tol / _SAFETY and tail <= _TAIL * tol:
                return previous, estimate, previous.basis.rank
            if formulation == "minimal" and model.rom.n == previous.rom.n:
                break
        previous = model
    if previous is not None:
        # The largest model has no next one; the full one takes its place.
        estimate = _error(truths, previous)
        best = min(best, estimate)
        if estimate <= tol:
            return previous, estimate, previous.basis.rank
    raise ReductionError(
        f"reduce_to: no rank up to {most} reaches tol={tol:g}; "
        + (f"the best error is {best:.1e}. " if np.isfinite(best) else "")
        + (f"{refusal} " if refusal else "")
        + "Simulate the training run more accurately, ask for less"
        + ("." if formulation == "minimal" else ', or use formulation="minimal".')
    )


def _change(truths: list[Trajectory], coarse: _Model, fine: _Model) -> float:
    """‖q̃_{r+1} − q̃_r‖ relative to the motion, the largest of all training runs."""
    sizes = []
    for truth, one, other in zip(truths, coarse.runs, fine.runs, strict=True):
        root = jnp.linalg.cholesky(truth.metric)
        moved = jnp.linalg.norm((truth.q - truth.q[:1]) @ root)
        sizes.append(float(jnp.linalg.norm((one.q - other.q) @ root) / moved))
    return _finite(sizes)


def _error(truths: list[Trajectory], model: _Model) -> float:
    """The largest error of all training runs."""
    pairs = zip(truths, model.runs, strict=True)
    return _finite([float(compare(truth, run).error) for truth, run in pairs])


def _finite(errors: list[float]) -> float:
    """The largest; infinite where a run has failed."""
    return max(error if np.isfinite(error) else np.inf for error in errors)


def _run(model: _Model, system: AbstractSystem, truth: Trajectory, tol: float) -> Trajectory:
    """The reduced model of a system with other numbers, from the start of a run of it."""
    other = vary(model.rom, model.basis, system)
    q0, v0 = begin(other, truth.q[0], truth.v[0], truth.t[0])
    return simulate(
        other,
        truth.t,
        q0=q0,
        v0=v0,
        rtol=max(_SHARPER * tol, 1e-10),
        adjoint=diffrax.ForwardMode(),
        throw=False,
    )


def _held_out(model: _Model, system: AbstractSystem, truth: Trajectory, tol: float) -> float:
    """The error on a run that the model has not seen; infinite where it cannot even start."""
    try:
        return _finite([float(compare(truth, _run(model, system, truth, tol)).error)])
    except ValueError:
        return np.inf


def _simulate_all(systems: list[AbstractSystem], training: Trajectory) -> list[Trajectory]:
    """All variations in one batch, as accurately as the training."""
    arrays = [eqx.partition(system, eqx.is_array) for system in systems]
    if len({jax.tree.structure(static) for _, static in arrays}) > 1:
        raise ValueError(
            "reduce_to: the variations differ in structure; give systems assembled from one scene "
            "with other numbers."
        )
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *(dynamic for dynamic, _ in arrays))
    solver = {"Dopri8": diffrax.Dopri8()}.get(training.solver)

    def one(dynamic):  # type: ignore[no-untyped-def]
        return simulate(
            eqx.combine(dynamic, arrays[0][1]),
            training.t,
            rtol=training.stats.get("rtol", 1e-8),
            solver=solver,
            adjoint=diffrax.ForwardMode(),
            throw=False,
        )

    batch = eqx.filter_jit(eqx.filter_vmap(one))(stacked)
    runs = [jax.tree.map(lambda x, i=i: x[i], batch) for i in range(len(systems))]
    for i, run in enumerate(runs):
        if not bool(run.success):
            raise ValueError(f"reduce_to: variation {i} cannot be simulated: {run.reason()}.")
    return runs
