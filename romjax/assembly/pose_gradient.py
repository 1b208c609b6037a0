"""Derivatives of poses with respect to the coordinates of their bodies."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..linalg.dense import multiply
from ..scene.marker import Pose


class PoseGradient(NamedTuple):
    """The gradient of a pose, or of several (leading axis), by all coordinates after x, y (and z).

    A frame that moves without turning takes its markers along: by its x, y and z the derivative of
    a position is the unit matrix, that of a turn zero.
    """

    position: Float[Array, "... d others"]
    turn: Float[Array, "... others"]

    def chain(self, slope: Pose, turns: bool = True) -> Float[Array, "count rows size"]:
        """The derivatives of residuals whose `slope` by the poses has a row for each of them.

        `turns`: whether they depend on the turns of the poses.
        """
        others = multiply(slope.position, self.position)
        if turns and self.position.shape[-2] == 2:
            others += slope.turn[:, :, None] * self.turn[:, None]
        elif turns:
            others += multiply(slope.turn, self.turn)
        return jnp.concatenate([slope.position, others], axis=2)
