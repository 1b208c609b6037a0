"""Cross-sections of beams: areas and second moments about the axis that they bend about."""

import abc
import math

import equinox as eqx
from jaxtyping import Array, Float

from ...arrays import concrete
from ...errors import SceneError
from ..fields import Converted, check_numbers, number


class AbstractSection(eqx.Module):
    """A cross-section; subclass it with two properties for one of your own."""

    @property
    @abc.abstractmethod
    def area(self) -> Float[Array, ""]:
        """A [m²]."""

    @property
    @abc.abstractmethod
    def second_moment(self) -> Float[Array, ""]:
        """I [m⁴] about the axis normal to the plane of the mechanism."""

    def __check_init__(self) -> None:
        owner = f"section '{type(self).__name__}'"
        check_numbers(owner, self, *vars(self), sign="positive")
        for left in self.hollow:
            gap = concrete(left)
            if gap is not None and not gap >= 0:
                raise SceneError(f"{owner}: its walls overlap by {-gap:g} m; make them thinner.")

    @property
    def hollow(self) -> tuple[Float[Array, ""], ...]:
        """Lengths that the walls leave free [m]; none in a solid section."""
        return ()


class Rectangle(AbstractSection):
    """A solid rectangle: `width` across the plane, `height` in it [m]."""

    width: Converted[Float[Array, ""]] = number()
    height: Converted[Float[Array, ""]] = number()

    @property
    def area(self) -> Float[Array, ""]:
        return self.width * self.height

    @property
    def second_moment(self) -> Float[Array, ""]:
        return self.width * self.height**3 / 12


class Rod(AbstractSection):
    """A solid circle of a `diameter` [m]."""

    diameter: Converted[Float[Array, ""]] = number()

    @property
    def area(self) -> Float[Array, ""]:
        return math.pi * self.diameter**2 / 4

    @property
    def second_moment(self) -> Float[Array, ""]:
        return math.pi * self.diameter**4 / 64


class Tube(AbstractSection):
    """A circular tube: outer `diameter` and thickness of its `wall` [m]."""

    diameter: Converted[Float[Array, ""]] = number()
    wall: Converted[Float[Array, ""]] = number()

    @property
    def hollow(self) -> tuple[Float[Array, ""], ...]:
        return (self.diameter - 2 * self.wall,)

    @property
    def area(self) -> Float[Array, ""]:
        return math.pi * self.wall * (self.diameter - self.wall)

    @property
    def second_moment(self) -> Float[Array, ""]:
        (inner,) = self.hollow
        return math.pi * (self.diameter**4 - inner**4) / 64


class Box(AbstractSection):
    """A rectangular tube: outer `width` and `height`, thickness of its `wall` [m]."""

    width: Converted[Float[Array, ""]] = number()
    height: Converted[Float[Array, ""]] = number()
    wall: Converted[Float[Array, ""]] = number()

    @property
    def hollow(self) -> tuple[Float[Array, ""], ...]:
        return self.width - 2 * self.wall, self.height - 2 * self.wall

    @property
    def area(self) -> Float[Array, ""]:
        return 2 * self.wall * (self.width + self.height - 2 * self.wall)

    @property
    def second_moment(self) -> Float[Array, ""]:
        width, height = self.hollow
        return (self.width * self.height**3 - width * height**3) / 12


class IProfile(AbstractSection):
    """A symmetric I: `width` and thickness of its flanges, `height` over all, thickness of its
    `web` [m], loaded in the plane of the web.
    """

    width: Converted[Float[Array, ""]] = number()
    height: Converted[Float[Array, ""]] = number()
    flange: Converted[Float[Array, ""]] = number()
    web: Converted[Float[Array, ""]] = number()

    @property
    def hollow(self) -> tuple[Float[Array, ""], ...]:
        return self.width - self.web, self.height - 2 * self.flange

    @property
    def area(self) -> Float[Array, ""]:
        return 2 * self.width * self.flange + self.web * (self.height - 2 * self.flange)

    @property
    def second_moment(self) -> Float[Array, ""]:
        beside, inner = self.hollow
        return (self.width * self.height**3 - beside * inner**3) / 12
