"""A rigid body in space."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import Vector, as_array, concrete
from ....common.errors import SceneError
from ....linalg import quaternions
from ....linalg.dense import invert, multiply, multiply_transposed
from ...drawing import cuboid
from ...fields import Converted, check_finite, check_mass, number
from ...orientation import orientation_field
from ...points import NamedPoints, by_name
from ..base import AbstractBody, check_name, check_start, frame_start
from .frame_inverse import FrameInverse, spin_of
from .inertia import SpatialInertia, length_inertia


class RigidBody(AbstractBody):
    """A rigid body in space with its frame in the centre of mass unless `com` is given; coordinates
    x, y, z [m], and the quaternion w, x, y, z of any length.

    **Arguments:**

    - `name`: unique in the scene.
    - `mass`: Mass [kg].
    - `inertia`: about the centre of mass by the axes of the body [kg m²]: three principal moments,
      or the tensor (3, 3).
    - `position`: of the frame at the start [m].
    - `orientation`: how the frame is turned at the start: a rotation matrix (3, 3) from the body to
      space, a quaternion (w, x, y, z), or one of `spatial.rotation` and `spatial.euler`; none
      unless given.
    - `velocity`, `angular_velocity`: initial motion by the inertial axes [m/s], [rad/s].
    - `extent`: what it is drawn as, without mechanical meaning: the edges [m] of a box, or the
      corners of a polygon (corners, 3).
    - `points`: points by name for `body.at("name")`, such as {"tip": (0.0, 0.0, 0.1)} [m].
    - `com`: the centre of mass in the frame of the body [m], where that is another point: position,
      velocity, points, `extent` and `at` are those of the frame, and coordinates and inertia those
      of the centre of mass by its axes.
    """

    dimension: ClassVar[int] = 3

    name: str = eqx.field(static=True)
    mass: Converted[Float[Array, ""]] = number()
    inertia: Converted[Float[Array, "3 *columns"], Vector] = number()
    position: Converted[Float[Array, "3"], Vector] = number(default=(0.0, 0.0, 0.0))
    orientation: Converted[Float[Array, "4"], Vector | None] = orientation_field(default=None)
    velocity: Converted[Float[Array, "3"], Vector] = number(default=(0.0, 0.0, 0.0))
    angular_velocity: Converted[Float[Array, "3"], Vector] = number(default=(0.0, 0.0, 0.0))
    extent: Converted[Float[Array, "*corners 3"], Vector] = number(default=(0.2, 0.1, 0.1))
    points: Converted[NamedPoints, Mapping[str, Vector]] = by_name(default=())
    com: Converted[Float[Array, "3"] | None, Vector | None] = number(default=None)
    modes: ClassVar[int] = 0  # type: ignore[misc]

    @property
    def centre(self) -> Float[Array, "3"] | None:
        return self.com

    @property
    def constant_mass(self) -> bool:
        return False

    @property
    def inverts_mass(self) -> bool:
        return True

    def start(self) -> tuple[Float[Array, "7"], Float[Array, "7"]]:
        return frame_start(self)

    def named_points(self) -> Mapping[str, Float[Array, "3"]]:
        return self.points.mapping()

    def mass_matrix(self, q: Float[Array, "7"]) -> Float[Array, "7 7"]:
        """diag(m I, M_pp) with M_pp = (4 Gᵀ J G + μ p pᵀ) / s².

        The kinetic energy ½ ωᵀ J ω with ω = 2 G ṗ / s knows nothing of the length of p. The second
        term gives it the inertia μ, so that the matrix is definite; no force acts on the length.
        """
        p = q[3:]
        body, s = quaternions.body_matrix(p), quaternions.squared(p)
        tensor = self._tensor()
        along = length_inertia(tensor) * p[:, None] * p[None]
        turning = 4 * multiply_transposed(body, multiply(tensor, body)) + along
        return _blocks(self.mass * jnp.eye(3, dtype=q.dtype), turning / s**2)

    def invariants(self) -> SpatialInertia:
        return SpatialInertia(self.mass, self._tensor())

    def inverse_mass(self, q: Float[Array, "7"]) -> FrameInverse:
        core = 1 / self.inertia if self.inertia.ndim == 1 else invert(self.inertia)
        length = length_inertia(self._tensor())
        return FrameInverse(1 / self.mass, core, 1 / length, spin_of(q[3:]))

    def quadratic_velocity_force(
        self, q: Float[Array, "7"], v: Float[Array, "7"]
    ) -> Float[Array, "7"]:
        """Return the force of Euler's equation J ω̇ = −ω × J ω, at ρ̈ = 0 of the length ρ = ln |p|.

        With r = pᵀṗ: 2 Gᵀ τ/s + μ (2 r²/s − ṗᵀṗ) p/s², where τ = 2 r h/s − ω × h and h = J ω. The
        first term of τ is there since ω̇ = 2 G p̈/s − 2 r ω/s.
        """
        p, rate, tensor = q[3:], v[3:], self._tensor()
        s, r = quaternions.squared(p), jnp.sum(p * rate)
        omega = quaternions.body_angular_velocity(p, rate)
        momentum = multiply(tensor, omega)
        torque = 2 * r / s * momentum - quaternions.cross(omega, momentum)
        along = length_inertia(tensor) * (2 * r**2 / s - quaternions.squared(rate)) / s**2
        turning = 2 / s * quaternions.apply_transposed(quaternions.body_matrix(p), torque)
        return jnp.concatenate([jnp.zeros(3, q.dtype), turning + along * p])

    def _tensor(self) -> Float[Array, "3 3"]:
        if self.inertia.ndim == 2:
            return self.inertia
        return self.inertia[None] * jnp.eye(3, dtype=self.inertia.dtype)

    def elastic_energy(self, q: Float[Array, "7"]) -> Float[Array, ""]:
        return jnp.zeros((), q.dtype)

    def first_moment(self, q: Float[Array, "7"]) -> Float[Array, "3"]:
        return self.mass * q[:3]

    def mode_shapes(self, point: Float[Array, "3"]) -> Float[Array, "6 0"]:
        return jnp.zeros((6, 0), point.dtype)

    def outline(self) -> Float[Array, "points 3"]:
        if self.extent.ndim == 2:
            return jnp.concatenate([self.extent, self.extent[:1]])
        return cuboid(self.extent)

    def check(self) -> None:
        check_name(self.name)
        owner = f"body '{self.name}'"
        check_mass(owner, self)
        check_inertia(owner, self.inertia)
        check_finite(owner, "extent", self.extent)
        check_start(owner, self)
        self.points.check(owner, dimension=3)


def _blocks(moving: Float[Array, "3 3"], turning: Float[Array, "4 4"]) -> Float[Array, "7 7"]:
    """The matrix with two blocks on its diagonal."""
    return jnp.pad(moving, ((0, 4), (0, 4))) + jnp.pad(turning, ((3, 0), (3, 0)))


def check_inertia(owner: str, inertia: Array) -> None:
    """Refuse what is no inertia tensor: its moments are positive, none larger than the others'
    sum, as mass at a distance has it.
    """
    if inertia.shape not in ((3,), (3, 3)):
        raise SceneError(
            f"{owner}: inertia has the shape {inertia.shape}; give three principal moments, or the "
            "tensor (3, 3) [kg m²].",
            field="inertia",
        )
    check_finite(owner, "inertia", inertia)
    known = concrete(as_array(inertia))
    if known is None:
        return
    if known.ndim == 2 and np.max(np.abs(known - known.T)) > 1e-9 * np.max(np.abs(known)):
        raise SceneError(f"{owner}: the inertia tensor {known.tolist()} is not symmetric.")
    moments = np.sort(known) if known.ndim == 1 else np.linalg.eigvalsh(known)
    if not moments[0] > 0:
        raise SceneError(
            f"{owner}: a moment of inertia is {moments[0]:g}, but it must be positive. Give a "
            "point mass small moments, and a thin rod a small one along its axis."
        )
    # A plate has exactly the sum of both others, but for the rounding of its eigenvalues.
    if moments[2] > (moments[0] + moments[1]) * (1 + 1e-9):
        raise SceneError(
            f"{owner}: the principal moments {moments.tolist()} are those of no body: the largest "
            "must not exceed the sum of the others. Check the signs of products of inertia."
        )
