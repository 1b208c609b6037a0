"""The reduced models that a study of accuracy tries, the most promising first."""

import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ...assembly.disassemble import disassemble
from ...assembly.locate import assembled
from ...basis.basis import AbstractDecomposition, Basis
from ...basis.decomposition.pod import POD
from ...basis.rank import Rank
from ...common.errors import InputError, RankError, ReductionError
from ...integrate.trajectory import Trajectory
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.reduce import reduce
from ...scene.body.capped import with_caps
from ...system import unit_length
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem
from ..timing import timed
from .model import Model, Reduction

NO_TIME = "no time left in the budget"
# Caps that are tried unless others are asked for, in units of the lowest frequency of a body: the
# deflection of slower modes follows the motion well.
_CAPS = (2.5, 5.0)


def reduced_models(
    system: AbstractSystem,
    training: Trajectory,
    training_time: float,
    decompositions: Sequence[AbstractDecomposition],
    choices: Sequence[tuple[AbstractFormulation, Rank]],
    refused: dict[str, str],
    out_of_time: Callable[[], bool],
) -> Iterator[Model]:
    """Reduced models of the training run, which took `training_time` [s].

    `choices`: formulations, each with a rank. Models that the snapshots or the reduction refuse go
    into `refused`, and once there is `out_of_time` all others; of equal ones the first is made.
    """
    seen = set()
    for decomposition, (formulation, rank) in itertools.product(decompositions, choices):
        name = f"{decomposition.name} {formulation.name}, r = {rank}"
        if out_of_time():
            refused[name] = NO_TIME
            continue

        def make(
            decomposition: AbstractDecomposition = decomposition,
            formulation: AbstractFormulation = formulation,
            rank: Rank = rank,
        ) -> tuple[AbstractReducedSystem, Basis]:
            basis = formulation.basis(system, training, decomposition.with_rank(rank))
            return reduce(system, basis, formulation), basis

        try:
            (rom, basis), duration = timed(make)
        except (RankError, ReductionError) as error:  # too few directions, or it would lock
            refused[name] = str(error)
            continue
        model = Model(system, Reduction(rom, basis, formulation, training_time + duration))
        if model.name not in seen:
            seen.add(model.name)
            yield model


def default_choices(
    system: AbstractSystem, training: Trajectory, formulations: Sequence[AbstractFormulation]
) -> list[tuple[AbstractFormulation, Rank]]:
    """Formulations with ranks: in a subspace the drop point of the training run or less, of minimal
    coordinates as many as there are degrees of freedom or less.

    One less comes first: the least mode is often the stiff one that hardly moves.
    """
    drop, freedoms = POD()(training).rank, max(1, unit_length.freedoms(system))
    ranks = [
        (formulation, (drop if formulation.in_subspace else freedoms) - less)
        for less in (1, 0, 2)
        for formulation in formulations
    ]
    return [(formulation, rank) for formulation, rank in ranks if rank > 0]


def default_caps(system: AbstractSystem, factors: Sequence[float] = _CAPS) -> list[float]:
    """Caps [Hz], in units of the lowest mode of a body, that are below the highest; none where the
    frequencies of the bodies are not known.
    """
    try:
        scene = disassemble(assembled("accuracy", system))
        with_caps(scene, 1.0)
    except InputError:  # no bodies, no modes, modes that are not orthonormal or capped already
        return []
    modes = [body.natural_frequencies() for body in scene.bodies if body.modes]
    frequencies = np.concatenate(modes) / (2 * np.pi)
    caps = [float(factor * np.min(frequencies)) for factor in factors]
    return [hertz for hertz in caps if hertz < np.max(frequencies)]
