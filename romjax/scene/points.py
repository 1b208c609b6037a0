"""Points of bodies, and of the ground, by name."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import equinox as eqx
from jaxtyping import Array, Float

from ..common.arrays import Vector, as_array
from ..common.checks import unknown_name
from ..common.errors import SceneError
from .fields import check_finite, check_shape

__all__ = ["NamedPoints", "by_name", "point_of"]


class NamedPoints(eqx.Module):
    """Material points [m] by their `names`: for `body.at("pin")`, no more. Names are static."""

    names: tuple[str, ...] = eqx.field(static=True)
    positions: tuple[Float[Array, " d"], ...]

    @classmethod
    def of(cls, given: Any) -> "NamedPoints":
        """Make named points from a mapping of names to positions; NamedPoints stay as they are."""
        if isinstance(given, NamedPoints):
            return given
        named = dict(given)
        return cls(tuple(named), tuple(as_array(position) for position in named.values()))

    def mapping(self) -> dict[str, Float[Array, " d"]]:
        return dict(zip(self.names, self.positions, strict=True))

    def check(self, owner: str, taken: tuple[str, ...] = (), dimension: int = 2) -> None:
        """Raise a SceneError that names owner, point and remedy; `taken`: names it cannot have."""
        for name, position in self.mapping().items():
            if not isinstance(name, str) or not name or name in taken:
                raise SceneError(f"{owner}: a point is named {name!r}; give it another name.")
            check_shape(owner, f"point '{name}'", position, (dimension,))
            check_finite(owner, f"point '{name}'", position)


if TYPE_CHECKING:  # why, see fields.py
    from equinox import field as by_name
else:

    def by_name(**kwargs: Any) -> Any:
        """A field that holds points by name, of any mapping."""
        return eqx.field(converter=NamedPoints.of, **kwargs)


def point_of(owner: str, known: Mapping[str, Any], point: Vector | str) -> Vector:
    """The point itself, or the one of that name among those that are `known`."""
    if not isinstance(point, str):
        return point
    if point not in known:
        raise SceneError(str(unknown_name(owner, "point", point, known)))
    position: Vector = known[point]
    return position
