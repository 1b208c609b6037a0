"""Models that know more than a reduced one, whose runs tell how wrong its own are."""

import dataclasses
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, cast

from jaxtyping import Array, Float

from ...assembly.assemble import assemble
from ...assembly.assembled import groups_of, mechanism_of
from ...assembly.disassemble import disassemble
from ...basis.decomposition.pod import POD
from ...common.errors import InputError, RankError, ReductionError
from ...common.outside import outside_of_traces
from ...integrate.derived import metric_of
from ...reduction.formulation.base import AbstractFormulation
from ...reduction.formulation.minimal import Minimal
from ...reduction.local.formulation import Local
from ...scene.body.capped import with_caps_times
from ...system.base import AbstractSystem
from ...system.reduced import AbstractReducedSystem
from ...system.training import Recipe, training_of

# Times the cap: above all modes.
_ENDLESS = 1e12


class Finer(NamedTuple):
    """A model, and what it is called where it tells the error of another one."""

    model: AbstractReducedSystem
    name: str


def finer_of(rom: AbstractSystem, spare: int = 0) -> tuple[Finer, ...]:
    """The models that tell how wrong a reduced one is, the richest first; () where none is known.

    One of a richer kind, since what no snapshot shows is missed by models of the same kind alike:
    beside a model of all coordinates the local one with a mode for each flexible body, or more
    until it has more freedoms, beside a local one another mode in each body; of mechanisms without
    such bodies twice the rank. Where that has no more freedoms, the next rank stands beside it:
    whoever asks for the error takes the larger change.

    `spare`: so many more modes in each body, or twice as many more of mechanisms without flexible
    ones. Joint forces need one: the vibrations that both models leave out carry these as much as
    the first one that the model leaves out does. With all modes in all bodies it is the full system
    that tells, (): it is compiled for others too.

    Models are made once, also where JAX traces, and kept with the reduced one as it was made.
    """
    training = training_of(rom)
    if training is None or training.recipe is None:
        return ()
    if spare not in training.finer:
        known = training.rom, training.recipe, spare
        training.finer[spare] = outside_of_traces(lambda: tuple(_finer(*known)))
    found: tuple[Finer, ...] = training.finer[spare]
    return found


def _finer(rom: AbstractReducedSystem, recipe: Recipe, spare: int) -> Iterator[Finer]:
    ranks = _ranks(rom, recipe, spare)
    if spare and ranks and ranks == tuple(_modes(rom.full)):
        return
    formulation, richer = recipe.formulation, _richer_kind(rom, recipe, ranks, spare)
    if richer is not None:
        yield richer
    if richer is None or _freedoms(richer.model) <= _freedoms(rom):
        next_rank = _of_rank(rom, recipe, formulation, [rom.n + 1])
        if next_rank is not None:
            yield next_rank


def _richer_kind(
    rom: AbstractReducedSystem, recipe: Recipe, ranks: tuple[int, ...], spare: int
) -> Finer | None:
    formulation, r = recipe.formulation, rom.n
    # Twice the rank tells motions; forces of segments at rank 4 it tells up to 25 times too large.
    twice = dict.fromkeys([2 * r + 2 * spare, 2 * r])
    if ranks:
        return _of_rank(rom, recipe, Local(ranks=ranks), [sum(ranks)])
    if formulation.is_general:
        return _of_rank(rom, recipe, formulation, [*twice, r + (r + 1) // 2])
    # What stands for minimal coordinates is judged by these themselves.
    return _of_rank(rom, recipe, Minimal(), [*twice, r + 1, r])


def _ranks(rom: AbstractReducedSystem, recipe: Recipe, spare: int) -> tuple[int, ...]:
    """The numbers of modes of the local model that judges another one; () where no body bends."""
    sizes = _modes(rom.full)
    if not any(sizes):
        return ()
    if isinstance(recipe.formulation, Local):
        # One more mode for each body.
        ranks = [k + 1 for k in cast(Any, rom).ranks]
    else:
        ranks = [_more_freedoms(rom, sizes)] * len(sizes)
    return tuple(min(k + spare, most) for k, most in zip(ranks, sizes, strict=True))


def _more_freedoms(rom: AbstractReducedSystem, sizes: list[int]) -> int:
    """The fewest modes for each body, equally many, with more freedoms than a model; else all."""
    for k in range(1, max(sizes)):
        left_out = sum(max(0, most - k) for most in sizes)
        if rom.full.n - rom.full.m - left_out > _freedoms(rom):
            return k
    return max(sizes)


def _modes(full: AbstractSystem) -> list[int]:
    """The numbers of modes of all bodies in the order of the scene; () of what has no bodies."""
    rows = [
        (row[0], len(row) - group.bodies.frame_size)
        for group in groups_of(full)
        for row in group.coordinates.rows
    ]
    # Counters of angles and states of effects come after the bodies.
    return [modes for _, modes in sorted(rows)][: len(full.structure.frames)]


def _of_rank(
    rom: AbstractReducedSystem,
    recipe: Recipe,
    formulation: AbstractFormulation,
    ranks: Iterable[int],
) -> Finer | None:
    """The model of the first of some ranks that the snapshots allow; None if there is none that
    differs.
    """
    for rank in ranks:
        try:
            basis = formulation.basis(rom.full, recipe.snapshots, POD(rank))
            model = formulation.reduce(rom.full, basis)
        except (RankError, ReductionError, InputError):
            continue
        # Minimal coordinates of more modes than there are freedoms are the freedoms.
        if model.n > rom.n or formulation.name != recipe.formulation.name:
            return Finer(model, f"{formulation.name}, {rank} modes")
    return None


def _freedoms(model: AbstractReducedSystem) -> int:
    return model.n - model.m


def twice_capped(system: AbstractSystem) -> tuple[AbstractSystem, Float[Array, "n n"]] | None:
    """The system with twice the cap on its modes, and the metric of errors, that of one without;
    None of a system without caps.

    Its error is a quarter of the other's, so that both differ by three quarters of that.
    """
    mechanism = mechanism_of(system)
    if mechanism is None:
        return None
    scene = disassemble(mechanism)
    faster, free = with_caps_times(scene, 2.0), with_caps_times(scene, _ENDLESS)
    if faster is None or free is None:
        return None
    # It has the same start, whose capped modes vibrate by as much as the uncapped ones do.
    other = dataclasses.replace(assemble(faster), q0=system.q0, v0=system.v0)
    return other, metric_of(assemble(free))
