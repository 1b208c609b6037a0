"""The base of bodies that stand for another one."""

from collections.abc import Mapping

import equinox as eqx
from jaxtyping import Array, Float

from ..marker import Marker
from .base import AbstractBody


class AbstractWrappedBody(AbstractBody):
    """A body with the points and markers of another, `body`, and some or all of its modes."""

    body: eqx.AbstractVar[AbstractBody]

    @property
    def dimension(self) -> int:  # type: ignore[override]
        return self.body.dimension

    @property
    def damped(self) -> bool:
        return self.body.damped and self.modes > 0

    @property
    def foreshortens(self) -> bool:
        return self.body.foreshortens and self.modes > 0

    def named_points(self) -> Mapping[str, Float[Array, " d"]]:
        return self.body.named_points()

    def outline(self) -> Float[Array, "points d"]:
        return self.body.outline()

    def check_marker(self, owner: str, marker: Marker, turning: bool = False) -> None:
        self.body.check_marker(owner, marker, turning)
