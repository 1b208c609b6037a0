"""Rotations of frames that turn along a line: steps of order six, and their derivatives by hand.

A frame with the curvature κ by its own axes, R' = R κ̃, turns from ξ to ξ + h by
R(ξ + h) = R(ξ) exp(Ω̃) with the series of Magnus (Blanes, Casas, Oteo and Ros 2009,
doi:10.1016/j.physrep.2008.11.001), whose brackets have the other sign here, since R is multiplied
from the right. Its first term, ∫κ dξ, is taken exactly: about one axis a step has no error.

Moments of κ in a step, (..., 4, 3): its integral, and a₁, a₂, a₃ of the values at the three Gauss
points. All functions take leading axes, and compute by NumPy what is given as its arrays.
"""

import math
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Numbers, namespace
from . import quaternions

# Where the three Gauss points of a step are, and what moments are of the values there. Through
# these values goes κ = a₁ + a₂ s + a₃ s², with s from the middle of the step in units of its
# length: κ₃ − κ₁ = √15/5 a₂ and κ₁ − 2 κ₂ + κ₃ = 3/10 a₃ give the rows.
POINTS = 0.5 + math.sqrt(15) / 10 * np.array([-1.0, 0.0, 1.0])
MOMENTS = np.array(
    [
        [0.0, 1.0, 0.0],
        [-math.sqrt(15) / 3, 0.0, math.sqrt(15) / 3],
        [10 / 3, -20 / 3, 10 / 3],
    ]
)
# Below θ = 0.2 quotients are series of θ²: cos ½θ and sin ½θ / ½θ by ¼ θ², and (θ − sin θ)/θ³. The
# first terms that are left out are below 3e-17 there, where θ − sin θ is 0.7 % of θ and has lost
# two digits.
_SHARES = np.array([0.25, 0.25, 1.0])
_SERIES = [[1 / math.factorial(2 * n + k) for k in (0, 1, 3)] for n in range(5)]
# The entries of x̃ by those of x.
_SKEW = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _SKEW[_i, _k, _j], _SKEW[_i, _j, _k] = 1, -1


def rotation(moments: Float[Numbers, "... 4 3"]) -> Float[Numbers, "... 4"]:
    """The unit quaternion of exp(Ω̃)."""
    turn: Float[Numbers, "... 4"]
    turn = _rotation(moments) if isinstance(moments, np.ndarray) else _differentiable(moments)
    return turn


def _rotation(moments: Float[Numbers, "... 4 3"]) -> Float[Numbers, "... 4"]:
    omega = _series(moments)
    of_turn = _coefficients(omega)
    parts = [of_turn[..., :1], 0.5 * of_turn[..., 1:2] * omega]
    turn: Float[Numbers, "... 4"] = namespace(moments).concatenate(parts, -1)
    return turn


# Its derivative is ½ (0, spin) ⊗ of itself, which compiles faster than that of the quotients.
_differentiable = jax.custom_jvp(_rotation)


@_differentiable.defjvp
def _turning(given: Any, rates: Any) -> tuple[Any, Any]:
    (moments,), (rate,) = given, rates
    turn = _differentiable(moments)
    half = quaternions.from_vector(0.5 * spin(moments, rate))
    return turn, quaternions.product(half, turn)


def slopes(moments: Float[Numbers, "... 4 3"]) -> Float[Numbers, "... 3 12"]:
    """The turn of exp(Ω̃), by the axes at the start of the step, per unit of each moment."""
    xp, one = namespace(moments), _broadcast(np.eye(3), moments.ndim)
    omega, left, right, rest = _parts(moments)
    of_turn = _coefficients(omega)[..., None]
    vectors = xp.stack([moments[..., 1, :], moments[..., 2, :], rest, left, right, omega], -2)
    skews = skew(vectors)
    first, second, third, left, right, around = (skews[..., i, :, :] for i in range(6))
    products = first @ xp.concatenate([second, first], -1)
    # The product rule on Ω = a₀ + left × right / 240, with the derivatives of both factors by a₁,
    # a₂ and a₃ as 3 × 3 blocks.
    inner = [(products[..., :3] - third) / 60, one - products[..., 3:] / 60, first / 30]
    outer = xp.concatenate([20 * one - second, first, one + 0 * first], -1)
    scaled = (left @ xp.concatenate(inner, -1) - right @ outer) / 240
    # The differential of the exponential: 1 + (1 − cos θ)/θ² Ω̃ + (θ − sin θ)/θ³ Ω̃², with ½ (sin
    # ½θ / ½θ)² for the first quotient.
    onto = one + 0.5 * of_turn[..., 1:2, :] ** 2 * around + of_turn[..., 2:, :] * (around @ around)
    derivatives: Float[Numbers, "... 3 12"] = xp.concatenate([onto, onto @ scaled], -1)
    return derivatives


def spin(moments: Float[Array, "... 4 3"], rates: Float[Array, "... 4 3"]) -> Float[Array, "... 3"]:
    """The angular velocity of exp(Ω̃), by the axes at the start of the step, for `rates` of the
    moments: what `slopes` says of all of them.
    """
    omega, rate = jax.jvp(_series, (moments,), (rates,))
    of_turn = _coefficients(omega)
    across = cross(omega, rate)
    around = cross(omega, across)
    total: Float[Array, "... 3"] = rate + 0.5 * of_turn[..., 1:2] ** 2 * across
    return total + of_turn[..., 2:] * around


def skew(x: Float[Numbers, "... 3"]) -> Float[Numbers, "... 3 3"]:
    """x̃, with x̃ y = x × y, by one product, which compiles faster than picked entries."""
    entries: Any = x @ _SKEW.reshape(3, 9)
    matrix: Float[Numbers, "... 3 3"] = entries.reshape(*x.shape, 3)
    return matrix


def cross(a: Float[Numbers, "... 3"], b: Float[Numbers, "... 3"]) -> Float[Numbers, "... 3"]:
    """A × b."""
    product: Float[Numbers, "... 3"] = (skew(a) * b[..., None, :]).sum(axis=-1)
    return product


def _series(moments: Float[Numbers, "... 4 3"]) -> Float[Numbers, "... 3"]:
    """Ω."""
    omega: Float[Numbers, "... 3"] = _parts(moments)[0]
    return omega


def _parts(moments: Float[Numbers, "... 4 3"]) -> tuple[Any, Any, Any, Any]:
    """Ω, the factors of its brackets but for 1/240, and 2 a₃ − a₁ × a₂."""
    first, second, third = (moments[..., i, :] for i in (1, 2, 3))
    # Blanes and others have Ω = a₀ + [−20 a₁ − a₃ + C₁, a₂ + C₂] / 240 with the brackets
    # C₁ = [a₁, a₂] and C₂ = −[a₁, 2 a₃ + C₁] / 60. With [x, y] = −x × y that is left × right / 240.
    around = skew(first)
    both = (around * second[..., None, :]).sum(axis=-1)
    rest = 2 * third - both
    left = 20 * first + third + both
    right = second + (around * rest[..., None, :]).sum(axis=-1) / 60
    return moments[..., 0, :] + cross(left, right) / 240, left, right, rest


def _coefficients(omega: Float[Numbers, "... 3"]) -> Float[Numbers, "... 3"]:
    """Return cos ½θ, sin ½θ / ½θ and (θ − sin θ)/θ³, good at zero with their derivatives."""
    xp = namespace(omega)
    square = (omega * omega).sum(axis=-1)[..., None]
    small = square < 0.04
    few = xp.where(small, square, 0) * _broadcast(_SHARES, omega.ndim)
    many = xp.where(small, 1, square)
    half = 0.5 * xp.sqrt(many)
    cosine, sine = xp.cos(half), xp.sin(half) / half
    # Horner's rule on alternating series: one loop evaluates all three.
    total = 0 * few
    for terms in reversed(_SERIES):
        total = _broadcast(np.array(terms), omega.ndim) - few * total
    # cos ½θ sin ½θ / ½θ is sin θ / θ, so that the third is (1 − sin θ / θ) / θ².
    quotients = xp.concatenate([cosine, sine, (1 - cosine * sine) / many], -1)
    coefficients: Float[Numbers, "... 3"] = xp.where(small, total, quotients)
    return coefficients


def _broadcast(values: np.ndarray, axes: int) -> np.ndarray:
    """Return `values` with leading axes of length one, of so many `axes` in all."""
    return values.reshape((1,) * (axes - values.ndim) + values.shape)
