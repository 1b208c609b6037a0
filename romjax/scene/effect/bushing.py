"""An elastic joint."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time, Vector, concrete
from ...common.errors import SceneError
from ...linalg import quaternions
from ...linalg.dense import multiply
from ..drawing import arc, placed, wheel
from ..fields import Converted, check_finite, number
from ..marker import Marker, Pose, Poses, Twists, Wrenches
from ..outline import Outline, Outlines
from .base import AbstractMarkerEffect, check_markers, displacement

# How many directions it has in the plane and in space.
_COUNTS = {3: "three", 6: "six"}


class Bushing(AbstractMarkerEffect):
    """A rubber bushing: springs, and dampers if asked for, in the frame of marker `b`.

    With the displacement δ = (x, y, angle) of `a` against `b`, in space (x, y, z, rotation vector),
    its energy is ½ δᵀ K δ and its dissipation function ½ δ'ᵀ D δ'. The rotation vector is the axis
    times the angle, which is at most half a turn: runs in which `a` turns further, where its torque
    changes sides, have `Flag.LIMIT`.

    **Arguments:**

    - `a`, `b`: the two ends.
    - `stiffness`: K, (3,), in space (6,), for a diagonal matrix, or the matrix: along x, y, z of
      `b` [N/m], against rotations about them [N m/rad], and [N/rad] between both.
    - `damping`: D of the same directions [N s/m], [N m s/rad], [N s/rad]; none unless given.

    Raises SceneError for another shape, a matrix that is not symmetric, or a negative eigenvalue.
    """

    a: Marker
    b: Marker
    stiffness: Converted[Float[Array, "k *columns"], Vector] = number()
    damping: Converted[Float[Array, "k *columns"] | None, Vector] = number(default=None)
    hatched: ClassVar[bool] = True
    stores: ClassVar[bool] = True
    supplies: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def needs_twists(self) -> bool:  # type: ignore[override]
        return self.damping is not None

    @property
    def dissipates(self) -> bool:  # type: ignore[override]
        return self.damping is not None

    @property
    def limited(self) -> bool:  # type: ignore[override]
        return self.a.dimension == 3

    def energy(self, t: Time, *poses: Pose) -> Float[Array, ""]:
        del t
        delta = _delta(*poses)
        return 0.5 * jnp.sum(delta * _apply(self.stiffness, delta))

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        del t
        delta, rate, wrenches = displacement(_delta, poses, twists)
        force = -_apply(self.stiffness, delta)
        if self.damping is not None:
            force -= _apply(self.damping, rate())
        return wrenches(force)

    def limit(self, *poses: Pose) -> Float[Array, ""]:
        """The cosine of half the angle of rotation, up to a factor."""
        return _turn(*poses)[0]

    def outline(self, t: Time, poses: Poses, size: Float[Array, ""]) -> Outlines:
        """A sleeve that sits on `b`, and a pin inside that sits on `a`."""
        del t
        a, b = poses
        sleeve = placed(b, arc(size, 2 * np.pi))
        return Outline(wheel(a, 0.45 * size), "spring"), Outline(sleeve, "spring")

    def check(self) -> None:
        owner = check_markers(self)
        size = 3 if self.a.dimension == 2 else 6
        _check_matrix(owner, "stiffness", self.stiffness, size)
        if self.damping is not None:
            _check_matrix(owner, "damping", self.damping, size)


def _apply(matrix: Float[Array, "k *columns"], x: Float[Array, " k"]) -> Float[Array, " k"]:
    return matrix * x if matrix.ndim == 1 else multiply(matrix, x)


def _delta(a: Pose, b: Pose) -> Float[Array, " k"]:
    """Return the displacement of `a` in the frame of `b`: x, y [m] and the angle [rad] in the
    plane, x, y, z and the rotation vector in space.
    """
    if a.dimension == 2:
        return jnp.append(b.local(a.position), a.angle - b.angle)
    relative = _turn(a, b)
    # tan ½φ times the axis: the same for all multiples of a quaternion.
    tangent = relative[1:] / relative[0]
    squared = jnp.sum(tangent**2)
    small = squared < 1e-4
    length = jnp.sqrt(jnp.where(small, 1.0, squared))
    # arctan(x)/x; near zero by its series, of which four terms reach rounding.
    series = 1 - squared * (1 / 3 - squared * (1 / 5 - squared / 7))
    ratio = jnp.where(small, series, jnp.arctan(length) / length)
    return jnp.concatenate([b.local(a.position), 2 * ratio * tangent])


def _turn(a: Pose, b: Pose) -> Float[Array, "4"]:
    """The quaternion of `a` in the frame of `b`, with any length and sign."""
    return quaternions.product(quaternions.conjugate(b.turn), a.turn)


def _check_matrix(owner: str, field: str, matrix: Array, size: int) -> None:
    if matrix.shape not in ((size,), (size, size)):
        raise SceneError(
            f"{owner}: {field} has shape {matrix.shape}; give {_COUNTS[size]} numbers, or a matrix "
            f"({size}, {size}).",
            field=field,
        )
    check_finite(owner, field, matrix)
    known = concrete(matrix)
    if known is None:
        return
    if known.ndim == 2 and np.max(np.abs(known - known.T)) > 1e-9 * np.max(np.abs(known)):
        raise SceneError(
            f"{owner}: the matrix {field} is not symmetric; no potential has it.", field=field
        )
    values = known if known.ndim == 1 else np.linalg.eigvalsh(known)
    # Eigenvalues that are zero are found within rounding of the largest.
    if np.min(values) < -1e-9 * np.max(np.abs(values)):
        raise SceneError(
            f"{owner}: {field} has the eigenvalue {np.min(values):g}, but none may be negative.",
            field=field,
        )
