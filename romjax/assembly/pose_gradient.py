"""Derivatives of poses with respect to the coordinates of their bodies."""

from typing import NamedTuple

from jaxtyping import Array, Float

from ..linalg.dense import multiply
from ..scene.marker import Pose


class PoseGradient(NamedTuple):
    """Of one pose, or of several with a leading axis."""

    position: Float[Array, "... d size"]
    turn: Float[Array, "... size"]

    def chain(self, slope: Pose) -> Float[Array, "count rows size"]:
        """The derivatives of residuals whose `slope` by the poses has a row for each of them."""
        moving = multiply(slope.position, self.position)
        if self.position.shape[-2] == 2:
            return moving + slope.turn[:, :, None] * self.turn[:, None]
        return moving + multiply(slope.turn, self.turn)
