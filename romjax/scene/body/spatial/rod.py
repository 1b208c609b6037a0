"""A slender elastic rod in space that bends and twists as far as it likes."""

from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import Number, Vector, as_array, each, namespace, untraced
from ...fields import number
from ...orientation import orientation_field, quaternion_of
from ...points import NamedPoints, by_name
from ..rod_base import AbstractRod
from ..sections import AbstractSection, check_section
from ..strain_modes import STATIC
from .rod_checks import check_what_shapes_need
from .rod_inertia import first_moment, first_moment_slope, mass_matrix, velocity_force
from .rod_kinematics import Line, Material, gradient, material, pose
from .rod_law import law, split
from .rod_shapes import Ratios, natural_strains
from .rod_strains import SpatialStrains


class Rod(AbstractRod):
    """A uniform rod in space that bends and twists as far as it likes: a floating frame and
    amplitudes of strains.

    Coordinates x, y, z [m] and the quaternion of the frame, then amplitudes a, of which twist and
    both curvatures are linear functions: R' = R κ̃, κ = κ₀ + Σ a_k κ_k(s) by the axes of the
    section R, whose x is along the undeformed rod. Points are at r' = R (1 + ε, γ_y, γ_z);
    ε = γ = 0 unless `EA`, `GA` are given (Simo 1985, doi:10.1016/0045-7825(85)90050-7). Rotations
    go from Gauss point to Gauss point by steps of order six, and mass, forces and markers follow
    from the same points, so that energy is kept. Where it bends little, take a `Beam`.

    **Arguments:**

    - `name`: unique in the scene.
    - `mass`: Mass [kg]. `length`: Length [m].
    - `EI`: bending stiffness [N m²] about local y and z (2,), or one number for both. `GJ`:
      torsional stiffness [N m²].
    - `rotary`: rotary inertia of the sections [kg m] about local x, y and z, (3,); that about x,
      which twist moves, must be positive.
    - `modes`: the number of amplitudes, of all strains together.
    - `EA`: stiffness in stretch [N]. `GA`: in shear along local y and z (2,), or one number for
      both. Infinite unless given; `GA` needs all of `rotary`.
    - `coupling`: symmetric matrix of what couples strains in the section, in the order twist,
      curvature about y and z, stretch, shear along y and z, without those that it has not: (3, 3)
      to (6, 6) with zeros on the diagonal; none unless given. See `of_stiffness`.
    - `curvature`: twist and curvature about y and z of the undeformed rod [1/m], (3,), or the
      coefficients (3, k) of their Legendre polynomials from start to end; straight unless given.
    - `shapes`: "static" unless given: polynomials, for statics. For dynamics the natural modes by
      the supports of start and end, such as "hinged-free": each is "free", "pinned" (a ball joint),
      "hinged" about local z or "clamped"; see `Rod` in the plane. Of a round section bending modes
      come in pairs.
    - `loaded`: natural modes with the static shapes of forces and torques at the ends among them.
    - `nodes`: the number of Gauss points; enough for a full circle unless given.
    - `retardation`: time η [s] of Kelvin–Voigt damping, strains ε + η ε̇; none unless given.
    - `damping`: damping ratios ζ of the modes, or one for all; none unless given.
    - `position`, `orientation`, `velocity`, `angular_velocity`: initial pose and motion of the
      frame, as of a rigid body. It follows the section at the supported end, in the middle if none
      is or of "static" shapes; its origin is half a length from the ends, along the tangent there.
    - `amplitudes`, `rates`: initial amplitudes [rad] and their rates, zero unless given.
    - `points`: points by name for `body.at("name")`, such as {"load": (0.1, 0.0, 0.0)} [m], besides
      "start" and "end": the arc length from the middle, and y and z in the section.
    """

    dimension: ClassVar[int] = 3

    name: str = eqx.field(static=True)
    mass: Float[Array, ""] = number()
    length: Float[Array, ""] = number()
    EI: Float[Array, "2"] = number()
    GJ: Float[Array, ""] = number()
    rotary: Float[Array, "3"] = number()
    strains: SpatialStrains
    EA: Float[Array, ""] | None = number(default=None)
    GA: Float[Array, "2"] | None = number(default=None)
    coupling: Float[Array, "kinds kinds"] | None = number(default=None)
    curvature: Float[Array, "3 *k"] | None = number(default=None)
    retardation: Float[Array, ""] | None = number(default=None)
    damping: Float[Array, " natural"] | None = number(default=None)
    position: Float[Array, "3"] = number(default=(0.0, 0.0, 0.0))
    orientation: Float[Array, "4"] = orientation_field(default=None)
    velocity: Float[Array, "3"] = number(default=(0.0, 0.0, 0.0))
    angular_velocity: Float[Array, "3"] = number(default=(0.0, 0.0, 0.0))
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
        EI: Vector | Number,
        GJ: Number,
        rotary: Vector,
        modes: int,
        *,
        EA: Number | None = None,
        GA: Vector | Number | None = None,
        coupling: Vector | None = None,
        curvature: Vector | None = None,
        shapes: str = STATIC,
        loaded: bool = False,
        nodes: int | None = None,
        retardation: Number | None = None,
        damping: Vector | Number | None = None,
        position: Vector = (0.0, 0.0, 0.0),
        orientation: Vector | None = None,
        velocity: Vector = (0.0, 0.0, 0.0),
        angular_velocity: Vector = (0.0, 0.0, 0.0),
        amplitudes: Vector | None = None,
        rates: Vector | None = None,
        points: Mapping[str, Vector] | NamedPoints | None = None,
    ):
        self.name, self.modes, self.shapes = name, modes, shapes
        self.loaded, self.nodes = loaded, nodes
        self.mass, self.length, self.GJ = as_array(mass), as_array(length), as_array(GJ)
        self.EI, self.rotary = each(EI, 2), as_array(rotary)
        self.EA = None if EA is None else as_array(EA)
        self.GA = None if GA is None else each(GA, 2)
        self.coupling = None if coupling is None else as_array(coupling)
        self.curvature = None if curvature is None else as_array(curvature)
        self.retardation = None if retardation is None else as_array(retardation)
        self.damping = None if damping is None else each(damping, max(modes, 0))
        self.position = as_array(position)
        self.orientation = quaternion_of(f"body '{name}'", None, orientation)
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
        shear_modulus: Number,
        modes: int,
        **options: Any,
    ) -> "Rod":
        """A rod of a `section` and a material, with the rotary inertia of its sections.

        **Arguments:**

        - `length`: Length [m]. `section`: such as `sections.Rectangle(width, height)`, its height
          along local y.
        - `density`: ρ [kg/m³]. `modulus`: Young's modulus E [Pa]. `shear_modulus`: G [Pa].
        - `name`, `modes` and `options`: as for every rod. It is inextensible and unshearable unless
          they have `EA` and `GA`.
        """
        check_section(name, section)
        size, given = as_array(length), untraced(section.second_moment_y, section.second_moment)
        xp = namespace(given[0])
        about = as_array(xp.stack(given))
        rotary = density * as_array(xp.stack([given[0] + given[1], *given]))
        mass, torsion = density * section.area * size, shear_modulus * section.torsion_constant
        options = {"rotary": rotary, **options}
        return cls(name, mass, size, modulus * about, torsion, modes=modes, **options)

    @classmethod
    def of_stiffness(
        cls,
        name: str,
        mass: Number,
        length: Number,
        stiffness: Vector,
        rotary: Vector,
        modes: int,
        **options: Any,
    ) -> "Rod":
        """A rod with the `stiffness` matrix (6, 6) of its section in the order of forces along
        x, y and z [N], then torques about x, y and z [N m].

        The other arguments are those of every rod. Raises SceneError for another shape.
        """
        parts = split(name, stiffness)
        return cls(name, mass, length, rotary=rotary, modes=modes, **{**parts, **options})

    def _make_strains(self) -> SpatialStrains:
        bent = [] if self.curvature is None else [self.curvature]
        given = untraced(self.mass, self.length, self.EI, self.rotary, self._law(), *bent)
        xp = namespace(given[0])
        # Shapes are held as parameters vary, as those of all bases.
        mass, length, EI, rotary, own, *more = given if xp is np else jax.lax.stop_gradient(given)
        ratios = Ratios(own * length / EI[1], rotary / (mass * length), None)
        if more:
            ratios = ratios._replace(curvature=more[0].reshape(3, -1) * length)
        return natural_strains(self.shapes, self.modes, self.loaded, self.nodes, ratios, xp)

    def _law(self) -> Float[Array, "kinds kinds"]:
        """The stiffness [N m] of the section by the strains that amplitudes are of."""
        return law(self.length, self.EI, self.GJ, self.EA, self.GA, self.coupling)

    @property
    def _line(self) -> Line:
        if self.curvature is None:
            return Line(self.strains, self.length, None)
        curvature, length = untraced(self.curvature, self.length)
        return Line(self.strains, self.length, curvature.reshape(3, -1) * length)

    @property
    def _unit_stiffness(self) -> Float[Array, ""]:
        return self.EI[1]

    def _elastic(self, amplitudes: Float[Array, " modes"]) -> Float[Array, " modes"]:
        basis = self.strains.basis
        strains = self._law() @ (basis @ amplitudes)
        weighted = strains / (2 * np.arange(basis.shape[1]) + 1.0)[None]
        return weighted.reshape(-1) @ basis.reshape(-1, self.modes)

    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, "size *size"]:
        return mass_matrix(self._line, self.mass, self.rotary, q)

    def quadratic_velocity_force(
        self, q: Float[Array, " size"], v: Float[Array, " size"]
    ) -> Float[Array, " size"]:
        return velocity_force(self._line, self.mass, self.rotary, q, v)

    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, "3"]:
        return first_moment(self._line, self.mass, q)

    def first_moment_slope(self, q: Float[Array, " size"]) -> Float[Array, "3 size"]:
        return first_moment_slope(self._line, self.mass, q)

    def prepare(self, point: Float[Array, "3"]) -> Material:
        return material(self._line, point)

    def local_pose(self, prepared: Material, amplitudes: Any) -> tuple[Any, Any]:
        return pose(self._line, prepared, amplitudes)

    def local_gradient(self, prepared: Material, amplitudes: Any) -> Any:
        return gradient(self._line, prepared, amplitudes)
