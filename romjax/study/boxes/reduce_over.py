"""One reduced model for all mechanisms of a box of parameters."""

import os

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike
from tqdm import tqdm

from ...common.errors import InputError, ReductionError
from ...integrate.settings import check_times
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.formulation.parse import as_formulation
from ..sweeps.batch import Sharing
from .box import Box
from .greedy import Greedy
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
    gradients: bool = False,
    flow: bool = False,
    seed: int = 0,
    chunk: int | None = None,
    path: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> ReducedBox:
    """A reduced model whose runs err by at most `tol` for all mechanisms of a box.

    The first training run is that in the middle. The error at the candidates is estimated by the
    change to models of a richer kind, without full runs; the mechanism with the largest one joins
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
    - `gradients`: take the `sensitivities` of the training runs as snapshots too, so that
      derivatives by the parameters are about as accurate as motions; the model is larger, and the
      box must make scenes of traced numbers, as `jax.grad` asks.
    - `flow`: keep the linearised flow of errors along the training runs, by which
      `ReducedBox.corrected` and `sweep_over` estimate errors without a second run: for many runs
      of mechanisms in the plane, without contacts, of which no linear estimate is known.
    - `seed`: of the points. `progress`: show a progress bar.
    - `path`: a folder for the held-out runs, by which processes share them, and a search that was
      interrupted goes on, as of `sweep`; `chunk`: so many at once, 4 unless given. The training
      runs follow from each other, so that each process makes all of them.

    Raises ReductionError if `runs` training runs are not enough, with the error reached; InputError
    for numbers without meaning, and a flow of what none is known of; ValueError for a folder that
    holds other runs.
    """
    if not 0 < tol < 1:
        raise InputError(f"reduce_over: tol={tol}, but it must lie between 0 and 1.")
    if runs < 1 or candidates < 1 or held_out < 0:
        raise InputError(
            f"reduce_over: runs={runs}, candidates={candidates}, held_out={held_out}; take at "
            "least one run, one candidate, and no negative number."
        )
    points = _points(box, candidates, held_out, seed)
    chosen = as_formulation(formulation)
    sharing = Sharing(path, chunk)
    times = check_times("reduce_over", ts, jnp.result_type(float))
    greedy = Greedy(box, points, candidates, times, tol, chosen, gradients, flow, sharing)
    with tqdm(disable=not progress, unit=" models", desc="reduce_over") as bar:
        accepted = greedy.search.smallest(1, bar)
        # Greedy sampling: the box is searched by the model's own estimate, and the full system is
        # run only where that is worst.
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
