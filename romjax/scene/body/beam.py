"""A slender elastic beam in a floating frame."""

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Number, Vector, as_array, as_jax, concrete, each, namespace, untraced
from ...common.errors import SceneError
from ..fields import Converted, check_choice, check_mass, check_numbers, number, radians
from ..points import NamedPoints, by_name
from .base import AbstractBody, check_name, check_start, flexible_start, undeflected
from .inertia import Inertia
from .modes import (
    FREE,
    SHAPES,
    bending_moments,
    bending_roots,
    bending_shapes,
    foreshortening,
    foreshortening_moments,
)
from .sections import AbstractSection, check_section


class Beam(AbstractBody):
    """A uniform beam that bends: a floating frame and Euler–Bernoulli modes.

    Coordinates x, y [m], φ [rad] of the frame in the middle of the undeformed beam, then one
    amplitude per mode, mass-normalised [kg^½ m]. Static and free-free modes are orthogonal to rigid
    motion, so the mass matrix is exactly diag(m, m, J + |q_f|², 1, …) and nothing else couples.
    From two static modes, those of `spatial.Beam`, statics under loads at the ends are exact.
    Free-free modes carry no bending moment at the ends, so that some compliance stays out at each
    weld, however many beams there are; a rod hinged at both ends bends by its inertia, of which one
    of them or three static ones get the frequency to 2 %. The frame of clamped-free and pinned-free
    modes follows the lower end, its tangent or its position, and they converge faster where that
    end alone is welded or hinged. Small deflections against the frame; longitudinal stiffness is
    infinite.

    **Arguments:**

    - `name`: unique in the scene.
    - `mass`: Mass [kg]. `length`: Length [m].
    - `EI` and `modes`: bending stiffness [N m²] and the number of modes, or
    - `frequencies`: natural frequencies of the modes [Hz], one for each (they need not fit any EI).
      Neither: a rigid bar.
    - `inertia`: about the middle [kg m²]; that of a thin bar, m L²/12, unless given.
    - `axis`: "x": along the local x axis, deflecting along local y; "y": along y, deflecting
      along x (the chapter's pendulum).
    - `shapes`: "static" unless given with `EI`, or natural modes, "free-free" with `frequencies`,
      which belong to them, "clamped-free" or "pinned-free": by the support of the end with the
      lower coordinate. Every natural mode deflects by +2/√m at its free end, at the lower one if
      both are free; a static one is positive at the lower.
    - `damping`: damping ratios ζ of the modes, or one for all; none unless given.
    - `stiffening`: with geometric stiffening: bending pulls the points of the beam together by
      ½ ∫w'² ds, so that tension, as in fast rotation, stiffens it.
    - `position`, `angle`, `velocity`, `angular_velocity`: initial pose and motion of the frame.
    - `amplitudes`, `rates`: initial modal coordinates and velocities, zero unless given.
    - `points`: points by name for `body.at("name")`, such as {"load": (0.1, 0.0)} [m], besides
      "start" and "end", those at the lower and at the upper coordinate.
    """

    name: str = eqx.field(static=True)
    mass: Converted[Float[Array, ""]] = number()
    length: Converted[Float[Array, ""]] = number()
    _: dataclasses.KW_ONLY
    EI: Converted[Float[Array, ""] | None, Number | None] = number(default=None)
    frequencies: Converted[Float[Array, " modes"] | None, Vector | None] = number(default=None)
    inertia: Converted[Float[Array, ""] | None, Number | None] = number(default=None)
    damping: Converted[Float[Array, " modes"] | None, Vector | None] = number(default=None)
    position: Converted[Float[Array, "2"], Vector] = number(default=(0.0, 0.0))
    angle: Converted[Float[Array, ""]] = radians(default=0.0)
    velocity: Converted[Float[Array, "2"], Vector] = number(default=(0.0, 0.0))
    angular_velocity: Converted[Float[Array, ""]] = number(default=0.0)
    amplitudes: Converted[Float[Array, " modes"], Vector | None] = number(default=None)
    rates: Converted[Float[Array, " modes"], Vector | None] = number(default=None)
    points: Converted[NamedPoints, Mapping[str, Vector]] = by_name(default=())
    modes: Converted[int, int | None] = eqx.field(static=True, default=None)
    axis: str = eqx.field(static=True, default="x")
    shapes: str | None = eqx.field(static=True, default=None)
    stiffening: bool = eqx.field(static=True, default=False)
    mode_kind: ClassVar[str] = "bending mode"

    def __post_init__(self) -> None:
        owner, modes = f"body '{self.name}'", self.modes
        if self.frequencies is not None and self.EI is not None:
            raise SceneError(f"{owner}: give either EI or frequencies, not both.")
        if self.EI is None and self.frequencies is None and modes:
            raise SceneError(f"{owner}: {modes} modes need EI or frequencies.", field="modes")
        if self.EI is not None and modes is None:
            raise SceneError(f"{owner}: with EI, say how many modes, such as modes=2.")
        if self.frequencies is not None:
            self.frequencies = each(self.frequencies, 1)
            count = len(self.frequencies)
            if modes not in (None, count):
                raise SceneError(
                    f"{owner}: modes={modes}, but {count} frequencies are given.", field="modes"
                )
            modes = count
        self.modes = modes or 0
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
        modes: int,
        **options: Any,
    ) -> "Beam":
        """A beam of a `section` and a material.

        **Arguments:**

        - `length`: Length [m]. `section`: such as `sections.Rectangle(width, height)`.
        - `density`: ρ [kg/m³]. `modulus`: Young's modulus E [Pa].
        - `name`, `modes` and `options`: as for every beam. Its inertia, ρ (A L³/12 + I L), counts
          the rotary inertia of the section in rigid motion.
        """
        check_section(name, section)
        size, area, second_moment = as_array(length), section.area, section.second_moment
        return cls(
            name,
            density * area * size,
            size,
            EI=modulus * second_moment,
            modes=modes,
            **{"inertia": density * (area * size**3 / 12 + second_moment * size), **options},
        )

    @property
    def _shapes(self) -> str:
        if self.shapes is not None:
            return self.shapes
        return "free-free" if self.EI is None else "static"

    @property
    def constant_mass(self) -> bool:
        return self.modes == 0

    @property
    def damped(self) -> bool:
        return self.damping is not None and self.modes > 0

    @property
    def foreshortens(self) -> bool:
        return self.stiffening and self.modes > 0

    def natural_frequencies(self) -> Float[Array, " modes"]:
        """Angular frequencies ω [rad/s] of the modes, ω² = (βL)⁴ EI / (m L³)."""
        if self.frequencies is not None:
            return 2 * jnp.pi * self.frequencies
        if self.EI is None:
            return jnp.zeros(0)
        # ω = (βL)² √(EI / (m L³)) with the roots of the shapes' frequency equation.
        root = jnp.asarray(bending_roots(self._shapes, self.modes), self.mass.dtype)
        return root**2 * jnp.sqrt(self.EI / (self.mass * self.length**3))

    def start(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        return flexible_start(self)

    def invariants(self) -> Inertia:
        moment = self.mass * self.length**2 / 12 if self.inertia is None else self.inertia
        return self._inertia(moment)

    def named_points(self) -> Mapping[str, Float[Array, "2"]]:
        half = untraced(self.length)[0] * np.array([0.5, 0.0] if self.axis == "x" else [0.0, 0.5])
        return {"start": as_jax(-half), "end": as_jax(half), **self.points.mapping()}

    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, "size *size"]:
        return self.invariants().matrix(q)

    def elastic_energy(self, q: Float[Array, " size"]) -> Float[Array, ""]:
        # Modes are mass-normalised, so that squares of frequencies are their stiffness.
        return 0.5 * jnp.sum((self.natural_frequencies() * q[3:]) ** 2)

    def damping_force(self, v: Float[Array, " size"]) -> Float[Array, " size"]:
        if self.damping is None:
            return jnp.zeros_like(v)
        modal = -2 * self.damping * self.natural_frequencies() * v[3:]
        return jnp.concatenate([jnp.zeros_like(v[:3]), modal])

    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, "2"]:
        return self._inertia().first_moment_at(q)

    def mode_shapes(self, point: Float[Array, "2"]) -> Float[Array, "3 modes"]:
        # NumPy compiles nothing where scenes are made and JAX does not trace.
        at, mass, length = untraced(point, self.mass, self.length)
        xp = namespace(at)
        along = at[0 if self.axis == "x" else 1] / length + 0.5
        deflection, slope = bending_shapes(self._shapes, self.modes, along, xp)
        slope, none = slope / length, xp.zeros_like(deflection)
        # The tangent (1, w') has turned counter-clockwise, the tangent (w', 1) clockwise.
        rows = [none, deflection, slope] if self.axis == "x" else [deflection, none, -slope]
        return as_jax(xp.stack(rows) / xp.sqrt(mass))

    def foreshortening(self, point: Float[Array, "2"]) -> Float[Array, "2 modes modes"]:
        along = foreshortening(self._shapes, self.modes, self._place(point))
        return self._lengthwise(along) / (self.mass * self.length)

    def _place(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """How far along the beam a point is, 0 to 1."""
        return point[0 if self.axis == "x" else 1] / self.length + 0.5

    def _lengthwise(self, along: Any) -> Array:
        """Components along the beam as ones along local x and y."""
        none = np.zeros(along.shape)
        return jnp.stack([along, none] if self.axis == "x" else [none, along])

    def _inertia(self, moment: Array | None = None) -> Inertia:
        terms: dict[str, Array] = {}
        if self.modes and self._shapes not in FREE:
            mean, lever = bending_moments(self._shapes, self.modes)
            none, size = np.zeros_like(mean), jnp.sqrt(self.mass)
            # Shapes that are not free move the centre of mass of their own, and turn about it.
            across, turn = ([none, mean], lever) if self.axis == "x" else ([mean, none], -lever)
            terms["shift"] = size * np.stack(across)
            terms["swing"] = size * self.length * turn
        if self.foreshortens:
            mean, lever = foreshortening_moments(self._shapes, self.modes)
            terms["spin"] = jnp.asarray(lever)
            terms["foreshortening"] = self._lengthwise(mean) / self.length
        return Inertia(self.mass, moment, **terms)

    def outline(self) -> Float[Array, "points 2"]:
        along = self.length * jnp.linspace(-0.5, 0.5, 2 if self.modes == 0 else 21)
        across = jnp.zeros_like(along)
        return jnp.stack([along, across] if self.axis == "x" else [across, along], axis=1)

    def check(self) -> None:
        check_name(self.name)
        owner = f"body '{self.name}'"
        check_choice(owner, "axis", self.axis, ("x", "y"))
        check_choice(owner, "shapes", self._shapes, SHAPES)
        if self.frequencies is not None and self.shapes == "static":
            raise SceneError(
                f"{owner}: shapes is 'static', but frequencies belong to natural modes; give EI "
                f"instead, or one of {', '.join(SHAPES[1:])}.",
                field="shapes",
            )
        if self.stiffening and not self.modes:
            raise SceneError(
                f"{owner}: stiffening is for beams with modes; give EI and modes.",
                field="stiffening",
            )
        check_mass(owner, self)
        check_numbers(owner, self, "length", "EI", "inertia", sign="positive")
        self._check_inertia(owner)
        modal = (self.modes,)
        check_numbers(owner, self, "frequencies", shape=modal, sign="positive")
        check_numbers(owner, self, "damping", shape=modal, sign="not negative")
        check_numbers(owner, self, "amplitudes", "rates", shape=modal)
        check_start(owner, self)
        self.points.check(owner, ("start", "end"))

    def _check_inertia(self, owner: str) -> None:
        """The points that supported modes move have the inertia of a thin bar, at least."""
        if self.inertia is None or not self.modes or self._shapes in FREE:
            return
        excess = concrete(self.inertia - self.mass * self.length**2 / 12)
        # A thin bar that is given by its own m L²/12 may be less than that by rounding.
        if excess is not None and excess < -1e-9 * abs(self.inertia):
            raise SceneError(
                f"{owner}: inertia is {self.inertia}, {-excess:g} less than that of a thin bar, "
                f"m L²/12, which {self.shapes} modes need.",
                field="inertia",
            )
