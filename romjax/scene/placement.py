"""Frames in other frames, by numbers that JAX does not trace."""

from typing import Any, NamedTuple

import numpy as np

from ..linalg import quaternions


class Placement(NamedTuple):
    """A frame in another: where its origin is (3,) [m], and the quaternion that turns it."""

    position: Any
    turn: Any = np.array([1.0, 0.0, 0.0, 0.0])

    @property
    def axes(self) -> Any:
        """The axes of the frame by those of the other, as columns (3, 3)."""
        return quaternions.matrix(np.asarray(self.turn))  # type: ignore[arg-type]

    def point(self, point: Any) -> Any:
        """A point of the frame in the other, or several (points, 3) [m]."""
        return np.asarray(self.position) + np.asarray(point) @ self.axes.T

    def then(self, other: "Placement") -> "Placement":
        """The frame that has the `other` place in this one."""
        turns: Any = np.asarray(self.turn), np.asarray(other.turn)
        return Placement(self.point(other.position), quaternions.product(*turns))
