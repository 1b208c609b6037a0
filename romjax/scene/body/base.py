"""The interface that every kind of body has."""

import abc
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...arrays import Number, Vector, concatenate
from ...deprecated import adopt, renamed
from ...errors import SceneError
from ..coordinate import Coordinate
from ..fields import check_finite, check_shape
from ..marker import GROUND, Marker, Pose
from ..placing import brought, start_pose, started
from ..points import point_of
from .inertia import Inertia

T = TypeVar("T", bound="AbstractBody")


class AbstractBody(eqx.Module):
    """A body in a floating frame of reference.

    Coordinates: x [m], y [m], φ [rad] of its frame, then modal amplitudes. Everything is written
    for one body; the assembled system maps it over equal bodies. Forces and the quadratic velocity
    vector follow from these functions by autodiff.
    """

    name: eqx.AbstractVar[str]

    # How many modal coordinates follow x, y, φ. As a field of this class, type checkers would ask
    # for it in the constructor of a body that has it as a constant.
    if TYPE_CHECKING:
        modes = 0
    else:
        modes: eqx.AbstractVar[int]

    shortens = renamed("AbstractBody.shortens", "AbstractBody.foreshortens")
    shortening = renamed("AbstractBody.shortening", "AbstractBody.foreshortening")

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        adopt(cls, shortens="foreshortens", shortening="foreshortening")

    def __check_init__(self) -> None:
        self.check()

    @property
    @abc.abstractmethod
    def constant_mass(self) -> bool:
        """Whether the mass matrix is constant: then no quadratic-velocity code is traced."""

    @property
    def damped(self) -> bool:
        """Whether the body dissipates: if not, no code of its damping is traced."""
        return False

    @property
    def foreshortens(self) -> bool:
        """Whether bending moves its points along the axis too: a motion of second order."""
        return False

    @property
    def size(self) -> int:
        """How many generalized coordinates the body has."""
        return 3 + self.modes

    @abc.abstractmethod
    def start(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        """Initial coordinates and velocities."""

    @abc.abstractmethod
    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, "size *size"]:
        """Mass matrix of the body's own coordinates; a diagonal one as its diagonal, (size,)."""

    @abc.abstractmethod
    def elastic_energy(self, q: Float[Array, " size"]) -> Float[Array, ""]:
        """Strain energy [J]; asked only of bodies with modes."""

    def natural_frequencies(self) -> Float[Array, " modes"]:
        """Angular frequencies ω [rad/s] of the modes in the frame that is held, where they are
        orthonormal in mass and stiffness; else raises SceneError.
        """
        raise SceneError(
            f"body '{self.name}': the frequencies of its modes are not known; use a Beam, or "
            "ModalBody.of_mesh, whose modes are orthonormal."
        )

    def invariants(self) -> Inertia | None:
        """What the mass matrix is made of; None where it is made of something else."""
        return None

    def damping_force(self, v: Float[Array, " size"]) -> Float[Array, " size"]:
        """Generalized force of the body's own damping; asked only of bodies that are `damped`."""
        return jnp.zeros_like(v)

    @abc.abstractmethod
    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, "2"]:
        """Mass times position of the centre of mass, ∫ρ r dV [kg m]."""

    @abc.abstractmethod
    def mode_shapes(self, point: Float[Array, "2"]) -> Float[Array, "3 modes"]:
        """Displacement along local x and y and rotation of a material point, per unit amplitude.

        All that joints and effects know of a body's flexibility: the point X sits at
        r = R + A(φ) (X + S q_f), turned by φ + s q_f.
        """

    def foreshortening(self, point: Float[Array, "2"]) -> Float[Array, "2 modes modes"]:
        """G of a displacement −½ q_fᵀ G q_f of a material point along local x and y, beyond that
        of the mode shapes; asked only of bodies that foreshorten.
        """
        return jnp.zeros((2, self.modes, self.modes), point.dtype)

    @abc.abstractmethod
    def outline(self) -> Float[Array, "points 2"]:
        """Material points [m] whose polygon pictures the body."""

    @abc.abstractmethod
    def check(self) -> None:
        """Raise a SceneError that names body, field, value and remedy if a number is impossible."""

    def check_marker(self, owner: str, marker: Marker) -> None:
        """Raise a SceneError if the body knows nothing of the marker's point."""

    # What its modes are called.
    mode_kind: ClassVar[str] = "mode"

    def coordinates(self) -> tuple[Coordinate, ...]:
        """What each coordinate is, with its unit and symbol."""
        frame = (
            Coordinate(self.name, "x", "m", "x", f"position x of {self.name}"),
            Coordinate(self.name, "y", "m", "y", f"position y of {self.name}"),
            Coordinate(self.name, "phi", "rad", r"\varphi", f"angle of {self.name}"),
        )
        modal = [
            Coordinate(
                self.name, f"q{k}", "kg^1/2 m", f"q_{{{k}}}", f"{self.mode_kind} {k} of {self.name}"
            )
            for k in range(1, self.modes + 1)
        ]
        return (*frame, *modal)

    def labels(self) -> tuple[str, ...]:
        """Labels of the coordinates, such as "cart.x"."""
        return tuple(coordinate.label for coordinate in self.coordinates())

    def named_points(self) -> Mapping[str, Float[Array, "2"]]:
        """The material points [m] that `at`, `pose` and `placed` know by name."""
        return {}

    def at(self, point: Vector | str = (0.0, 0.0), angle: Number = 0.0) -> Marker:
        """A marker at the material `point` X [m] of the body frame, or the one of that name, turned
        by `angle` [rad].
        """
        return Marker(self.name, self._point(point), angle)

    def pose(self, point: Vector | str = (0.0, 0.0)) -> Pose:
        """Where a point, as in `at`, is at the start, and how the body is turned there."""
        return start_pose(self, self._point(point))

    def placed(self: T, point: Vector | str, to: Pose, angle: Number | None = None) -> T:
        """The body with a `point`, as in `at`, where a pose is, such as `other.pose("pin")` or
        `ground.pose((x, y))`, and its frame turned by `angle` [rad], as it is unless given.
        """
        return brought(self, self._point(point), to, angle)

    def started(self: T, q: Float[Array, " size"], v: Float[Array, " size"]) -> T:
        """The body with other initial coordinates and velocities."""
        return started(self, q, v)

    def _point(self, point: Vector | str) -> Vector:
        return point_of(f"body '{self.name}'", self.named_points(), point)


def nameless(body: T) -> T:
    """The body without its name: bodies that differ in their names only are mapped over at once."""
    leaves, structure = jax.tree.flatten(body)
    copy: T = jax.tree.unflatten(structure, leaves)
    object.__setattr__(copy, "name", "")
    return copy


def check_name(name: str) -> None:
    if not isinstance(name, str) or not name or name == GROUND:
        raise SceneError(
            f"A body is named {name!r}; give it a non-empty name of its own ('{GROUND}' is taken)."
        )


def rectangle(extent: Float[Array, "2"]) -> Float[Array, "5 2"]:
    """Closed outline of a rectangle about the origin."""
    corners = jnp.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]], extent.dtype)
    return 0.5 * extent[None] * corners


def disc(diameter: Float[Array, ""]) -> Float[Array, "points 2"]:
    """Outline of a disc about the origin: the radius along x, which shows how it turns, and once
    around.
    """
    angle = np.linspace(0.0, 2 * np.pi, 33)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return 0.5 * diameter * np.concatenate([np.zeros((1, 2)), rim])


def check_start(owner: str, body: Any) -> None:
    """Check the initial pose and motion that every kind of body has."""
    for field, shape in (
        ("position", (2,)),
        ("angle", ()),
        ("velocity", (2,)),
        ("angular_velocity", ()),
    ):
        check_shape(owner, field, getattr(body, field), shape)
        check_finite(owner, field, getattr(body, field))


def flexible_start(body: Any) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
    """Initial coordinates and velocities of a body with modes: of its frame, then modal ones."""
    return (
        concatenate([body.position, body.angle, body.amplitudes]),
        concatenate([body.velocity, body.angular_velocity, body.rates]),
    )
