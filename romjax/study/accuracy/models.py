"""The models that a study of accuracy tries, the most promising first."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence

import jax

from ...basis.decomposition.pod import pod
from ...basis.decomposition.sod import sod
from ...basis.rank import Rank
from ...integrate.trajectory import Trajectory
from ...reduction.reduce import reduce
from ...system.base import AbstractSystem
from .result import Model

DECOMPOSE = {"POD": pod, "SOD": sod}
FORMULATIONS = ("galerkin", "minimal", "projected")
NO_TIME = "no time left in the budget"


def reduced_models(
    system: AbstractSystem,
    training: Trajectory,
    made_in: float,
    bases: Sequence[str],
    kinds: Sequence[tuple[str, Rank]],
    refused: dict[str, str],
    enough: Callable[[], bool],
) -> Iterator[Model]:
    """Reduced models of the training run, which was `made_in` so many seconds.

    `kinds`: formulations, each with a rank. Those that are refused go into `refused`, once there is
    `enough` all others too; of equal ones the first is made.
    """
    seen = set()
    for basis, (formulation, rank) in itertools.product(bases, kinds):
        begin = time.perf_counter()
        if enough():
            refused[f"{basis} {formulation}, r = {rank}"] = NO_TIME
            continue
        try:
            found = DECOMPOSE[basis](training, rank)
            rom = reduce(system, found, formulation)
        except ValueError as error:  # too few directions, or a mechanism that would lock
            refused[f"{basis} {formulation}, r = {rank}"] = str(error)
            continue
        jax.block_until_ready(rom.q0)
        took = time.perf_counter() - begin
        name = f"{basis} {formulation}, r = {rom.n}"
        if name not in seen:
            seen.add(name)
            yield Model(name, formulation, rom, found, made_in + took)


def default_kinds(
    system: AbstractSystem, training: Trajectory, formulations: Sequence[str]
) -> list[tuple[str, Rank]]:
    """Of minimal coordinates all the freedoms or some less, of others the drop point or less.

    One less comes first: the least mode is often the stiff one that hardly moves.
    """
    drop = pod(training).rank
    freedoms = max(1, system.n - system.m)
    top = {kind: freedoms if kind == "minimal" else drop for kind in formulations}
    kinds = [(kind, top[kind] - less) for less in (1, 0, 2) for kind in formulations]
    return [(kind, rank) for kind, rank in kinds if rank > 0]
