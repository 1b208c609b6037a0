"""Training runs of a box, chosen one by one where a model errs most."""

import copy
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from tqdm import tqdm

from ...common.arrays import as_number
from ...common.errors import InputError
from ...compiling.program import program
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...reduction.formulation.base import AbstractFormulation
from ...system.base import AbstractSystem, Run
from ...system.reduced import AbstractReducedSystem
from ...system.training import with_error
from ..errors.flow import Flows
from ..errors.residual import nonlinear
from ..errors.richer import Finer, finer_of
from ..ranks.rank_search import SAFETY, Accepted, RankSearch, held_out_error, sharper
from ..sweeps.batch import Sharing, simulate_all, stacked
from .box import Box
from .estimate import run_with_error_estimate
from .reduced_box import ReducedBox
from .sensitivities import sensitivities


class Greedy:
    """Training runs that are chosen one by one, from `points` of a box, of which the first ones are
    the `candidates`, and the others held out. With `gradients`, the sensitivities of each training
    run are snapshots too; with `flow`, the flow of errors along them is kept. Processes share the
    runs that are held out as `sharing` says.
    """

    def __init__(
        self,
        box: Box,
        points: dict[str, np.ndarray],
        candidates: int,
        times: Float[Array, " k"],
        tol: float,
        formulation: AbstractFormulation,
        gradients: bool,
        flow: bool,
        sharing: Sharing,
    ):
        self.box, self.points, self.candidates = box, points, candidates
        self.times, self.tol, self.gradients, self.flow = times, tol, gradients, flow
        rows = zip(*points.values(), strict=True)
        self.systems = [box.system(**dict(zip(points, row, strict=True))) for row in rows]
        self.search = RankSearch("reduce_over", [], [], tol, formulation)
        self.trained: list[dict[str, float]] = []
        first = self.join(box.center)
        unseen = self.systems[candidates:]
        truths = simulate_all("reduce_over", unseen, first, sharing) if unseen else []
        # Runs by the numbers of their points; what joins the training is held out no more.
        self.truths = dict(enumerate(truths, candidates))
        # These belong to the model that was looked at last, and to its motions.
        self.estimates, self.guesses, self.errors = np.zeros(0), np.zeros(0), np.zeros(0)
        self.reached: Run | None = None
        self.rank = 1

    def with_run(self, tol: float, parameters: dict[str, float]) -> ReducedBox:
        """The model of one more training run, for a tolerance; this training stays as it is."""
        other, search = copy.copy(self), self.search
        systems, truths, more = search.systems, search.truths, search.sensitivities
        other.search = RankSearch(
            search.name, list(systems), list(truths), tol, search.formulation, list(more)
        )
        other.tol, other.trained, other.truths = tol, list(self.trained), dict(self.truths)
        other.join(parameters)
        with tqdm(disable=True) as bar:
            accepted = other.search.smallest(self.rank, bar)
        other.worst(accepted)
        return other.result(accepted)

    def join(self, parameters: dict[str, float], run: Trajectory | None = None) -> Trajectory:
        """Take a point of the box into the training, with its full run."""
        search, rtol = self.search, _accurate(self.tol)
        system = self.box.system(**parameters)
        solver = search.truths[0].solver if search.truths else None
        if run is None:
            run = simulate(system, self.times, rtol=rtol, solver=solver)
        search.systems.append(system)
        search.truths.append(run)
        self.trained.append(parameters)
        if self.gradients:
            made = sensitivities(self.box, self.times, rtol=rtol, solver=run.solver, **parameters)
            search.sensitivities.extend(made)
        return run

    def worst(self, accepted: Accepted) -> int | None:
        """The number of the point that should join the training; None where all are good."""
        self.rank = accepted.candidate.basis.rank
        # Held-out points are estimated too, which tells how good estimates are.
        estimates, self.reached = _estimated(accepted, self.systems, self.times, self.tol)
        self.estimates, self.guesses = estimates[: self.candidates], estimates[list(self.truths)]
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
        """Take one of the points into the training."""
        parameters = {name: float(values[point]) for name, values in self.points.items()}
        self.join(parameters, self.truths.pop(point, None))

    def result(self, accepted: Accepted) -> ReducedBox:
        rom, left = accepted.candidate.rom, list(self.truths)
        finer, validity = finer_of(rom), rom.validity
        if validity is not None and self.reached is not None:
            rom = eqx.tree_at(lambda r: r.validity, rom, validity.including(self.reached))
            rom = with_error(rom, self.error, accepted.errors(self.search))
        return ReducedBox(
            box=self.box,
            rom=rom,
            finer=finer,
            tol=self.tol,
            training={name: np.array([x[name] for x in self.trained]) for name in self.points},
            candidates={name: x[: self.candidates] for name, x in self.points.items()},
            estimates=self.estimates,
            held_out={name: x[left] for name, x in self.points.items()},
            errors=self.errors,
            guesses=self.guesses,
            flows=self.flows(rom, finer, self.times) if self.flow else None,
            greedy=self,
        )

    def flows(
        self, rom: AbstractReducedSystem, finer: tuple[Finer, ...], times: Any
    ) -> Flows | None:
        """The flow of a finer model along the training runs; None of a model with all freedoms.

        Raises InputError where no linear estimate of the errors is known.
        """
        if not finer:
            return None
        space = finer[0].model
        reason = nonlinear(rom) or nonlinear(space)
        if reason:
            raise InputError(
                f"reduce_over: flow=True, but {reason}, of which no linear estimate is known; "
                "leave it out, so that a richer model estimates errors."
            )
        return Flows.along(space, self.search.systems, times, _accurate(self.tol))


def _accurate(tol: float) -> float:
    """The relative tolerance of full runs, whose errors should not be taken for those of models."""
    return min(sharper(tol), 1e-8)


def _estimated(
    accepted: Accepted, systems: list[AbstractSystem], times: Float[Array, " k"], tol: float
) -> tuple[np.ndarray, Run]:
    """The errors of a model for some systems, estimated without their runs, and its motions."""
    rom, rtol = accepted.candidate.rom, as_number(sharper(tol), times.dtype)
    finer = tuple(one.model for one in finer_of(rom))
    changes, run = _changes(rom, finer, *stacked("reduce_over", systems), times, rtol)
    if not finer:
        # All freedoms are there: the model errs as on the training.
        changes = jnp.full(len(systems), accepted.estimate)
    return np.where(np.isfinite(changes), changes, np.inf), run


@program
def _changes(
    coarse: AbstractReducedSystem,
    finer: tuple[AbstractReducedSystem, ...],
    numbers: Any,
    structure: Any,
    times: Float[Array, " k"],
    rtol: Any,
) -> tuple[Float[Array, " systems"], Run]:
    """Estimated errors for some systems, and all motions of the coarse model, one after another."""

    def one(numbers: Any) -> tuple[Array, Run]:
        system = eqx.combine(numbers, structure)
        rom, run, change = run_with_error_estimate(coarse, finer, system, times, rtol)
        own = jax.vmap(rom.restrict)(run.q, run.v)
        return change, Run(times, *own, run.q, run.violation)

    changes, runs = jax.vmap(one)(numbers)
    return changes, jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), runs)
