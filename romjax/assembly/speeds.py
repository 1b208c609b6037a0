"""Speeds that are set and contradict the joints: in words, with the nearest ones that do not."""

from typing import Never

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..common.errors import InputError
from ..compiling.program import program_once
from ..linalg import quaternions
from ..system.dynamics import constraint_state, jacobian
from ..system.structure import Structure
from .assembled import AssembledSystem

# The vectors of velocities that each body has.
_NAMES = ("velocity", "angular_velocity", "rates")
# Singular values below are those of joints that repeat others, as a share of the largest.
_REPEATED = 1e-9
# A change of less than this share is rounding.
_SAME = 1e-9


def fields_of(structure: Structure) -> tuple[np.ndarray, int]:
    """Return the number of the vector that each velocity belongs to, and the number of vectors.

    Each body has those of `_NAMES`; the last vector is for coordinates that no body has.
    """
    bodies, kinds = len(structure.frames), len(_NAMES)
    numbers = np.arange(len(structure.coordinates))
    owners = np.searchsorted(np.array(structure.frames), numbers, side="right") - 1
    fields = kinds * owners + kinds - 1
    fields[structure.positions] -= 2
    fields[structure.turns] -= 1
    fields[np.array(structure.counters + structure.states, int)] = kinds * bodies
    return fields, kinds * bodies + 1


def refuse_speeds(
    system: AssembledSystem,
    q: Float[Array, " n"],
    given: Float[Array, " n"],
    held: Bool[np.ndarray, " n"],
) -> Never:
    """Raise InputError, naming what is `held` of the `given` velocities and cannot be, each with
    its nearest value: the nearest in the mass metric of what is held, whatever the others are.
    """
    nearest = _nearest(system, q, np.asarray(given), held)
    structure = system.structure
    fields, count = fields_of(structure)
    words, parts = list[str](), list[tuple[str, str]]()
    for field in range(count - 1):
        own = np.flatnonzero(fields == field)
        if not own.size or not held[own[0]]:
            continue
        old, new = (
            _as_given(structure, np.asarray(q), x, own) for x in (np.asarray(given), nearest)
        )
        if np.max(np.abs(new - old)) > _SAME * np.max(np.abs(old)):
            part = f"body '{structure.coordinates[own[0]].owner}'"
            name = _NAMES[field % len(_NAMES)]
            words.append(f"{name} of {part} is {_told(old)}, the nearest {_told(new)}")
            parts.append((part, name))
    part, name = parts[0] if parts else ("", "")
    raise InputError(
        "consistent_scene: speeds that are set contradict the joints, or each other: "
        f"{'; '.join(words)}. Set those that you know, and leave out (at zero) what shall follow.",
        part=part,
        field=name,
    )


def _nearest(
    system: AssembledSystem,
    q: Float[Array, " n"],
    given: Float[np.ndarray, " n"],
    held: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Velocities that suit all joints, and come nearest to those that are held.

    Raises InputError where none suits all joints.
    """
    mass, rows, drift = (np.asarray(x, float) for x in _matrices(system, q))
    half = np.linalg.inv(np.linalg.cholesky(mass)).T  # v = half y, and |y|² = vᵀ M v
    _, values, directions = np.linalg.svd(rows @ half)
    rank = int(np.sum(values > _REPEATED * values[0]))
    # All that suit: one of them, and the directions in which it may change.
    one = half @ np.linalg.lstsq(rows @ half, -drift, rcond=_REPEATED)[0]
    free = half @ directions[rank:].T
    weight = np.linalg.cholesky(mass[np.ix_(held, held)]).T
    left = weight @ (given - one)[held]
    # The shares are at most one; those that are rounding change nothing that is held.
    sides, shares, changes = np.linalg.svd(weight @ free[held], full_matrices=False)
    moves = shares > _REPEATED
    change = changes[moves].T @ ((sides[:, moves].T @ left) / shares[moves])
    nearest: np.ndarray = one + free @ change
    return nearest


@program_once
def _matrices(
    system: AssembledSystem, q: Float[Array, " n"]
) -> tuple[Float[Array, "n n"], Float[Array, "m n"], Float[Array, " m"]]:
    """The mass matrix, C_q, and the rate of the constraints where nothing moves."""
    zero = jnp.zeros((), q.dtype)
    return system.mass(q), jacobian(system, zero, q), constraint_state(system, zero, q, 0 * q).rate


def _as_given(
    structure: Structure,
    q: Float[np.ndarray, " n"],
    v: Float[np.ndarray, " n"],
    own: np.ndarray,
) -> Float[np.ndarray, " k"]:
    """The velocities `own` of v as the scene has them: of a quaternion, as an angular velocity."""
    if own[0] - 3 in structure.frames and structure.quaternions:
        return np.asarray(quaternions.angular_velocity(q[own], v[own]))
    return np.asarray(v[own])


def _told(values: Float[np.ndarray, " k"]) -> str:
    rounded = np.where(np.abs(values) > _SAME * np.max(np.abs(values)), values, 0)
    numbers = ", ".join(f"{x:.6g}" for x in rounded)
    return numbers if len(values) == 1 else f"({numbers})"
