"""How far the amplitudes of bodies move these, against the angles with which they share tolerances.

Amplitudes have units of their own, such as m kg^½: those of a beam of a centimetre and a tenth of a
gram are below 1e-5 where it bends by a tenth of its length. As an error an amplitude counts as the
turn of its body that moves as much in the mass metric, M_aa δa² = J δφ².
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.partition import detached
from ..system.base import AbstractSystem
from ..system.structure import Structure

# An amplitude may have so many times the error of that turn, and never more than an angle.
_MORE = 10.0


def amplitude_shares(system: AbstractSystem, q: Float[Array, " n"]) -> Float[Array, " n"] | None:
    """The tolerances of the coordinates in units of those that they would have as angles; None
    where no coordinate is known as an amplitude.
    """
    structure = system.structure
    pairs = structure.amplitudes
    if structure.frames:
        modes = ~np.array(structure.rigid) & ~structure.is_state
        pairs = tuple((i, i) for i in np.flatnonzero(modes).tolist())
    if not pairs:
        return None
    columns, numbers = np.array(pairs).T
    system, q = detached(system, q)
    bodies, places = (system, q) if structure.frames else (system.full, system.full.q0)
    inertia = jnp.diagonal(bodies.mass(places))
    # Each amplitude has the turns of its body, three of which a quaternion has in four numbers.
    turns, count = _turns(bodies.structure, numbers)
    turning = jnp.sum(inertia[turns], axis=1) / count
    squares = turning / inertia[numbers]
    return jnp.ones_like(q).at[columns].set(jnp.minimum(1.0, _MORE * jnp.sqrt(squares)))


def _turns(structure: Structure, numbers: np.ndarray) -> tuple[np.ndarray, float]:
    """The coordinates of the turn of the body of each amplitude, and over what the sum of their
    inertias is J: in space trace M_pp = 4 trace J.
    """
    # Four times the trace over twelve is the mean of the three moments of inertia.
    bodies = np.searchsorted(structure.frames, numbers, side="right") - 1
    return structure.turns[bodies], 12.0 if structure.quaternions else 1.0
