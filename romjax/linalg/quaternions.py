"""Rotations in space by quaternions p = (w, x, y, z) of any length but zero.

A quaternion and its multiples turn by the same rotation A(p), homogeneous of degree zero and
orthonormal for every p ≠ 0: rational, without a root, a branch or a constraint on the length. With
s = pᵀp, e = (x, y, z) and the 3 × 4 matrices G = [−e, w I − ẽ] and E = [−e, w I + ẽ], the angular
velocity is 2 G ṗ / s by the axes of the body and 2 E ṗ / s by those of space; G p = E p = 0
(Nikravesh, "Computer-Aided Analysis of Mechanical Systems", 1988, chapter 6, for s = 1).

All functions take leading axes, and compute by NumPy what is given as its arrays.
"""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ..common.arrays import Numbers, namespace

Quaternion = Float[Numbers, "... 4"]
Triple = Float[Numbers, "... 3"]

# The order of the entries of p in the matrix of a product, whose last rows are those of G and E.
_ORDER = [[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]]
# Their signs in the matrix of a first factor, and of a second one.
_LEFT = [[1, -1, -1, -1], [1, 1, -1, 1], [1, 1, 1, -1], [1, -1, 1, 1]]
_RIGHT = [[1, -1, -1, -1], [1, 1, 1, -1], [1, -1, 1, 1], [1, 1, -1, 1]]


def columns(starts: Sequence[int]) -> np.ndarray:
    """The columns (bodies, 4) of quaternions that begin at some coordinates."""
    return np.array(starts)[:, None] + np.arange(4)


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """A ⊗ b: first the rotation b, then a; by the matrix [a, Gᵀ] of a."""
    return apply(_signed(a, _LEFT), b)


def two_sided_product(a: Quaternion, b: Quaternion) -> Float[Numbers, "... 4 4"]:
    """The matrix of x ↦ a ⊗ x ⊗ b."""
    # a ⊗ x is a matrix of a times x, and x ⊗ b one of b times x: their product is both.
    first, second = _signed(a, _LEFT), _signed(b, _RIGHT)
    products: Float[Numbers, "... 4 4"] = (first[..., None] * second[..., None, :, :]).sum(axis=-2)
    return products


def conjugate(p: Quaternion) -> Quaternion:
    """The inverse rotation, of the same length."""
    return p * _constant([1, -1, -1, -1], p)


def from_vector(x: Triple) -> Quaternion:
    """(0, x)."""
    return _joined(0.0, x)


def small_turn(angles: Triple) -> Quaternion:
    """(1, ½ θ): to first order the rotation by the vector θ, and exactly one for any θ."""
    return _joined(1.0, 0.5 * angles)


def cross(a: Triple, b: Triple) -> Triple:
    """A × b, by two shifted products."""
    return _shifted(a * _shifted(b) - _shifted(a) * b)


def rotate(p: Quaternion, x: Triple) -> Triple:
    """A(p) x = E Gᵀ x / s, which takes half as many operations as cross products with the axis."""
    turned = apply(space_matrix(p), apply_transposed(body_matrix(p), x))
    return turned / squared(p)[..., None]


def matrix(p: Quaternion) -> Float[Numbers, "... 3 3"]:
    """A(p) = E Gᵀ / s, whose columns are the axes of the body."""
    body, space = body_matrix(p), space_matrix(p)
    products = (space[..., :, None, :] * body[..., None, :, :]).sum(axis=-1)
    return products / squared(p)[..., None, None]


def squared(p: Quaternion) -> Float[Numbers, "..."]:
    """S = pᵀp."""
    total: Float[Numbers, ...] = namespace(p).asarray((p * p).sum(axis=-1))
    return total


def body_matrix(p: Quaternion) -> Float[Numbers, "... 3 4"]:
    """G = [−e, w I − ẽ]."""
    return _signed(p, [[-1, 1, 1, -1], [-1, -1, 1, 1], [-1, 1, -1, 1]])


def space_matrix(p: Quaternion) -> Float[Numbers, "... 3 4"]:
    """E = [−e, w I + ẽ]."""
    return _signed(p, [[-1, 1, -1, 1], [-1, 1, 1, -1], [-1, -1, 1, 1]])


def skew(x: Triple) -> Float[Numbers, "... 3 3"]:
    """x̃, with x̃ y = x × y."""
    padded = _joined(0.0, x)
    signs = _constant([[0, -1, 1], [1, 0, -1], [-1, 1, 0]], x)
    return padded[..., np.array([[0, 3, 2], [3, 0, 1], [2, 1, 0]], np.uint32)] * signs


def angular_velocity(p: Quaternion, rate: Quaternion) -> Triple:
    """2 E ṗ / s, by the axes of space [rad/s]."""
    return 2 * apply(space_matrix(p), rate) / squared(p)[..., None]


def body_angular_velocity(p: Quaternion, rate: Quaternion) -> Triple:
    """2 G ṗ / s, by the axes of the body [rad/s]."""
    return 2 * apply(body_matrix(p), rate) / squared(p)[..., None]


def derivative(p: Quaternion, angular_velocity: Triple) -> Quaternion:
    """ṗ = ½ Eᵀ ω of an angular velocity by the axes of space [rad/s]; as E p = 0, it keeps |p|."""
    return 0.5 * apply_transposed(space_matrix(p), angular_velocity)


def angle(a: Quaternion, b: Quaternion, less: Any = None) -> Float[Numbers, "..."]:
    """The angle of `a` against `b` about the z axis, `less` what is given, between −π and π [rad].

    Of the relative quaternion (w, x, y, z), turned back, it is 2 arctan(z / w). That is the same
    for all multiples of it, and smooth but at a half turn. Where the z axes differ, a rotation
    across them comes after.
    """
    # Only w and z are formed: effects in joints ask for many angles.
    w, z = (b * a).sum(axis=-1), (b * a[..., ::-1] * _constant([1, -1, 1, -1], a)).sum(axis=-1)
    xp = namespace(less if isinstance(less, jax.Array) else b * a)
    if less is not None:
        # The quaternion is turned back by `less` first, so that the arctangent stays away from the
        # half turn where its branch ends.
        c, s = xp.cos(0.5 * less), xp.sin(0.5 * less)
        w, z = c * w + s * z, c * z - s * w
    # At a half turn w is zero; the arctangent of the infinite quotient is right.
    with np.errstate(divide="ignore"):
        turned: Float[Numbers, ...] = 2 * xp.arctan(z / w)
    return turned


def torque(p: Quaternion, slope: Quaternion) -> Triple:
    """½ E ∂/∂p: the torque by the axes of space that does the same work as a force on p."""
    # A turn by δθ changes p by ½ Eᵀ δθ: the work slope · δp is τ · δθ with this τ.
    return 0.5 * apply(space_matrix(p), slope)


def generalized(p: Quaternion, torque: Triple) -> Quaternion:
    """2 Eᵀ τ / s: the force on p of a torque by the axes of space."""
    # The power τ · ω with ω = 2 E ṗ / s is that of this force on ṗ.
    return 2 * apply_transposed(space_matrix(p), torque) / squared(p)[..., None]


def apply(a: Float[Numbers, "... p c"], x: Float[Numbers, "... c"]) -> Float[Numbers, "... p"]:
    """A x."""
    return (a * x[..., None, :]).sum(axis=-1)


def apply_transposed(
    a: Float[Numbers, "... p c"], x: Float[Numbers, "... p"]
) -> Float[Numbers, "... c"]:
    """aᵀ x."""
    return (a * x[..., :, None]).sum(axis=-2)


def _shifted(x: Triple) -> Triple:
    """(x₂, x₃, x₁)."""
    shifted: Triple = namespace(x).concatenate([x[..., 1:], x[..., :1]], axis=-1)
    return shifted


def _joined(first: float, x: Triple) -> Quaternion:
    xp = namespace(x)
    joined: Quaternion = xp.concatenate([xp.full_like(x[..., :1], first), x], axis=-1)
    return joined


def _signed(p: Quaternion, signs: list[list[int]]) -> Float[Numbers, "... rows 4"]:
    if isinstance(p, np.ndarray):
        return p[..., np.array(_ORDER[-len(signs) :])] * _constant(signs, p)
    # In row i and column j stands entry i XOR j, so that rows are p with axes of two turned round.
    # The transpose of an index of arrays would be a loop over all entries, a dozen times in the
    # derivatives of a joint.
    last = p.ndim
    square = jax.lax.reshape(p, (*p.shape[:-1], 2, 2))
    turned = [jax.lax.rev(square, axes) for axes in ((last,), (last - 1,), (last - 1, last))]
    rows = jax.lax.concatenate([square, *turned][-len(signs) :], last - 1)
    return jax.lax.reshape(rows, (*p.shape[:-1], len(signs), 4)) * _constant(signs, p)


def _constant(values: Any, x: Float[Numbers, "... k"]) -> np.ndarray:
    """Return `values` as an array of the rank of x, with leading axes of length one."""
    constant = np.array(values, x.dtype)
    return constant.reshape((1,) * (x.ndim - 1) + constant.shape)
