"""A slender elastic beam in space."""

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from ....common.arrays import Number, Vector, as_array, as_jax, concrete, each, namespace, untraced
from ....common.errors import SceneError
from ...fields import Converted, check_mass, check_numbers, number, parts
from ...orientation import orientation_field
from ...points import NamedPoints, by_name
from ..base import ORIGIN, check_name, check_start, undeflected
from ..free_modes import free_modes
from ..sections import AbstractSection, check_section
from .beam_inertia import beam_inertia, rotations
from .beam_modes import Counts, foreshortening, motion
from .flexible import AbstractFlexibleBody
from .inertia import SpatialInertia
from .rigid import check_inertia


class Beam(AbstractFlexibleBody):
    """A uniform beam in space along its local x axis, which bends, twists and stretches.

    Coordinates x, y, z [m] and the quaternion of the frame in the middle of the undeformed beam,
    then one amplitude per mode, mass-normalised [kg^½ m]: bending along y and along z, torsion,
    extension. All are modes of the free beam, orthogonal to rigid motion; from two bending modes in
    a plane, and one of the others, statics under loads at the ends are exact. Deflections against
    the frame are small; Euler–Bernoulli and Saint-Venant. Local y and z are the principal axes of
    the section, and its shear centre is its centroid.

    **Arguments:**

    - `name`: unique in the scene.
    - `mass`: Mass [kg]. `length`: Length [m].
    - `inertia`: about the middle [kg m²], about local x, y and z. That about x is the polar inertia
      of the sections, which torsion moves.
    - `EI`: bending stiffness [N m²] about local y and z (2,), or one number for both. `bending`:
      the number of modes along y and along z, or one for both.
    - `GJ`: torsional stiffness [N m²], and `torsion`, the number of modes.
    - `EA`: axial stiffness [N], and `extension`, the number of modes; inextensible without them.
    - `damping`: damping ratios ζ of the modes, or one for all; none unless given.
    - `stiffening`: with geometric stiffening: bending in both planes pulls the points of the beam
      together by ½ ∫(v'² + w'²) dx, so that tension, as in fast rotation, stiffens it.
    - `rotary`: with the rotary and gyroscopic inertia of sections that bending tilts (Rayleigh),
      as in thick shafts that spin.
    - `position`, `orientation`, `velocity`, `angular_velocity`: initial pose and motion of the
      frame, as of a rigid body.
    - `amplitudes`, `rates`: initial modal coordinates and velocities, zero unless given.
    - `points`: points by name for `body.at("name")`, such as {"load": (0.1, 0.0, 0.0)} [m], besides
      "start" and "end". Points off the axis move with their section.
    """

    dimension: ClassVar[int] = 3

    name: str = eqx.field(static=True)
    mass: Converted[Float[Array, ""]] = number()
    length: Converted[Float[Array, ""]] = number()
    inertia: Converted[Float[Array, "3"], Vector] = number()
    _: dataclasses.KW_ONLY
    EI: Converted[Float[Array, " planes"] | None, Vector | None] = number(default=None)
    GJ: Converted[Float[Array, ""] | None, Number | None] = number(default=None)
    EA: Converted[Float[Array, ""] | None, Number | None] = number(default=None)
    damping: Converted[Float[Array, " modes"] | None, Vector | None] = number(default=None)
    position: Converted[Float[Array, "3"], Vector] = number(default=ORIGIN)
    orientation: Converted[Float[Array, "4"], Vector | None] = orientation_field(default=None)
    velocity: Converted[Float[Array, "3"], Vector] = number(default=ORIGIN)
    angular_velocity: Converted[Float[Array, "3"], Vector] = number(default=ORIGIN)
    amplitudes: Converted[Float[Array, " modes"], Vector | None] = number(default=None)
    rates: Converted[Float[Array, " modes"], Vector | None] = number(default=None)
    points: Converted[NamedPoints, Mapping[str, Vector]] = by_name(default=())
    bending: Converted[tuple[int, int], tuple[int, int] | int] = parts(static=True, default=0)
    torsion: int = eqx.field(static=True, default=0)
    extension: int = eqx.field(static=True, default=0)
    stiffening: bool = eqx.field(static=True, default=False)
    rotary: bool = eqx.field(static=True, default=False)

    def __post_init__(self) -> None:
        bending: Any = self.bending
        planes = (bending, bending) if isinstance(bending, int) else tuple(bending)
        if len(planes) != 2 or min(*planes, self.torsion, self.extension) < 0:
            raise SceneError(
                f"body '{self.name}': bending={bending}, torsion={self.torsion} and "
                f"extension={self.extension} are no numbers of modes; give one for each plane of "
                "bending."
            )
        self.bending = planes
        if self.EI is not None:
            self.EI = each(self.EI, 2)
        if self.damping is not None:
            self.damping = each(self.damping, self.modes)
        undeflected(self)

    @classmethod
    def of_section(
        cls,
        name: str,
        length: Number,
        section: AbstractSection,
        *,
        density: Number,
        modulus: Number,
        shear_modulus: Number | None = None,
        **options: Any,
    ) -> "Beam":
        """A beam of a `section` and a material.

        **Arguments:**

        - `length`: Length [m]. `section`: such as `sections.Rectangle(width, height)`, its height
          along local y.
        - `density`: ρ [kg/m³]. `modulus`: Young's modulus E [Pa]. `shear_modulus`: G [Pa], for
          torsion.
        - `name` and `options`: as for every beam. Its inertia is that of the prism.
        """
        check_section(name, section)
        size, area = as_array(length), section.area
        about = jnp.stack([section.second_moment_y, section.second_moment])
        # Moments of inertia per density and length: the polar one about the axis, and those of a
        # bar and of its section about y and z.
        moments = jnp.stack([jnp.sum(about), *(area * size**2 / 12 + about)])
        stiffness: dict[str, Any] = {"EI": modulus * about}
        if options.get("torsion"):
            if shear_modulus is None:
                raise SceneError(f"body '{name}': torsion needs the shear_modulus [Pa].")
            stiffness["GJ"] = shear_modulus * section.torsion_constant
        if options.get("extension"):
            stiffness["EA"] = modulus * area
        density = as_array(density)
        inertia = density * size * moments
        return cls(name, density * area * size, size, inertia, **{**stiffness, **options})

    @property
    def modes(self) -> int:  # type: ignore[override]
        return sum(self._counts)

    @property
    def _counts(self) -> Counts:
        return Counts(*self.bending, self.torsion, self.extension)

    @property
    def inverts_mass(self) -> bool:
        return not self.rotary

    @property
    def damped(self) -> bool:
        return self.damping is not None and self.modes > 0

    @property
    def foreshortens(self) -> bool:
        return self.stiffening and sum(self.bending) > 0

    def natural_frequencies(self) -> Float[Array, " modes"]:
        """Angular frequencies ω [rad/s] of the modes of the free beam; raises SceneError if it is
        rotary, since the modes are orthonormal in the mass of the axis alone.
        """
        return super().natural_frequencies() if self.rotary else self._frequencies()

    def _frequencies(self) -> Float[Array, " modes"]:
        """√(stiffness) of the modes, mass-normalised but for rotary inertia."""
        # ω² = EI ∫w''² dξ / (m L³) of bending, GJ ∫θ'² dξ / (J_x L) of torsion and
        # EA ∫u'² dξ / (m L) of extension, for modes with ∫p² dξ = 1.
        bend = self.mass * self.length**3
        kinds = (
            (2, None if self.EI is None else self.EI[1], bend),
            (2, None if self.EI is None else self.EI[0], bend),
            (1, self.GJ, self.inertia[0] * self.length),
            (1, self.EA, self.mass * self.length),
        )
        return jnp.concatenate(
            [
                jnp.sqrt(free_modes(order, count).squares * stiffness / inertia)
                for count, (order, stiffness, inertia) in zip(self._counts, kinds, strict=True)
                if stiffness is not None
            ]
            or [jnp.zeros(0)]
        )

    def invariants(self) -> SpatialInertia:
        return beam_inertia(
            self.mass,
            self.length,
            self.inertia,
            self._counts,
            foreshortens=self.foreshortens,
            rotary=self.rotary,
        )

    def named_points(self) -> Mapping[str, Float[Array, "3"]]:
        half = untraced(self.length)[0] * np.array([0.5, 0.0, 0.0])
        return {"start": as_jax(-half), "end": as_jax(half), **self.points.mapping()}

    def elastic_energy(self, q: Float[Array, " size"]) -> Float[Array, ""]:
        return 0.5 * jnp.sum((self._frequencies() * q[7:]) ** 2)

    def damping_force(self, v: Float[Array, " size"]) -> Float[Array, " size"]:
        if self.damping is None:
            return jnp.zeros_like(v)
        modal = -2 * self.damping * self._frequencies() * v[7:]
        return jnp.concatenate([jnp.zeros_like(v[:7]), modal])

    def mode_shapes(self, point: Float[Array, "3"]) -> Float[Array, "6 modes"]:
        # NumPy compiles nothing where scenes are made and JAX does not trace.
        at, *numbers = untraced(point, self.mass, self.length, self.inertia)
        xp = namespace(at)
        mass, length, inertia = numbers
        moved, turned = motion(self._counts, at[0] / length + 0.5, xp)
        turned = turned * rotations(mass, length, inertia, self._counts)[None]
        arm = xp.cross(turned.T, at * np.array([0.0, 1.0, 1.0])).T
        return as_jax(xp.concatenate([moved / xp.sqrt(mass) + arm, turned]))

    def foreshortening(self, point: Float[Array, "3"]) -> Float[Array, "3 modes modes"]:
        along = legendre.legval(2 * point[0] / self.length, foreshortening(self._counts))
        none = jnp.zeros_like(along)
        return jnp.stack([along, none, none]) / (self.mass * self.length)

    def outline(self) -> Float[Array, "points 3"]:
        along = self.length * jnp.linspace(-0.5, 0.5, 2 if self.modes == 0 else 21)
        none = jnp.zeros_like(along)
        return jnp.stack([along, none, none], axis=1)

    def check(self) -> None:
        check_name(self.name)
        owner = f"body '{self.name}'"
        for field, stiffness in (("bending", "EI"), ("torsion", "GJ"), ("extension", "EA")):
            if np.any(getattr(self, field)) and getattr(self, stiffness) is None:
                raise SceneError(f"{owner}: {field} modes need {stiffness}.", field=field)
        if self.stiffening and not any(self.bending):
            raise SceneError(
                f"{owner}: stiffening is for beams that bend; give EI and bending.",
                field="stiffening",
            )
        check_mass(owner, self)
        check_numbers(owner, self, "length", "GJ", "EA", sign="positive")
        check_numbers(owner, self, "EI", shape=(2,), sign="positive")
        check_numbers(owner, self, "inertia", shape=(3,), sign="positive")
        check_inertia(owner, self.inertia)
        modal = (self.modes,)
        check_numbers(owner, self, "damping", shape=modal, sign="not negative")
        check_numbers(owner, self, "amplitudes", "rates", shape=modal)
        check_start(owner, self)
        self.points.check(owner, ("start", "end"), dimension=3)
        self._check_inertia(owner)

    def _check_inertia(self, owner: str) -> None:
        """The axis has the inertia of a thin bar, at least, and its sections what is left."""
        inertia, mass, length = untraced(self.inertia, self.mass, self.length)
        excess = concrete(inertia[1:] - mass * length**2 / 12)
        # A thin bar that is given by its own m L²/12 may be less than that by rounding.
        if excess is not None and np.min(excess) < -1e-9 * np.max(np.abs(self.inertia)):
            raise SceneError(
                f"{owner}: inertia is {self.inertia}, {-np.min(excess):g} less than that of a thin "
                "bar, m L²/12, about local y and z.",
                field="inertia",
            )
