"""Bodies of one coordinate that no scene has: counters of turns, and carriers of states."""

import abc
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..linalg.inverse_mass import PlainInverse
from .body.base import AbstractBody


class AbstractOneCoordinate(AbstractBody):
    """A body whose one coordinate stands in place of a frame's x; the others are still."""

    modes: ClassVar[int] = 0  # type: ignore[misc]
    constant_mass: ClassVar[bool] = True

    @abc.abstractmethod
    def weight(self) -> Float[Array, ""]:
        """The inertia of the coordinate."""

    @property
    def frame_size(self) -> int:
        return 1

    def mass_matrix(self, q: Float[Array, "1"]) -> Float[Array, "1"]:
        del q
        return self.weight()[None]

    @property
    def inverts_mass(self) -> bool:
        return True

    def inverse_mass(self, q: Float[Array, "1"]) -> PlainInverse:
        del q
        return PlainInverse(1 / self.weight()[None])

    def elastic_energy(self, q: Float[Array, "1"]) -> Float[Array, ""]:
        return jnp.zeros((), q.dtype)

    def first_moment(self, q: Float[Array, "1"]) -> Float[Array, " d"]:
        return jnp.zeros(self.dimension, q.dtype)

    def mode_shapes(self, point: Float[Array, " d"]) -> Float[Array, "motions 0"]:
        return jnp.zeros((3 if self.dimension == 2 else 6, 0), point.dtype)

    def outline(self) -> Float[Array, "0 d"]:
        return jnp.zeros((0, self.dimension))

    def check(self) -> None:
        pass
