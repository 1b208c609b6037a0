"""A reduced model of a chosen accuracy."""

import dataclasses
from collections.abc import Sequence
from typing import Any

from tqdm import tqdm

from ...common.errors import InputError, ReductionError
from ...integrate.trajectory import Trajectory
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.formulation.parse import as_formulation
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem
from ...system.training import with_error
from ..sweeps.batch import simulate_all
from .rank_search import RankSearch, first_hidden, held_out_error, sharper


def reduce_to(
    system: AbstractSystem,
    training: Trajectory,
    tol: float,
    *,
    variations: Sequence[AbstractSystem] = (),
    formulation: AbstractFormulation | str = "galerkin",
    progress: bool = False,
) -> AbstractReducedSystem:
    """A reduced system whose runs err by at most `tol`, of the smallest rank that does.

    The rank goes up until the change from one rank to the next, a good estimate of the error, and
    the error on the training are half of `tol`, and the singular values that are left out hold a
    fifth of it. Then the model is tried on all variations it has not seen; if it fails, the one
    with the largest error joins the training, and so on.

    **Arguments:**

    - `system`: the full system; `training`: a run of it, at a tolerance well below `tol`.
    - `tol`: relative error in the energy norm, as `Comparison.error`.
    - `variations`: systems of the same structure with other numbers: amplitudes, frequencies,
      starts. They are simulated in one batch, by the method of the training and at its times.
    - `formulation`: "galerkin", "minimal" or "local", by name or as an object.
    - `progress`: show a progress bar.

    Returns the reduced system. Its `validity` holds the `error`, estimated on the training and
    measured on all variations, and how far the snapshots reach; `Trajectory.warnings` tells of a
    later run beyond. Its `summary` says in words what was done, and what the norm hides, as
    `Comparison.hidden`: a body that bends little beside the motion of all, and wrongly. That has
    `Flag.LEFT_OUT` in runs of the model; a smaller `tol` is the remedy.

    Raises ReductionError if no rank is good enough, naming the best one; InputError for variations
    that differ in structure or cannot be simulated.
    """
    if not 0 < tol < 1:
        raise InputError(f"reduce_to: tol={tol}, but it must lie between 0 and 1.")
    chosen = as_formulation(formulation)
    if chosen.for_reference:
        raise ReductionError(
            f"reduce_to: formulation={chosen.name!r} is for reference only; take another."
        )
    remaining = list(variations)
    unseen = simulate_all("reduce_to", remaining, training) if remaining else []
    search = RankSearch("reduce_to", [system], [training], tol, chosen)
    held_out = 0.0
    with tqdm(disable=not progress, unit=" models", desc="reduce_to") as bar:
        accepted = search.smallest(1, bar)
        while remaining:
            pairs = zip(remaining, unseen, strict=True)
            model = accepted.candidate.rom
            unseen_errors = [held_out_error(model, *pair, sharper(tol)) for pair in pairs]
            held_out = max(unseen_errors)
            if held_out <= tol:
                break
            worst = unseen_errors.index(held_out)
            search.systems.append(remaining.pop(worst))
            search.truths.append(unseen.pop(worst))
            accepted = search.smallest(accepted.candidate.basis.rank, bar)
    error, count = accepted.estimate, len(search.truths)
    words = f"; estimated error {error:.1e} for tol {tol:g}, {count} training run"
    words += "s" * (count > 1)
    if remaining:
        error = max(error, held_out)
        words += f", at most {held_out:.1e} on {len(remaining)} variations that are not among them"
    errors = accepted.errors(search)
    words += first_hidden(errors)
    rom: Any = with_error(accepted.candidate.rom, error, errors)
    accurate: AbstractReducedSystem = dataclasses.replace(rom, summary=rom.summary + words)
    return accurate
