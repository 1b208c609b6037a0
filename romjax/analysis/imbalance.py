"""Whether modes are those about a balance, or depend on how far a state at rest is from one."""

import warnings
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..linalg.dense import multiply
from ..system.base import AbstractSystem
from ..system.start import length_of
from .tangent import Tangent

# How far frequencies are looked at from the state, in radians and in lengths of the mechanism, and
# what counts as no step at all.
_STEP, _NONE = 0.05, 1e-6
# Squares of frequencies may change by this share in that step: a pendulum that hangs askew by 0.25
# rad has a frequency that is 1.6 % off. Squares count as no less than this share of accelerations
# by lengths, which are those of free motions.
_CHANGED, _FREE = 0.01, 0.01


class Imbalance(NamedTuple):
    """What is out of balance: the `step` (n,) toward an equilibrium, its `size` [rad] or in lengths
    of the mechanism, and the `rate` [1/s²], an acceleration by such a length.
    """

    step: Float[Array, " n"]
    size: Float[Array, ""]
    rate: Float[Array, ""]

    @classmethod
    def none(cls, q: Float[Array, " n"]) -> "Imbalance":
        zero = jnp.zeros((), q.dtype)
        return cls(jnp.zeros_like(q), zero, zero)


def imbalance_of(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"], tangent: Tangent
) -> Imbalance:
    """A step of Newton's method toward an equilibrium from rest, cut off in each mode."""
    basis, d = tangent.basis, tangent.basis.shape[1]
    if not d:
        return Imbalance.none(q)
    weights = _weights(system, t, q)
    # N has unit mass, and annihilates the forces of joints.
    push = multiply(basis.T, system.state(t, q, jnp.zeros_like(q)).force())
    stiffness = -tangent.matrix[d:, :d]
    squares, directions = jnp.linalg.eigh(0.5 * (stiffness + stiffness.T))
    # What is below is rounding, of a motion that nothing holds; by so small a divisor its amount is
    # large, and is cut off at `_STEP`. The second number keeps the division right where all are
    # zero.
    floor = jnp.maximum(1e-12 * jnp.max(jnp.abs(squares)), 1e-30)
    amounts = multiply(directions.T, push) / jnp.where(jnp.abs(squares) > floor, squares, floor)
    shapes = multiply(basis, directions)
    sizes = jnp.max(weights[:, None] * jnp.abs(shapes), axis=0) * jnp.abs(amounts)
    step = multiply(shapes, amounts * _STEP / jnp.maximum(sizes, _STEP))
    size = jnp.max(weights * jnp.abs(step))
    rate = jnp.max(weights * jnp.abs(multiply(basis, push)))
    return Imbalance(step * _STEP / jnp.maximum(size, _STEP), jnp.minimum(size, _STEP), rate)


def _weights(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"]
) -> Float[Array, " n"]:
    """What a unit of each coordinate counts: by the length of the mechanism, or in radians; nothing
    where amplitudes bend, and by the largest coordinate where no bodies are known.
    """
    structure = system.structure
    if not structure.frames:
        moves = np.array(structure.rigid) & ~structure.is_state
        return jnp.where(moves, 1 / jnp.max(jnp.abs(q), initial=1), 0)
    turns = np.zeros(system.n, bool)
    turns[structure.turns] = True
    positions = jnp.where(structure.is_position, 1 / length_of(system, t, q), 0)
    return jnp.where(turns, 1, positions)


def is_needed(found: Imbalance) -> bool:
    """Whether frequencies have to be compared with those at the end of the step."""
    return bool(np.asarray(found.size) > _NONE)


def warn_of_imbalance(
    owner: str, found: Imbalance, here: Float[Array, " d"], there: Float[Array, " d"]
) -> None:
    """Warn, in the name of `owner`, if frequencies change in the step toward an equilibrium."""
    before, after = (np.asarray(x, float) ** 2 for x in (here, there))
    both = np.maximum(before, after)
    rounded = np.sqrt(np.finfo(np.asarray(here).dtype).eps) * np.max(both, initial=0.0)
    least = np.maximum(rounded, _FREE * float(found.rate))
    change = np.max(np.abs(after - before) / np.maximum(both, least), initial=0.0)
    # NaN, where the step leads to where no modes are, warns too.
    if change <= _CHANGED:
        return
    # Relative changes of squares, so that a frequency of zero is off by all of the other one.
    percent = 100 * (1 - np.sqrt(1 - np.minimum(change, 1.0)))
    # A velocity of zero is no remedy: with one, drives move.
    warnings.warn(
        f"{owner}: the state is not in balance, and a frequency differs by {percent:.2g} % "
        f"where it is {float(found.size):.2g} rad, or that share of the mechanism's length, nearer "
        "to an equilibrium; take modes at romjax.equilibrium(system, t=t), or, if those of this "
        "very state are meant, silence this by "
        f"warnings.filterwarnings('ignore', '{owner}: the state is not in balance').",
        stacklevel=3,
    )
