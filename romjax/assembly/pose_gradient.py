"""Derivatives of poses with respect to the coordinates of their bodies."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
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

    def matrix(self) -> Float[Array, "count numbers size"]:
        """The derivatives of the positions and turns of poses, one below the other."""
        count, d = self.position.shape[:2]
        unit = np.broadcast_to(np.eye(d, dtype=self.position.dtype), (count, d, d))
        turn = self.turn[:, None] if d == 2 else self.turn
        still = np.zeros((count, turn.shape[1], d), self.position.dtype)
        rows = [jnp.concatenate(x, axis=2) for x in ((unit, self.position), (still, turn))]
        return jnp.concatenate(rows, axis=1)
