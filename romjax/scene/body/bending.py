"""Bodies whose points move far against their frame, not linearly in their amplitudes."""

import abc
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import as_array, as_jax
from ...compiling.program import program_once
from .base import AbstractBody

B = TypeVar("B", bound="AbstractBendingBody")


class AbstractBendingBody(AbstractBody):
    """A body with local poses of its own, which all that is on it follows."""

    @property
    def bends(self) -> bool:
        return True

    @property
    def constant_mass(self) -> bool:
        return False

    @abc.abstractmethod
    def prepare(self, point: Float[Array, " d"]) -> Any:
        """Return what the pose of a material point needs, computed once: a pytree."""

    @abc.abstractmethod
    def local_pose(self, prepared: Any, amplitudes: Float[Array, " modes"]) -> tuple[Any, Any]:
        """Position (d,) [m] of a prepared point in the frame, and how it is turned there: [rad] in
        the plane, by a unit quaternion (4,) in space.
        """

    @abc.abstractmethod
    def local_gradient(self, prepared: Any, amplitudes: Float[Array, " modes"]) -> Any:
        """The displacement of a prepared point and its turn by the axes of the frame per unit
        amplitude, (3, modes) in the plane, (6, modes) in space.
        """

    @abc.abstractmethod
    def in_span(self: B, combinations: Float[Array, "modes k"]) -> B:
        """The body whose shapes are `combinations` of its own, of which a step costs k.

        Its start is the nearest one in the modal mass there.
        """

    def first_moment_slope(self, q: Float[Array, " size"]) -> Float[Array, "d size"]:
        """∂/∂q of the first moment [kg], by autodiff unless it is known in closed form."""
        slope: Array = jax.jacfwd(self.first_moment)(q)
        return slope

    def mode_shapes(self, point: Float[Array, " d"]) -> Float[Array, "motions modes"]:
        """The local gradient where the body is undeformed."""
        undeformed = as_array((0.0,) * self.modes)
        shapes: Array = as_jax(self.local_gradient(self.prepare(point), undeformed))
        return shapes


@program_once
def nearest(
    body: AbstractBody, combinations: Float[Array, "modes k"]
) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Amplitudes and rates in a span of others, the nearest ones in the modal mass at the start."""
    q, v = body.start()
    frame = body.frame_size
    read = combinations.T @ body.mass_matrix(q)[frame:, frame:]
    given = jnp.stack([q[frame:], v[frame:]], axis=1)
    # The normal equations of least squares in the metric of M: Φᵀ M Φ z = Φᵀ M q_f.
    both = jnp.linalg.solve(read @ combinations, read @ given)
    return both[:, 0], both[:, 1]
