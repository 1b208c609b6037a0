"""A slender elastic rod in the plane that bends as far as it likes."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Number, Vector, as_array, each, namespace, untraced
from ..fields import number, radians
from ..points import NamedPoints, by_name
from .natural_strains import Ratios, natural_strains
from .rod_base import AbstractRod
from .rod_checks import check_what_shapes_need
from .rod_inertia import first_moment, first_moment_slope, mass_matrix, velocity_force
from .rod_kinematics import Line, Material, gradient, material, pose
from .sections import AbstractSection, check_section
from .strain_modes import STATIC
from .strains import Strains


class Rod(AbstractRod):
    """A uniform rod that bends as far as it likes: a floating frame and amplitudes of strains.

    Coordinates x, y [m], φ [rad] of the frame, then amplitudes a, of which the curvature is a
    linear function: θ' = κ₀ + Σ a_k κ_k(s). A large rotation is linear in them, so few predict as
    well on new loads as on known ones. Points are at r' = (1 + ε) t + γ n of the tangent t that θ
    turns; ε = γ = 0 unless `EA`, `GA` are given (Simo 1985, doi:10.1016/0045-7825(85)90050-7).
    Integrals are taken at a few Gauss points, and mass, forces and markers follow from the same
    points, so that energy is kept. Where it bends little, a `Beam` takes a third of the time.

    **Arguments:**

    - `name`: unique in the scene.
    - `mass`: Mass [kg]. `length`: Length [m]. `EI`: bending stiffness [N m²].
    - `modes`: the number of amplitudes, of all strains together.
    - `EA`, `GA`: stiffness in stretch and in shear [N]; infinite unless given.
    - `rotary`: rotary inertia of the sections, ρI [kg m]; none unless given. `GA` needs it.
    - `curvature`: of the undeformed rod [1/m], one number or the coefficients (k,) of Legendre
      polynomials from start to end; straight unless given.
    - `shapes`: "static" unless given: polynomials, exact under loads at the ends and spectrally
      accurate in statics, whose highest frequencies grow with the fourth power of `modes`, and so
      do the steps of a run. For dynamics the natural modes by the supports of start and end, such
      as "pinned-free": each is "free", "pinned" or "clamped". They carry no moment at a free or
      pinned end.
    - `loaded`: natural modes with the static shapes of forces and torques at the ends among them.
    - `nodes`: the number of Gauss points; enough for a full circle unless given. Two circles need
      some 20.
    - `retardation`: time η [s] of Kelvin–Voigt damping, strains ε + η ε̇; none unless given.
    - `damping`: damping ratios ζ of the modes, or one for all; none unless given.
    - `position`, `angle`, `velocity`, `angular_velocity`: initial pose and motion of the frame. It
      follows the supported end, the middle if none is or of "static" shapes; its origin is half a
      length from the ends, along the tangent there: in the middle of a straight rod.
    - `amplitudes`, `rates`: initial amplitudes [rad] and their rates, zero unless given.
    - `points`: points by name for `body.at("name")`, such as {"load": (0.1, 0.0)} [m], besides
      "start" and "end": the arc length from the middle, and the distance from the axis.
    """

    name: str = eqx.field(static=True)
    mass: Float[Array, ""] = number()
    length: Float[Array, ""] = number()
    EI: Float[Array, ""] = number()
    strains: Strains
    EA: Float[Array, ""] | None = number(default=None)
    GA: Float[Array, ""] | None = number(default=None)
    rotary: Float[Array, ""] = number(default=0.0)
    curvature: Float[Array, " k"] | None = number(default=None)
    retardation: Float[Array, ""] | None = number(default=None)
    damping: Float[Array, " natural"] | None = number(default=None)
    position: Float[Array, "2"] = number(default=(0.0, 0.0))
    angle: Float[Array, ""] = radians(default=0.0)
    velocity: Float[Array, "2"] = number(default=(0.0, 0.0))
    angular_velocity: Float[Array, ""] = number(default=0.0)
    amplitudes: Float[Array, " modes"] = number(default=())
    rates: Float[Array, " modes"] = number(default=())
    points: NamedPoints = by_name(default=())
    modes: int = eqx.field(static=True, default=0)
    shapes: str = eqx.field(static=True, default=STATIC)
    loaded: bool = eqx.field(static=True, default=False)
    nodes: int | None = eqx.field(static=True, default=None)

    def __init__(
        self,
        name: str,
        mass: Number,
        length: Number,
        EI: Number,
        modes: int,
        *,
        EA: Number | None = None,
        GA: Number | None = None,
        rotary: Number = 0.0,
        curvature: Vector | Number | None = None,
        shapes: str = STATIC,
        loaded: bool = False,
        nodes: int | None = None,
        retardation: Number | None = None,
        damping: Vector | Number | None = None,
        position: Vector = (0.0, 0.0),
        angle: Number = 0.0,
        velocity: Vector = (0.0, 0.0),
        angular_velocity: Number = 0.0,
        amplitudes: Vector | None = None,
        rates: Vector | None = None,
        points: Mapping[str, Vector] | NamedPoints | None = None,
    ):
        self.name, self.modes, self.shapes = name, modes, shapes
        self.loaded, self.nodes = loaded, nodes
        self.mass, self.length, self.EI = as_array(mass), as_array(length), as_array(EI)
        self.EA = None if EA is None else as_array(EA)
        self.GA = None if GA is None else as_array(GA)
        self.rotary = as_array(rotary)
        self.curvature = None if curvature is None else each(curvature, 1)
        self.retardation = None if retardation is None else as_array(retardation)
        self.damping = None if damping is None else each(damping, max(modes, 0))
        self.position, self.angle = as_array(position), as_array(angle)
        self.velocity, self.angular_velocity = as_array(velocity), as_array(angular_velocity)
        zero = as_array((0.0,) * modes)
        self.amplitudes = zero if amplitudes is None else as_array(amplitudes)
        self.rates = zero if rates is None else as_array(rates)
        self.points = NamedPoints.of(points or {})
        check_what_shapes_need(self)
        self.strains = self._make_strains()

    @classmethod
    def of_section(
        cls,
        name: str,
        length: Number,
        section: AbstractSection,
        *,
        density: Number,
        modulus: Number,
        modes: int,
        **options: Any,
    ) -> "Rod":
        """A rod of a `section` and a material, with the rotary inertia of its sections.

        **Arguments:**

        - `length`: Length [m]. `section`: such as `sections.Rectangle(width, height)`.
        - `density`: ρ [kg/m³]. `modulus`: Young's modulus E [Pa].
        - `name`, `modes` and `options`: as for every rod. It is inextensible and unshearable unless
          they have `EA` and `GA`.
        """
        check_section(name, section)
        size, second_moment = as_array(length), section.second_moment
        return cls(
            name,
            density * section.area * size,
            size,
            modulus * second_moment,
            modes,
            **{"rotary": density * second_moment, **options},
        )

    def _make_strains(self) -> Strains:
        optional = [x for x in (self.EA, self.GA, self.curvature) if x is not None]
        given = untraced(self.mass, self.length, self.EI, self.rotary, *optional)
        xp = namespace(given[0])
        # Shapes are held as parameters vary, as those of all bases.
        mass, length, EI, rotary, *more = given if xp is np else jax.lax.stop_gradient(given)
        ratios = Ratios(
            None if self.EA is None else more.pop(0) * length**2 / EI,
            None if self.GA is None else more.pop(0) * length**2 / EI,
            rotary / (mass * length),
            None if self.curvature is None else more.pop(0) * length,
        )
        return natural_strains(self.shapes, self.modes, self.loaded, self.nodes, ratios, xp)

    @property
    def _line(self) -> Line:
        if self.curvature is None:
            return Line(self.strains, self.length, None)
        curvature, length = untraced(self.curvature, self.length)
        return Line(self.strains, self.length, curvature * length)

    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, "size *size"]:
        return mass_matrix(self._line, self.mass, self.rotary, q)

    def quadratic_velocity_force(
        self, q: Float[Array, " size"], v: Float[Array, " size"]
    ) -> Float[Array, " size"]:
        return velocity_force(self._line, self.mass, q, v)

    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, "2"]:
        return first_moment(self._line, self.mass, q)

    def first_moment_slope(self, q: Float[Array, " size"]) -> Float[Array, "2 size"]:
        return first_moment_slope(self._line, self.mass, q)

    @property
    def _unit_stiffness(self) -> Float[Array, ""]:
        return self.EI

    def _elastic(self, amplitudes: Float[Array, " modes"]) -> Float[Array, " modes"]:
        own = self.strains
        # ½ ∫EI κ² ds = ½ EI/L ∫(κ L)² dξ; stretch and shear have L in place of 1/L.
        total = self.EI / self.length * own.bending
        for factor, gram in ((self.EA, own.pulling), (self.GA, own.shearing)):
            if factor is not None and gram is not None:
                total += factor * self.length * gram
        return total @ amplitudes

    def prepare(self, point: Float[Array, "2"]) -> Material:
        return material(self._line, point)

    def local_pose(self, prepared: Material, amplitudes: Any) -> tuple[Any, Any]:
        return pose(self._line, prepared, amplitudes)

    def local_gradient(self, prepared: Material, amplitudes: Any) -> Any:
        return gradient(self._line, prepared, amplitudes)
