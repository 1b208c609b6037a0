"""A slender elastic beam in a floating frame."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..fields import (
    Number,
    SceneError,
    Vector,
    as_array,
    check_finite,
    check_positive,
    check_shape,
    number,
)
from .base import AbstractBody, check_name, check_start
from .modes import free_free_roots, free_free_shapes


class Beam(AbstractBody):
    """A uniform beam that bends: floating frame and free-free Euler–Bernoulli modes.

    Coordinates x, y [m], φ [rad] of the frame in the undeformed centre of mass, then one
    amplitude per mode, mass-normalised [kg^½ m]. The modes are orthogonal to rigid motion, so the
    mass matrix is exactly diag(m, m, J + |q_f|², 1, …) and nothing else couples.
    Small deflections; longitudinal stiffness is infinite; no geometric stiffening.

    **Arguments:**

    - `name`: unique in the scene.
    - `mass`: Mass [kg]. `length`: Length [m].
    - `EI` and `modes`: bending stiffness [N m²] and the number of modes, or
    - `frequencies`: free-free natural frequencies [Hz], one per mode (they need not fit any EI).
      Neither: a rigid bar.
    - `inertia`: about the centre [kg m²]; that of a thin bar, m L²/12, unless given.
    - `axis`: "x": along the local x axis, deflecting along local y; "y": along y, deflecting
      along x (the chapter's pendulum). Every mode deflects by +2/√m at the end with the lower
      coordinate.
    - `position`, `angle`, `velocity`, `angular_velocity`: initial place and motion of the frame.
    - `amplitudes`, `rates`: initial modal coordinates and velocities, zero unless given.
    """

    name: str = eqx.field(static=True)
    mass: Float[Array, ""] = number()
    length: Float[Array, ""] = number()
    EI: Float[Array, ""] | None = number(None)
    frequencies: Float[Array, " modes"] | None = number(None)
    inertia: Float[Array, ""] | None = number(None)
    position: Float[Array, "2"] = number((0.0, 0.0))
    angle: Float[Array, ""] = number(0.0)
    velocity: Float[Array, "2"] = number((0.0, 0.0))
    angular_velocity: Float[Array, ""] = number(0.0)
    amplitudes: Float[Array, " modes"] = number(())
    rates: Float[Array, " modes"] = number(())
    modes: int = eqx.field(static=True, default=0)
    axis: str = eqx.field(static=True, default="x")

    def __init__(
        self,
        name: str,
        mass: Number,
        length: Number,
        *,
        EI: Number | None = None,
        modes: int | None = None,
        frequencies: Vector | None = None,
        inertia: Number | None = None,
        axis: str = "x",
        position: Vector = (0.0, 0.0),
        angle: Number = 0.0,
        velocity: Vector = (0.0, 0.0),
        angular_velocity: Number = 0.0,
        amplitudes: Vector | None = None,
        rates: Vector | None = None,
    ):
        if frequencies is not None and EI is not None:
            raise SceneError(f"body '{name}': give either EI or frequencies, not both.")
        if EI is None and frequencies is None and modes:
            raise SceneError(f"body '{name}': {modes} modes need EI or frequencies.")
        if EI is not None and modes is None:
            raise SceneError(f"body '{name}': with EI, say how many modes, such as modes=2.")
        given = None if frequencies is None else jnp.atleast_1d(as_array(frequencies))
        if given is not None and modes not in (None, len(given)):
            raise SceneError(
                f"body '{name}': modes={modes}, but {len(given)} frequencies are given."
            )
        self.name, self.axis = name, axis
        self.modes = len(given) if given is not None else modes or 0
        self.mass, self.length, self.frequencies = as_array(mass), as_array(length), given
        self.EI = None if EI is None else as_array(EI)
        self.inertia = None if inertia is None else as_array(inertia)
        self.position, self.angle = as_array(position), as_array(angle)
        self.velocity, self.angular_velocity = as_array(velocity), as_array(angular_velocity)
        zero = jnp.zeros(self.modes)
        self.amplitudes = zero if amplitudes is None else as_array(amplitudes)
        self.rates = zero if rates is None else as_array(rates)

    def __check_init__(self) -> None:
        self.check()

    @property
    def constant_mass(self) -> bool:
        return self.modes == 0

    def natural_frequencies(self) -> Float[Array, " modes"]:
        """Angular frequencies ω [rad/s] of the free-free modes, ω² = (βL)⁴ EI / (m L³)."""
        if self.frequencies is not None:
            return 2 * jnp.pi * self.frequencies
        if self.EI is None:
            return jnp.zeros(0)
        root = jnp.asarray(free_free_roots(self.modes), self.mass.dtype)
        return root**2 * jnp.sqrt(self.EI / (self.mass * self.length**3))

    def start(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        return (
            jnp.concatenate([self.position, self.angle[None], self.amplitudes]),
            jnp.concatenate([self.velocity, self.angular_velocity[None], self.rates]),
        )

    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, " size"]:
        inertia = self.mass * self.length**2 / 12 if self.inertia is None else self.inertia
        if self.modes == 0:
            return jnp.stack([self.mass, self.mass, inertia])
        rigid = jnp.stack([self.mass, self.mass, inertia + q[3:] @ q[3:]])
        return jnp.concatenate([rigid, np.ones(self.modes, q.dtype)])

    def elastic_energy(self, q: Float[Array, " size"]) -> Float[Array, ""]:
        return 0.5 * jnp.sum((self.natural_frequencies() * q[3:]) ** 2)

    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, "2"]:
        return self.mass * q[:2]

    def mode_shapes(self, point: Float[Array, "2"]) -> Float[Array, "3 modes"]:
        along = point[0 if self.axis == "x" else 1]
        deflection, slope = free_free_shapes(along, self.length, self.modes)
        none = jnp.zeros_like(deflection)
        # The tangent (1, w') has turned counter-clockwise, the tangent (w', 1) clockwise.
        rows = [none, deflection, slope] if self.axis == "x" else [deflection, none, -slope]
        return jnp.stack(rows) / jnp.sqrt(self.mass)

    def outline(self) -> Float[Array, "points 2"]:
        along = self.length * jnp.linspace(-0.5, 0.5, 2 if self.modes == 0 else 21)
        across = jnp.zeros_like(along)
        return jnp.stack([along, across] if self.axis == "x" else [across, along], axis=1)

    def check(self) -> None:
        check_name(self.name)
        owner = f"body '{self.name}'"
        if self.axis not in ("x", "y"):
            raise SceneError(f"{owner}: axis is {self.axis!r}, but it must be 'x' or 'y'.")
        for field in ("mass", "length", "EI", "inertia"):
            value = getattr(self, field)
            if value is not None:
                check_shape(owner, field, value, ())
                check_finite(owner, field, value)
                check_positive(owner, field, value)
        if self.frequencies is not None:
            check_shape(owner, "frequencies", self.frequencies, (self.modes,))
            check_finite(owner, "frequencies", self.frequencies)
            check_positive(owner, "frequencies", self.frequencies)
        for field in ("amplitudes", "rates"):
            check_shape(owner, field, getattr(self, field), (self.modes,))
            check_finite(owner, field, getattr(self, field))
        check_start(owner, self)
