"""The base of rods in the plane and in space."""

import abc
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import as_jax, concrete, untraced
from ...common.errors import SceneError
from ..fields import check_numbers
from ..marker import Marker
from ..points import NamedPoints
from .base import check_name, check_start, flexible_start
from .bending import AbstractBendingBody, nearest

R = TypeVar("R", bound="AbstractRod")

# A marker beyond an end by more than this share of the length is none of the rod's.
_BEYOND = 1e-9


class AbstractRod(AbstractBendingBody):
    """A uniform rod with amplitudes of strains; its points are (arc length from the middle, place
    in the section).
    """

    mass: eqx.AbstractVar[Float[Array, ""]]
    length: eqx.AbstractVar[Float[Array, ""]]
    strains: eqx.AbstractVar[Any]
    if TYPE_CHECKING:
        # As fields of this class they would come before those of the rods to type checkers.
        @property
        def retardation(self) -> Float[Array, ""] | None: ...
        @property
        def damping(self) -> Float[Array, " natural"] | None: ...
        @property
        def points(self) -> NamedPoints: ...
    else:
        retardation: eqx.AbstractVar[Float[Array, ""] | None]
        damping: eqx.AbstractVar[Float[Array, " natural"] | None]
        points: eqx.AbstractVar[NamedPoints]
    mode_kind: ClassVar[str] = "strain shape"
    mode_unit: ClassVar[str] = "rad"

    @property
    def damped(self) -> bool:
        return self.modes > 0 and not (self.retardation is None and self.damping is None)

    @property
    @abc.abstractmethod
    def _unit_stiffness(self) -> Float[Array, ""]:
        """EI of the unit in which the squares of the frequencies of its shapes are."""

    @abc.abstractmethod
    def _elastic(self, amplitudes: Float[Array, " modes"]) -> Float[Array, " modes"]:
        """The elastic forces K a, linear in amplitudes."""

    def natural_frequencies(self) -> Float[Array, " modes"]:
        raise SceneError(
            f"body '{self.name}': a Rod has no modes in a frame that is held, of which frequencies "
            "could be changed; give it fewer modes, or shapes for its supports, instead of a cap."
        )

    def start(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        return flexible_start(self)

    def in_span(self: R, combinations: Float[Array, "modes k"]) -> R:
        leaves, structure = jax.tree.flatten(self)
        # The constructor would make shapes anew.
        copy: R = jax.tree.unflatten(structure, leaves)
        values = self.strains.in_span(combinations), *nearest(self, combinations)
        changed = dict(zip(("strains", "amplitudes", "rates"), values, strict=True))
        for name, value in {**changed, "modes": combinations.shape[1]}.items():
            object.__setattr__(copy, name, value)
        return copy

    def elastic_energy(self, q: Float[Array, " size"]) -> Float[Array, ""]:
        own = q[self.frame_size :]
        return 0.5 * own @ self._elastic(own)

    def damping_force(self, v: Float[Array, " size"]) -> Float[Array, " size"]:
        frame = self.frame_size
        own, rates, force = self.strains, v[frame:], jnp.zeros_like(v[frame:])
        if self.retardation is not None:
            force -= self.retardation * self._elastic(rates)
        if self.damping is not None:
            # Natural modes have unit modal mass in units of m L², as amplitudes are angles: ω²
            # follows with EI / (m L³), and damping is 2 ζ ω times the mass.
            squares = own.squares * self._unit_stiffness / (self.mass * self.length**3)
            factors = 2 * self.damping * jnp.sqrt(squares) * self.mass * self.length**2
            if own.mixing is None:
                force -= factors * rates
            else:
                force -= own.mixing.T @ (factors * (own.mixing @ rates))
        return jnp.concatenate([jnp.zeros_like(v[:frame]), force])

    def named_points(self) -> Mapping[str, Float[Array, " d"]]:
        half = untraced(self.length)[0] * np.array([0.5, 0.0, 0.0])[: self.dimension]
        return {"start": as_jax(-half), "end": as_jax(half), **self.points.mapping()}

    def outline(self) -> Float[Array, "points d"]:
        along = self.length * jnp.linspace(-0.5, 0.5, 41)
        none = [jnp.zeros_like(along)] * (self.dimension - 1)
        return jnp.stack([along, *none], axis=1)

    def check_marker(self, owner: str, marker: Marker, turning: bool = False) -> None:
        del turning
        point, length = (concrete(x) for x in (marker.point, self.length))
        if point is None or length is None or abs(point[0]) <= length * (0.5 + _BEYOND):
            return
        across = "distance from the axis" if self.dimension == 2 else "y and z in the section"
        raise SceneError(
            f"{owner}: a marker on '{self.name}' is {abs(point[0]) - length / 2:g} m beyond its "
            f"end; its points are (arc length from the middle, {across})."
        )

    def check(self) -> None:
        check_name(self.name)
        owner = f"body '{self.name}'"
        self.points.check(owner, ("start", "end"), dimension=self.dimension)
        check_numbers(owner, self, "amplitudes", "rates", shape=(self.modes,))
        check_start(owner, self)
