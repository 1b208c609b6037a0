"""The energy of a run at its outputs, as a whole and by part."""

from typing import Any, NamedTuple

import jax
from jaxtyping import Array, Float

from ..assembly.counting import without_counters, without_states
from ..assembly.locate import assembled
from ..common.errors import InputError
from ..compiling.program import program
from ..integrate.origin import check_origin
from ..integrate.trajectory import Trajectory
from ..scene.effect.joint_inertia import JointInertia
from ..system.base import AbstractSystem
from ..system.structure import without_names
from .states import along, check_run


class EnergyHistory(NamedTuple):
    """Energies at the outputs of a run, (k,) [J].

    - `kinetic`: ½ vᵀ M v. `elastic`: of bodies that deform. `potential`: of gravity, springs and
      all other effects that store energy. `total`: their sum.
    - `balance`: total − start − work of all forces without potential energy and of joints that
      move with time, integrated along the motion: the error of the run.
    """

    kinetic: Float[Array, " k"]
    elastic: Float[Array, " k"]
    potential: Float[Array, " k"]
    total: Float[Array, " k"]
    balance: Float[Array, " k"]


def energy(system: AbstractSystem, run: Trajectory) -> EnergyHistory:
    """The energies of a `run` of a `system`, full or reduced: of the mechanism in both cases.

    The balance is that at the end of the step before each output. Differentiable but for it.

    Raises InputError for a run of another system, or without a balance (`audit=False`).
    """
    check_origin("energy", system, run)
    if run.imbalance is None:
        raise InputError(
            "energy: the run has no balance of energy; simulate it with audit=True, and where the "
            "model has no freedom the full system."
        )
    # Energies are those of the full mechanism: what a reduced model leaves out has energy too.
    kinetic, elastic, potential, total = _energies(system.full, run.t, run.q, run.v)
    return EnergyHistory(kinetic, elastic, potential, total, run.imbalance)


@program
def _energies(
    system: AbstractSystem,
    t: Float[Array, " k"],
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
) -> tuple[Array, Array, Array, Array]:
    def at(t: Array, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        now = system.state(t, q, v).energy()
        return now.kinetic, now.elastic, now.potential, now.total

    each: tuple[Array, Array, Array, Array] = jax.vmap(at)(t, q, v)
    return each


class PartEnergies(NamedTuple):
    """Energies [J] and powers [W] of the parts of a mechanism at the outputs of a run, (k,) each.

    - `kinetic`, `elastic`: of each body, by its name; elastic of those that deform.
    - `potential`: of each body in gravity, by its name, and of each effect that stores energy, by
      its key, as `effect_forces` has it.
    - `power`: of the own damping of each body that has one, and of the forces of each effect that
      have no potential energy. Joints that drive have theirs in `joint_forces`.
    """

    kinetic: dict[str, Float[Array, " k"]]
    elastic: dict[str, Float[Array, " k"]]
    potential: dict[str, Float[Array, " k"]]
    power: dict[str, Float[Array, " k"]]


def part_energies(system: AbstractSystem, run: Trajectory) -> PartEnergies:
    """The energies and powers of each body and each effect along a `run` of a `system`, full or
    reduced: `part_energies(system, run).kinetic["cart"]` (k,) [J].

    Raises InputError for a run of another system or of other numbers, or a system without bodies.
    """
    check_run("part_energies", system, run)
    full = assembled("part_energies", system)
    energies = along(_of_parts, without_names(full), run.t, run.q, run.v)
    coordinates, keys = full.structure.coordinates, full.structure.effects
    bodies = [
        [coordinates[rows[0]].owner for rows in group.coordinates.rows]
        for group in _with_inertia(full)
    ]
    effects, first = list[list[str]](), 0
    for group in full.effects:
        effects.append(list(keys[first : first + group.markers.count]))
        first += group.markers.count

    def named(parts: list[Any], names: list[list[str]]) -> dict[str, Any]:
        return {
            name: rows[:, i]
            for rows, group in zip(parts, names, strict=True)
            if rows is not None
            for i, name in enumerate(group)
        }

    kinetic, elastic, field, damping, stored, given = energies
    return PartEnergies(
        kinetic=named(kinetic, bodies),
        elastic=named(elastic, bodies),
        potential=named(field, bodies) | named(stored, effects),
        power=named(damping, bodies) | named(given, effects),
    )


def _with_inertia(full: Any) -> tuple[Any, ...]:
    """The groups of bodies, and the counters where some of them are the inertia of joints."""
    if not any(isinstance(group.effects, JointInertia) for group in full.effects):
        return without_counters(full.bodies)
    return without_states(full.bodies)


def _of_parts(full: Any, t: Array, q: Array, v: Array) -> tuple[list[Array | None], ...]:
    """Return the energies of each group of bodies, then of effects; None for those without any."""
    bodies = _with_inertia(full)
    stored, given = list[Array | None](), list[Array | None]()
    if full.effect_markers is not None:
        poses, twists = full.effect_markers.motion(q, v)
        for group in full.now(v).effects:
            stored.append(group.energy(t, poses) if group.effects.stores else None)
            given.append(group.power(t, poses, twists) if group.works(poses) else None)
    return (
        [group.kinetic_energy(q, v) for group in bodies],
        [group.elastic_energy(q) for group in bodies],
        [group.field_energy(full.fields, q) for group in bodies],
        [group.damping_power(v) for group in bodies],
        stored,
        given,
    )
