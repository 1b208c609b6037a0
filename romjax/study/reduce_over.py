"""One reduced model for all mechanisms of a box of parameters."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from tqdm import tqdm

from ..arrays import as_array, as_number
from ..errors import InputError, ReductionError
from ..integrate.simulate import simulate
from ..program import program
from ..reduction.formulation.base import AbstractFormulation
from ..reduction.formulation.parse import as_formulation
from ..system.base import AbstractSystem, Run
from ..system.reduced import AbstractReducedSystem
from .batch import simulate_all, stacked
from .box import Box
from .estimate import run_and_change
from .rank_search import SAFETY, Accepted, RankSearch, held_out_error, sharper
from .reduced_box import ReducedBox


def reduce_over(
    box: Box,
    ts: ArrayLike,
    tol: float,
    *,
    formulation: AbstractFormulation | str = "minimal",
    runs: int = 6,
    candidates: int = 64,
    held_out: int = 16,
    seed: int = 0,
    progress: bool = False,
) -> ReducedBox:
    """A reduced model whose runs err by at most `tol` for all mechanisms of a box.

    The first training run is that in the middle. The error at the candidates is estimated by the
    change from one rank to the next, without full runs; the mechanism with the largest one joins
    the training while that is above half of `tol`, and so does the worst of the held-out runs where
    one errs by more than `tol`: a greedy search (Veroy, Prud'homme, Rovas, Patera 2003,
    doi:10.2514/6.2003-3847).

    **Arguments:**

    - `box`: the mechanisms. `ts` (k,): times of the runs [s].
    - `tol`: relative error in the energy norm, as `Comparison.error`.
    - `formulation`: "minimal", "local" or "galerkin", by name or as an object.
    - `runs`: the most training runs. `candidates`: points of the box, its corners among them, at
      which the error is estimated. `held_out`: others at which it is measured, by full runs, in one
      batch.
    - `seed`: of the points. `progress`: show a progress bar.

    Raises ReductionError if `runs` training runs are not enough, with the error reached; InputError
    for numbers without meaning.
    """
    if not 0 < tol < 1:
        raise InputError(f"reduce_over: tol={tol}, but it must lie between 0 and 1.")
    if runs < 1 or candidates < 1 or held_out < 0:
        raise InputError(
            f"reduce_over: runs={runs}, candidates={candidates}, held_out={held_out}; take at "
            "least one run, one candidate, and no negative number."
        )
    points = _points(box, candidates, held_out, seed)
    greedy = _Greedy(box, points, candidates, as_array(ts), tol, as_formulation(formulation))
    with tqdm(disable=not progress, unit=" models", desc="reduce_over") as bar:
        accepted = greedy.search.smallest(1, bar)
        while (worst := greedy.worst(accepted)) is not None:
            count = len(greedy.search.systems)
            if count == runs:
                raise ReductionError(
                    f"reduce_over: {runs} training runs reach an error of {greedy.error:.1e}, not "
                    f"tol={tol:g}; allow more runs, a smaller box or a larger tol."
                )
            greedy.train(worst)
            accepted = greedy.search.smallest(accepted.candidate.basis.rank, bar)
    return greedy.result(accepted)


def _points(box: Box, candidates: int, held_out: int, seed: int) -> dict[str, np.ndarray]:
    """The candidates, then the points held out.

    Errors are largest, and motions reach farthest, in corners of the box as a rule: these come
    first, unless they are more than half of the candidates.
    """
    corners = 2 ** len(box.ranges)
    corners = corners if 2 * corners <= candidates else 0
    within = box.sample(candidates - corners + held_out, seed)
    if not corners:
        return within
    return {name: np.concatenate([x, within[name]]) for name, x in box.corners().items()}


class _Greedy:
    """Training runs that are chosen one by one, from `points` of a box, of which the first ones are
    the `candidates`, and the others held out.
    """

    def __init__(
        self,
        box: Box,
        points: dict[str, np.ndarray],
        candidates: int,
        times: Float[Array, " k"],
        tol: float,
        formulation: AbstractFormulation,
    ):
        self.box, self.points, self.candidates = box, points, candidates
        self.times, self.tol = times, tol
        rows = zip(*points.values(), strict=True)
        self.systems = [box.system(**dict(zip(points, row, strict=True))) for row in rows]
        middle = box.system()
        first = simulate(middle, times, rtol=_accurate(tol))
        self.search = RankSearch("reduce_over", [middle], [first], tol, formulation)
        self.trained = [box.center]
        unseen = self.systems[candidates:]
        truths = simulate_all("reduce_over", unseen, first) if unseen else []
        # By the numbers of their points; what joins the training is held out no more.
        self.truths = dict(enumerate(truths, candidates))
        # Of the model that was looked at last, and its motions.
        self.estimates, self.errors = np.zeros(0), np.zeros(0)
        self.reached: Run | None = None

    def worst(self, accepted: Accepted) -> int | None:
        """The number of the point that should join the training; None where all are good."""
        systems = self.systems[: self.candidates]
        self.estimates, self.reached = _estimated(accepted, systems, self.times, self.tol)
        self.errors = np.zeros(0)
        worst = int(np.argmax(self.estimates))
        if self.estimates[worst] > self.tol / SAFETY:
            return worst
        model, rtol, truths = accepted.candidate.rom, sharper(self.tol), self.truths.items()
        errors = [held_out_error(model, self.systems[i], run, rtol) for i, run in truths]
        self.errors = np.array(errors)
        if len(errors) and max(errors) > self.tol:
            return list(self.truths)[int(np.argmax(errors))]
        return None

    @property
    def error(self) -> float:
        return float(np.max([*self.estimates, *self.errors]))

    def train(self, point: int) -> None:
        """Take a point into the training."""
        system, first = self.systems[point], self.search.truths[0]
        run = self.truths.pop(point, None)
        if run is None:
            run = simulate(system, self.times, rtol=_accurate(self.tol), solver=first.solver)
        self.search.systems.append(system)
        self.search.truths.append(run)
        self.trained.append({name: float(values[point]) for name, values in self.points.items()})

    def result(self, accepted: Accepted) -> ReducedBox:
        rom, left = accepted.candidate.rom, list(self.truths)
        validity = rom.validity
        if validity is not None and self.reached is not None:
            rom = eqx.tree_at(lambda r: r.validity, rom, validity.including(self.reached))
            rom = eqx.tree_at(lambda r: r.validity.error, rom, jnp.asarray(self.error))
        return ReducedBox(
            box=self.box,
            rom=rom,
            finer=None if accepted.finer is None else accepted.finer.rom,
            tol=self.tol,
            training={name: np.array([x[name] for x in self.trained]) for name in self.points},
            candidates={name: x[: self.candidates] for name, x in self.points.items()},
            estimates=self.estimates,
            held_out={name: x[left] for name, x in self.points.items()},
            errors=self.errors,
        )


def _accurate(tol: float) -> float:
    """The relative tolerance of full runs, whose errors should not be taken for those of models."""
    return min(sharper(tol), 1e-8)


def _estimated(
    accepted: Accepted, systems: list[AbstractSystem], times: Float[Array, " k"], tol: float
) -> tuple[np.ndarray, Run]:
    """The errors of a model for some systems, estimated without their runs, and its motions."""
    candidate, finer = accepted.candidate, accepted.finer
    rtol = as_number(sharper(tol), times.dtype)
    # The largest model has no next one: it errs as on the training.
    other = candidate.rom if finer is None else finer.rom
    changes, run = _changes(candidate.rom, other, *stacked("reduce_over", systems), times, rtol)
    if finer is None:
        changes = jnp.full(len(systems), accepted.estimate)
    return np.where(np.isfinite(changes), changes, np.inf), run


@program
def _changes(
    coarse: AbstractReducedSystem,
    fine: AbstractReducedSystem,
    numbers: Any,
    structure: Any,
    times: Float[Array, " k"],
    rtol: Any,
) -> tuple[Float[Array, " systems"], Run]:
    """‖q̃_{r+1} − q̃_r‖ relative to the motion, for each system, and all motions of the coarse model
    one after another.
    """

    def one(numbers: Any) -> tuple[Array, Run]:
        system = eqx.combine(numbers, structure)
        rom, run, change = run_and_change(coarse, fine, system, times, rtol)
        own = jax.vmap(rom.restrict)(run.q, run.v)
        return change, Run(times, *own, run.q, run.violation)

    changes, runs = jax.vmap(one)(numbers)
    return changes, jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), runs)
