"""The angle between two markers that counts full turns."""

import jax
from jaxtyping import Array, Float

from .marker import Pose


def counted_angle(a: Pose, b: Pose, *counter: Pose) -> Float[Array, ""]:
    """The angle of `a` against `b` that counts full turns [rad].

    In space no pose knows how often it has turned. A `counter` follows the angle from the start on,
    a coordinate of its own; only the number of turns is taken of it, all else of the poses.
    """
    if a.dimension == 2:
        return a.angle - b.angle
    turned = jax.lax.stop_gradient(counter[0].position[0])
    return turned + a.angle_against(b, turned)
