"""Loads along beams without stiffening, whose work on bending their model leaves out."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Time
from ..common.compat import is_outermost
from ..compiling.program import program_once
from ..linalg import quaternions
from ..scene.body.beam import Beam
from ..scene.body.capped import uncapped
from ..scene.body.spatial.beam import Beam as SpatialBeam
from ..scene.marker import Wrench
from ..system.base import AbstractSystem
from ..system.dynamics import solve
from ..system.structure import without_names
from .assembled import AssembledSystem, groups_of, mechanism_of
from .body_group import BodyGroup
from .kinematics import Markers
from .wrenches import effect_wrenches, joint_wrenches

# What is too much, in units of EI / L², and at how many states it is looked for.
_LARGE, _STATES = 0.1, 16


def axial_warning(
    system: AbstractSystem,
    t: Float[Array, " k"],
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
) -> str:
    """The largest axial load that is too much for a beam without stiffening, in words; "" if none
    is, or while JAX traces. At states of a full or reduced `system`, in its coordinates; of many,
    at 16 that are spread evenly.

    Too much is a mean force along the beam of a tenth of EI / L², pull or push. That is 4 % of the
    load that buckles a beam clamped at one end, and 1 % of Euler's load, π² EI / L²: the first
    frequency is off by half of these shares, about what few modes err by. Beams that are given by
    frequencies have no EI to measure by.
    """
    if not is_outermost() or not any(True for _ in _beams(system)):
        return ""
    states = spread(_STATES, t, q, v)
    # A run that failed counts as far as it got.
    loads = np.nan_to_num(np.asarray(_loads(without_names(system), *states)), posinf=0, neginf=0)
    row, beam = np.unravel_index(np.argmax(np.abs(loads)), loads.shape)
    load = loads[row, beam]
    if abs(load) <= _LARGE:
        return ""
    firsts = [own[0] for beams in _beams(system) for own in beams.group.coordinates.rows]
    name = system.full.structure.coordinates[firsts[beam]].owner
    done, missing = ("pulled", "stiffen") if load > 0 else ("compressed", "soften")
    return (
        f"beam '{name}' is {done} by {abs(load):.2g} EI/L², which does not {missing} its bending "
        "without stiffening; give it stiffening=True"
    )


def spread(
    count: int, t: Float[Array, " k"], q: Float[Array, "k n"], v: Float[Array, "k n"]
) -> list[Any]:
    """Return `count` of the states, evenly spread over the outputs, with the first and the last."""
    rows = np.unique(np.linspace(0, len(t) - 1, count).round().astype(int))
    return [np.asarray(x)[rows] for x in (t, q, v)]


@program_once
def _loads(
    system: AbstractSystem, t: Float[Array, " k"], q: Float[Array, "k n"], v: Float[Array, "k n"]
) -> Float[Array, "k beams"]:
    """Return the axial loads of all beams at states of a full or reduced system."""

    def at(now: tuple[Array, Array, Array]) -> Array:
        state, mechanism = system.state(*now), mechanism_of(system)
        assert mechanism is not None
        return axial_loads(mechanism, now[0], state.q, state.v)

    # A loop, not a batch, whose program is larger.
    loads: Array = jax.lax.map(at, (jnp.asarray(t), jnp.asarray(q), jnp.asarray(v)))
    return loads


class _Beams(NamedTuple):
    """Beams of a group, which bend and do not stiffen; `EI` is that of the softer plane."""

    group: BodyGroup
    mass: Float[Array, " count"]
    length: Float[Array, " count"]
    EI: Float[Array, " count"]
    axis: int  # of the frame, which they lie along


def _beams(system: AbstractSystem) -> Iterator[_Beams]:
    for group in groups_of(system):
        body: Any = uncapped(group.bodies)
        if isinstance(body, Beam) and body.EI is not None and body.modes and not body.stiffening:
            yield _Beams(group, body.mass, body.length, body.EI, int(body.axis == "y"))
        elif isinstance(body, SpatialBeam) and any(body.bending) and not body.stiffening:
            # Bending along y is about z.
            both: Any = body.EI
            softer = jnp.min(both[:, np.flatnonzero(body.bending[::-1])], axis=1)
            yield _Beams(group, body.mass, body.length, softer, 0)


def axial_loads(
    full: AssembledSystem, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]
) -> Float[Array, " beams"]:
    """The mean force along each beam without stiffening, in units of EI / L², tension positive.

    With the principle of virtual work, for a stretch of the undeformed beam about its middle: the
    forces F at places x along it, and the inertia of its turning across the axis, do the work
    N L = Σ F x + m L² ω² / 12 by the mean force N. Weight does none.
    """
    beams = list(_beams(full))
    count = [len(x.group.coordinates.rows) for x in beams]
    firsts = [own[0] for x in beams for own in x.group.coordinates.rows]
    frames = [_frames(x, q, v) for x in beams]
    axes, spins = (jnp.concatenate(x) for x in zip(*frames, strict=True))
    place, total = np.repeat([x.axis for x in beams], count), jnp.zeros(len(firsts), q.dtype)
    for markers, wrenches in _wrenches(full, t, q, v):
        own = {i: firsts.index(x[0]) for i, x in enumerate(markers.frames.rows) if x[0] in firsts}
        rows, of = np.array([*own], int), np.array([*own.values()], int)
        pull = jnp.sum(wrenches.force[rows] * axes[of], axis=1)
        total = total.at[of].add(pull * markers.points[rows, place[of]])
    mass, length, stiffness = (
        jnp.concatenate([getattr(x, name) for x in beams]) for name in ("mass", "length", "EI")
    )
    return (total + mass * length**2 / 12 * spins) * length / stiffness


def _wrenches(
    full: AssembledSystem, t: Time, q: Array, v: Array
) -> Iterator[tuple[Markers, Wrench]]:
    if full.joint_markers is not None:
        multipliers = solve(full, t, q, v, None).multipliers
        own = full.joints, full.joint_markers
        yield full.joint_markers, joint_wrenches(*own, t, q, multipliers)
    if full.effect_markers is not None:
        yield (
            full.effect_markers,
            effect_wrenches(full.now(v).effects, full.effect_markers, t, q, v),
        )


def _frames(beams: _Beams, q: Array, v: Array) -> tuple[Array, Array]:
    """Directions of beams (count, d), and squares of their angular velocities across these."""
    at, rates = (beams.group.coordinates.take(x) for x in (q, v))
    if beams.group.bodies.dimension == 2:
        angle = at[:, 2] + beams.axis * np.pi / 2
        return jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1), rates[:, 2] ** 2
    turns = at[:, 3:7]
    along = quaternions.rotate(turns, jnp.tile(jnp.eye(3, dtype=q.dtype)[:1], (len(turns), 1)))
    across = jnp.cross(quaternions.angular_velocity(turns, rates[:, 3:7]), along)
    return along, jnp.sum(across**2, axis=1)
