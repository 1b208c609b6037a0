"""Orientations in space as users have them, and the quaternions that stand for them."""

import re
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Number, Vector, as_array, concrete, namespace, untraced
from ..common.errors import SceneError
from ..common.fields import ROTATION
from ..linalg import quaternions

_CONVENTION = re.compile(r"(?!.*(.)\1)([XYZ]{3}|[xyz]{3})")

__all__ = ["euler", "orientation_field", "quaternion_of", "rotation"]

if TYPE_CHECKING:  # why, see fields.py
    from equinox import field as orientation_field
else:

    def orientation_field(**kwargs: Any) -> Any:
        """A field that holds a quaternion, of all that `quaternion_of` takes; none unless given."""
        return eqx.field(
            converter=lambda x: quaternion_of("orientation", None, x),
            metadata={ROTATION: True},
            **kwargs,
        )


def rotation(axis: Vector, angle: Number) -> Float[Array, "4"]:
    """The rotation by an `angle` [rad] about an `axis` (3,), a vector of any length but zero."""
    along, turn = untraced(as_array(axis), as_array(angle))
    _check_axis("rotation", along)
    xp = namespace(along)
    unit = along / xp.sqrt((along**2).sum())
    half = 0.5 * turn
    return as_array(xp.concatenate([xp.cos(half)[None], xp.sin(half) * unit]))


def euler(convention: str, angles: Vector) -> Float[Array, "4"]:
    """The rotation by Euler `angles` (3,) [rad] about the axes that the `convention` names, such as
    "ZXZ" for axes that turn with the body, "xyz" in small letters for those of space.

    Raises SceneError for another convention, and for another number of angles.
    """
    if not _CONVENTION.fullmatch(convention):
        raise SceneError(
            f"euler: the convention is {convention!r}; give three letters, of XYZ for axes that "
            "turn with the body or of xyz for those of space, no two alike in a row.",
            field="euler",
        )
    if as_array(angles).shape != (3,):
        raise SceneError(
            f"euler: angles has the shape {as_array(angles).shape}; give three [rad].",
            field="angles",
        )
    (given,) = untraced(as_array(angles))
    return _scalar_first(_rotations(given).from_euler(convention, given).as_quat())


def quaternion_of(
    owner: str, axis: Vector | None = None, given: Any = None, angle: Number = 0.0
) -> Float[Array, "4"]:
    """The quaternion of a rotation matrix (3, 3) or a quaternion (4,) that is `given`; or of the
    shortest rotation that brings the z axis to `axis`, after one by `angle` [rad] about z.

    Raises SceneError, beginning with `owner`, for what is no rotation.
    """
    if axis is not None and given is not None:
        raise SceneError(f"{owner}: give either an axis or a rotation, not both.")
    if np.shape(angle):
        raise SceneError(
            f"{owner}: the angle has the shape {np.shape(angle)}; give a number [rad], and an axis "
            "by its name, axis=(0.0, 0.0, 1.0).",
            field="angle",
        )
    if isinstance(axis, str):
        raise SceneError(
            f"{owner}: the axis is {axis!r}; give three numbers, such as (0.0, 0.0, 1.0).",
            field="axis",
        )
    own = rotation((0.0, 0.0, 1.0), angle)
    if axis is not None:
        return as_array(quaternions.product(*untraced(_to_axis(owner, as_array(axis)), own)))
    if given is None:
        return own
    value = as_array(given)
    if value.shape == (3, 3):
        _check_matrix(owner, value)
        (matrix,) = untraced(value)
        value = _scalar_first(_rotations(matrix).from_matrix(matrix).as_quat())
    elif value.shape != (4,):
        raise SceneError(
            f"{owner}: the rotation has the shape {value.shape}; give a rotation matrix (3, 3), a "
            "quaternion (w, x, y, z), or one of spatial.rotation and spatial.euler.",
            field="rotation",
        )
    known = concrete(value)
    if known is not None and not (np.all(np.isfinite(known)) and np.any(known)):
        raise SceneError(f"{owner}: the quaternion is {known}; give one that is not zero.")
    turned = not isinstance(angle, float) or angle != 0.0
    return as_array(quaternions.product(*untraced(value, own))) if turned else value


def _to_axis(owner: str, axis: Float[Array, "..."]) -> Float[Array, "4"]:
    """The shortest rotation from (0, 0, 1) to an axis: (|a| + a_z, −a_y, a_x, 0)."""
    _check_axis(owner, axis)
    (a,) = untraced(axis)
    xp = namespace(a)
    length = xp.sqrt((a**2).sum())
    # The sum of the unit quaternion and of that of twice the way, (a_z, z × a) / |a|, lies half way
    # between both.
    turned = xp.stack([length + a[2], -a[1], a[0], xp.zeros_like(length)])
    # To the opposite direction any half turn across z is as short. Nearer to it than this, half of
    # the digits of |a| + a_z are rounding.
    return as_array(xp.where(turned[0] > 1e-8 * length, turned, np.array([0.0, 1.0, 0.0, 0.0])))


def _check_axis(owner: str, axis: Float[Array | np.ndarray, "..."]) -> None:
    known = concrete(axis)
    if axis.shape != (3,) or (
        known is not None and not (np.all(np.isfinite(known)) and np.any(known))
    ):
        raise SceneError(
            f"{owner}: the axis is {axis}; give three numbers, not all zero.", field="axis"
        )


def _check_matrix(owner: str, matrix: Float[Array, "3 3"]) -> None:
    known = concrete(matrix)
    if known is None:
        return
    error = float(np.max(np.abs(known @ known.T - np.eye(3))))
    # A matrix that was typed in has some seven digits.
    if not (error < 1e-6 and np.linalg.det(known) > 0):
        raise SceneError(
            f"{owner}: the rotation matrix is not one: A Aᵀ − I is {error:.1e} and its determinant "
            f"{np.linalg.det(known):.3g}; its columns must be three unit vectors at right angles."
        )


def _rotations(numbers: Any) -> Any:
    """The class of rotations of SciPy, or that of JAX for numbers that it traces: each operation of
    JAX on its own would be compiled.
    """
    # Here, since importing romjax must not load scipy.spatial.
    if isinstance(numbers, np.ndarray):
        from scipy.spatial.transform import Rotation
    else:
        from jax.scipy.spatial.transform import Rotation
    return Rotation


def _scalar_first(quaternion: Any) -> Float[Array, "4"]:
    """(w, x, y, z) of the library's (x, y, z, w)."""
    xp = namespace(quaternion)
    return as_array(xp.roll(quaternion, 1))
