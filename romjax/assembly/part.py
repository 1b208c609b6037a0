"""A part of a system: some of its bodies, free of joints, with some of its effects."""

import itertools
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import pick
from ..common.errors import ReductionError
from ..linalg.indexing import Index
from ..linalg.pattern import Pattern
from ..scene.turn_counter import TurnCounter
from ..system.structure import Structure
from .assembled import AssembledSystem
from .body_group import BodyGroup
from .groups import EffectGroup
from .kinematics import MarkerBlocks, Markers


def part(
    system: AssembledSystem,
    rows: Sequence[Sequence[int]],
    weights: Sequence[Float[Array, " count"]],
    effects: Sequence[int],
) -> AssembledSystem:
    """The bodies `rows` of each group of a system, with the `weights` of their Lagrangians, and the
    groups of `effects` by their numbers, whose markers must be on these bodies or the ground.

    Its coordinates are those of the bodies, in the order of the groups. Raises ReductionError where
    angles in space count full turns: joints hold their counters, and a part has no joints.
    """
    counters = [g.coordinates for g in system.bodies if isinstance(g.bodies, TurnCounter)]
    if counters:
        labels = [system.structure.labels[i] for c in counters for row in c.rows for i in row]
        raise ReductionError(
            f"part: {', '.join(labels)} counts full turns by a constraint, which a part of a "
            "system has not; reduce all of it, by romjax.Minimal() or romjax.Galerkin()."
        )
    tables = [
        g.coordinates.array[np.array(r, int)] for g, r in zip(system.bodies, rows, strict=True)
    ]
    used = [int(i) for table in tables for i in table.reshape(-1)]
    number = dict(zip([*used, system.n], itertools.count(), strict=False))
    bodies = []
    for group, own, table, weight in zip(system.bodies, rows, tables, weights, strict=True):
        if len(own):
            members = jax.tree.map(lambda x, own=own: pick(x, np.array(own, int)), group.bodies)
            bodies.append(BodyGroup(members, _renumbered(table, number), weight))
    acting = [system.effects[i] for i in effects]
    markers, start = None, 0
    groups = list[EffectGroup]()
    if acting and system.effect_markers is not None:
        seen = [np.arange(g.markers.count * g.markers.sides) + g.markers.start for g in acting]
        markers = _some(system.effect_markers, np.concatenate(seen), number)
    for effect in acting:
        blocks = MarkerBlocks(start, effect.markers.count, effect.markers.sides)
        groups.append(EffectGroup(effect.effects, blocks))
        start += blocks.count * blocks.sides
    known = system.structure
    columns = np.array(used, int)
    return AssembledSystem(
        bodies=tuple(bodies),
        joints=(),
        joint_markers=None,
        effects=tuple(groups),
        effect_markers=markers,
        fields=system.fields,
        q0=pick(system.q0, columns),
        v0=pick(system.v0, columns),
        structure=Structure(
            tuple(known.coordinates[i] for i in used),
            (),
            tuple(known.rigid[i] for i in used),
            known.flexible,
            loops=False,
        ),
        pattern=Pattern.of([row for group in bodies for row in group.coordinates.rows], []),
    )


def _some(markers: Markers, rows: np.ndarray, number: dict[int, int]) -> Markers:
    """Return the markers of the given `rows`, with their coordinates renumbered by `number`."""
    shapes = markers.foreshortening
    return Markers(
        pick(markers.points, rows),
        pick(markers.turns, rows),
        pick(markers.shapes, rows),
        None if shapes is None else pick(shapes, rows),
        _renumbered(markers.frames.array[rows], number),
        _renumbered(markers.amplitudes.array[rows], number),
        tuple(few for own in markers.bending if (few := own.among(rows)) is not None),
    )


def _renumbered(table: np.ndarray, number: dict[int, int]) -> Index:
    return Index.of([[number[int(i)] for i in row] for row in table])
