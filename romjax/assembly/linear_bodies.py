"""Warnings of linear bodies beyond their validity: axially loaded beams, meshes that bend far."""

import warnings
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.compat import is_outermost
from ..compiling.program import program_once
from ..scene.body.capped import uncapped
from ..scene.body.modal import AbstractModalBody
from ..system.base import AbstractSystem
from ..system.structure import without_names
from .assembled import groups_of
from .axial_loads import axial_warning, spread
from .body_group import BodyGroup

# [rad] against the frame. A plate that is clamped at one end and bends so far errs by a fiftieth of
# its deflection, of which it leaves out the second order; at 0.5 rad by a fifteenth.
FAR = 0.2
_STATES = 16


def linear_warnings(
    system: AbstractSystem,
    t: Float[Array, " k"],
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
) -> tuple[str, ...]:
    """What linear bodies leave out at states of a full or reduced `system`; none where that is
    little, or while JAX traces.
    """
    found = axial_warning(system, t, q, v), turning_warning(system, t, q, v)
    return tuple(filter(None, found))


def warn_of_linear_bodies(
    owner: str,
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
) -> None:
    """Warn, in the name of `owner`, of what `linear_warnings` says of one state."""
    found = linear_warnings(system, *(x[None] for x in (t, q, v)))
    if found:
        warnings.warn(f"{owner}: {'; '.join(found)}.", stacklevel=3)


def turning_warning(
    system: AbstractSystem,
    t: Float[Array, " k"],
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
) -> str:
    """The mesh that turns the farthest against its frame at one of its points, if by more than 0.2
    rad, in words; "" if none does. Of many states it looks at 16 that are spread evenly.
    """
    full = system.full
    if not is_outermost() or not any(True for _ in _meshes(full)):
        return ""
    states = spread(_STATES, t, q, v)
    if system is not full:
        states[1] = np.asarray(_positions(without_names(system), *states))
    # A run that failed counts as far as it got.
    positions = np.nan_to_num(states[1], posinf=0.0, neginf=0.0)
    turn, name = max(_turns(full, positions))
    if turn <= FAR:
        return ""
    return (
        f"mesh '{name}' is turned by {turn:.2g} rad against its frame, to which its modes are "
        "linear; cut it into several bodies that are welded, or take a Rod where it is slender"
    )


def _meshes(full: AbstractSystem) -> Iterator[tuple[BodyGroup, Any]]:
    for group in groups_of(full):
        body: Any = uncapped(group.bodies)
        if isinstance(body, AbstractModalBody) and body.modes:
            yield group, body


def _turns(full: AbstractSystem, q: np.ndarray) -> Iterator[tuple[float, str]]:
    """The largest turn of each mesh at some states, and its name."""
    for group, body in _meshes(full):
        frame, motions = body.frame_size, slice(2, 3) if body.dimension == 2 else slice(3, 6)
        shapes = np.asarray(body.shapes)[:, :, motions]
        for own, rotations in zip(group.coordinates.rows, shapes, strict=True):
            turns = np.einsum("pmk,tk->tpm", rotations, q[:, list(own[frame:])])
            name = full.structure.coordinates[own[0]].owner
            yield float(np.max(np.linalg.norm(turns, axis=2))), name


@program_once
def _positions(
    system: AbstractSystem, t: Float[Array, " k"], q: Float[Array, "k n"], v: Float[Array, "k n"]
) -> Float[Array, "k full"]:
    """The coordinates of the full system at states of a reduced one."""

    def at(now: tuple[Array, Array, Array]) -> Array:
        return system.state(*now).q

    positions: Array = jax.lax.map(at, (jnp.asarray(t), jnp.asarray(q), jnp.asarray(v)))
    return positions
