"""Cross-sections of beams: areas, second moments about their principal axes, torsion constants."""

import abc
import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import concrete
from ...common.checks import check_kind
from ...common.errors import SceneError
from ..fields import Converted, check_numbers, number


class AbstractSection(eqx.Module):
    """A cross-section; subclass it with two properties for one of your own, or with four for beams
    in space. Its height is along local y of a beam along x, its width along local z.
    """

    @property
    @abc.abstractmethod
    def area(self) -> Float[Array, ""]:
        """A [m²]."""

    @property
    @abc.abstractmethod
    def second_moment(self) -> Float[Array, ""]:
        """I [m⁴] about the axis normal to the plane of the mechanism, local z."""

    @property
    def second_moment_y(self) -> Float[Array, ""]:
        """I [m⁴] about local y, for beams in space."""
        raise SceneError(self._missing("second_moment_y"))

    @property
    def torsion_constant(self) -> Float[Array, ""]:
        """J [m⁴] of the torsional stiffness G J, for beams in space."""
        raise SceneError(self._missing("torsion_constant"))

    def _missing(self, field: str) -> str:
        return f"section '{type(self).__name__}' has no {field}; beams in space need it."

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


def check_section(name: str, section: Any) -> None:
    """Raise SceneError unless a body is given a section where it asks for one."""
    remedy = "the length first, then one of romjax.sections or a section of your own"
    check_kind(f"body '{name}'", "section", section, AbstractSection, remedy, SceneError)


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

    @property
    def second_moment_y(self) -> Float[Array, ""]:
        return self.height * self.width**3 / 12

    @property
    def torsion_constant(self) -> Float[Array, ""]:
        """Saint-Venant's series (Timoshenko and Goodier, "Theory of Elasticity", section 109), of
        which the terms fall as n⁻⁵, to 1e-8 for any ratio of the sides.
        """
        odd = np.arange(1, 40, 2)
        thin, long = jnp.minimum(self.width, self.height), jnp.maximum(self.width, self.height)
        series = jnp.sum(jnp.tanh(odd * np.pi / 2 * long / thin) / odd**5)
        return long * thin**3 * (1 - 192 / np.pi**5 * thin / long * series) / 3


class Rod(AbstractSection):
    """A solid circle of a `diameter` [m]."""

    diameter: Converted[Float[Array, ""]] = number()

    @property
    def area(self) -> Float[Array, ""]:
        return math.pi * self.diameter**2 / 4

    @property
    def second_moment(self) -> Float[Array, ""]:
        return math.pi * self.diameter**4 / 64

    @property
    def second_moment_y(self) -> Float[Array, ""]:
        return self.second_moment

    @property
    def torsion_constant(self) -> Float[Array, ""]:
        return 2 * self.second_moment


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

    @property
    def second_moment_y(self) -> Float[Array, ""]:
        return self.second_moment

    @property
    def torsion_constant(self) -> Float[Array, ""]:
        return 2 * self.second_moment


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

    @property
    def second_moment_y(self) -> Float[Array, ""]:
        width, height = self.hollow
        return (self.height * self.width**3 - height * width**3) / 12

    @property
    def torsion_constant(self) -> Float[Array, ""]:
        """Bredt's 4 A² t / s of the middle line of a thin wall, s long around an area A."""
        width, height = self.width - self.wall, self.height - self.wall
        return 2 * self.wall * (width * height) ** 2 / (width + height)


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

    @property
    def second_moment_y(self) -> Float[Array, ""]:
        _, inner = self.hollow
        return (2 * self.flange * self.width**3 + inner * self.web**3) / 12

    @property
    def torsion_constant(self) -> Float[Array, ""]:
        """Σ b t³ / 3 of thin walls that are free to warp."""
        _, inner = self.hollow
        return (2 * self.width * self.flange**3 + inner * self.web**3) / 3


class Section(AbstractSection):
    """A section by its numbers: area `A` [m²], second moments I_y and I_z about local y and z
    and torsion constant `J` [m⁴]. Local y and z are its principal axes, and its shear centre is its
    centroid; romjax has no beams that twist where they bend.
    """

    A: Converted[Float[Array, ""]] = number()
    I_y: Converted[Float[Array, ""]] = number()
    I_z: Converted[Float[Array, ""]] = number()
    J: Converted[Float[Array, ""]] = number()

    @property
    def area(self) -> Float[Array, ""]:
        return self.A

    @property
    def second_moment(self) -> Float[Array, ""]:
        return self.I_z

    @property
    def second_moment_y(self) -> Float[Array, ""]:
        return self.I_y

    @property
    def torsion_constant(self) -> Float[Array, ""]:
        return self.J
