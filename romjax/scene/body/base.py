"""The interface that every kind of body has."""

import abc
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Number, Vector, as_array, concatenate, untraced
from ...common.errors import SceneError
from ...linalg import quaternions
from ...linalg.inverse_mass import AbstractBodyInverse
from ..coordinate import Coordinate, frame_coordinates, frame_size
from ..fields import check_finite, check_shape
from ..marker import GROUND, Marker, Pose
from ..placing import apart, brought, start_pose, started
from ..points import point_of
from .inertia import Inertia
from .spatial.inertia import SpatialInertia

T = TypeVar("T", bound="AbstractBody")
# The origin of a frame in space.
ORIGIN = (0.0, 0.0, 0.0)


class AbstractBody(eqx.Module):
    """A body in a floating frame of reference.

    Coordinates: those of its frame, then modal amplitudes. A frame in the plane has x [m], y [m]
    and φ [rad]; one in space x, y, z [m] and a quaternion w, x, y, z of any length. Everything is
    written for one body; the assembled system maps it over equal bodies. Forces and the quadratic
    velocity vector follow from these functions by autodiff.
    """

    # 2 in the plane, 3 in space.
    dimension: ClassVar[int] = 2

    name: eqx.AbstractVar[str]

    # How many modal coordinates follow those of the frame. As a field of this class, type checkers
    # would ask for it in the constructor of a body that has it as a constant.
    if TYPE_CHECKING:
        modes = 0
    else:
        modes: eqx.AbstractVar[int]

    def __check_init__(self) -> None:
        self.check()

    @property
    @abc.abstractmethod
    def constant_mass(self) -> bool:
        """Whether the mass matrix is constant: then no quadratic-velocity code is traced."""

    @property
    def centre(self) -> Float[Array, " d"] | None:
        """The place of the origin of its coordinates in the frame that its points are in [m]; None
        of bodies whose coordinates are those of that frame.
        """
        return None

    @property
    def damped(self) -> bool:
        """Whether the body dissipates: if not, no code of its damping is traced."""
        return False

    @property
    def foreshortens(self) -> bool:
        """Whether bending moves its points along the axis too: a motion of second order."""
        return False

    @property
    def bends(self) -> bool:
        """Whether the body has local poses of its own, which are not linear in its amplitudes."""
        return False

    @property
    def frame_size(self) -> int:
        """How many of its coordinates are those of its frame."""
        return frame_size(self.dimension)

    @property
    def inverts_mass(self) -> bool:
        """Whether the inverse of the mass matrix is known in closed form."""
        return False

    @property
    def size(self) -> int:
        """How many generalized coordinates the body has."""
        return self.frame_size + self.modes

    @abc.abstractmethod
    def start(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        """Initial coordinates and velocities."""

    @abc.abstractmethod
    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, "size *size"]:
        """Mass matrix of the body's own coordinates; a diagonal one as its diagonal, (size,)."""

    def inverse_mass(self, q: Float[Array, " size"]) -> AbstractBodyInverse:
        """Inverse of the mass matrix; asked only of bodies that have one in closed form."""
        raise NotImplementedError

    def quadratic_velocity_force(
        self, q: Float[Array, " size"], v: Float[Array, " size"]
    ) -> Float[Array, " size"] | None:
        """−Ṁ v + ½ ∂(vᵀ M v)/∂q in closed form; None where autodiff has to give it."""
        del q, v
        return None

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

    def invariants(self) -> Inertia | SpatialInertia | None:
        """Return the inertia invariants of the mass matrix; None where it is not made of them."""
        return None

    def damping_force(self, v: Float[Array, " size"]) -> Float[Array, " size"]:
        """Generalized force of the body's own damping; asked only of bodies that are `damped`."""
        return jnp.zeros_like(v)

    @abc.abstractmethod
    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, " d"]:
        """Mass times position of the centre of mass, ∫ρ r dV [kg m]."""

    @abc.abstractmethod
    def mode_shapes(self, point: Float[Array, " d"]) -> Float[Array, "motions modes"]:
        """Displacement along the local axes and rotation of a material point, per unit amplitude:
        three rows in the plane, six in space.

        All that joints and effects know of a body's flexibility: the point X sits at
        r = R + A (X + S q_f), turned by φ + s q_f in the plane, by p ⊗ (1, ½ s q_f) in space.
        """

    def foreshortening(self, point: Float[Array, " d"]) -> Float[Array, "d modes modes"]:
        """G of a displacement −½ q_fᵀ G q_f of a material point along the local axes, beyond that
        of the mode shapes; asked only of bodies that foreshorten.
        """
        return jnp.zeros((self.dimension, self.modes, self.modes), point.dtype)

    @abc.abstractmethod
    def outline(self) -> Float[Array, "points d"]:
        """Material points [m] whose polygon pictures the body."""

    @abc.abstractmethod
    def check(self) -> None:
        """Raise a SceneError that names body, field, value and remedy if a number is impossible."""

    def check_marker(self, owner: str, marker: Marker, turning: bool = False) -> None:
        """Raise a SceneError if the body knows nothing of the marker's point, or, where a part asks
        for that, of its `turning`.
        """

    # What its modes are called, and the unit of their amplitudes.
    mode_kind: ClassVar[str] = "mode"
    mode_unit: ClassVar[str] = "kg^1/2 m"

    def coordinates(self) -> tuple[Coordinate, ...]:
        """Return the body's coordinates, with their units and symbols."""
        frame = frame_coordinates(self.name, self.dimension)
        modal = [
            Coordinate(
                self.name,
                f"q{k}",
                self.mode_unit,
                f"q_{{{k}}}",
                f"{self.mode_kind} {k} of {self.name}",
            )
            for k in range(1, self.modes + 1)
        ]
        return (*frame, *modal)

    def labels(self) -> tuple[str, ...]:
        """Labels of the coordinates, such as "cart.x"."""
        return tuple(coordinate.label for coordinate in self.coordinates())

    def named_points(self) -> Mapping[str, Float[Array, " d"]]:
        """The material points [m] that `at`, `pose` and `placed` know by name."""
        return {}

    def at(
        self,
        point: Vector | str | None = None,
        angle: Number = 0.0,
        *,
        axis: Vector | None = None,
        rotation: Vector | None = None,
    ) -> Marker:
        """A marker at the material `point` X [m] of the body frame, or the one of that name, or at
        the origin; in the plane it is turned by `angle` [rad].

        In space its z axis, which is that of joints, is along `axis` (3,), and it is turned by
        `angle` about it; or it is turned by a `rotation`, a matrix (3, 3) or a quaternion (4,). An
        `axis` gives each marker an x axis of its own, by the shortest rotation of its body's axes:
        angles between two markers begin at those of both, unless a `rotation` says which.
        """
        return Marker.fixed(self.name, self._point(point), angle, axis, rotation)

    def pose(self, point: Vector | str | None = None) -> Pose:
        """Return the pose at the start of a point, as in `at`, turned as the body is there."""
        return start_pose(self, self._point(point))

    def placed(
        self: T,
        point: Vector | str,
        to: Pose,
        angle: Number | None = None,
        *,
        rotation: Vector | None = None,
    ) -> T:
        """The body with a `point`, as in `at`, where a pose is, such as `other.pose("pin")` or
        `ground.pose((x, y))`, and its frame turned by `angle` [rad] in the plane, by a `rotation`,
        a matrix (3, 3) or a quaternion (4,), in space; as it is unless given.
        """
        return brought(self, self._point(point), to, angle, rotation)

    def started(self: T, q: Float[Array, " size"], v: Float[Array, " size"]) -> T:
        """The body with other initial coordinates and velocities."""
        return started(self, q, v)

    def _point(self, point: Vector | str | None) -> Vector:
        if point is None:
            return (0.0,) * self.dimension
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


def check_start(owner: str, body: Any) -> None:
    """Check the initial pose and motion that every kind of body has."""
    flat = body.dimension == 2
    vector: tuple[int, ...] = (body.dimension,)
    for field, shape in (
        ("position", vector),
        ("angle", ()) if flat else ("orientation", (4,)),
        ("velocity", vector),
        ("angular_velocity", () if flat else vector),
    ):
        check_shape(owner, field, getattr(body, field), shape)
        check_finite(owner, field, getattr(body, field))
    if body.centre is not None:
        check_shape(owner, "com", body.centre, vector)
        check_finite(owner, "com", body.centre)


def frame_start(body: Any) -> tuple[Float[Array, " frame"], Float[Array, " frame"]]:
    """Initial coordinates and velocities of the frame, of the fields of every kind of body."""
    if body.dimension == 2:
        turn, turning = body.angle, body.angular_velocity
    else:
        turn = body.orientation
        turning = quaternions.derivative(*untraced(turn, body.angular_velocity))
    if body.centre is None:
        return concatenate([body.position, turn]), concatenate([body.velocity, turning])
    position, velocity = apart(
        body.centre, body.position, turn, body.velocity, body.angular_velocity
    )
    return concatenate([position, turn]), concatenate([velocity, turning])


def flexible_start(body: Any) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
    """Initial coordinates and velocities of a body with modes: of its frame, then modal ones."""
    q, v = frame_start(body)
    return concatenate([q, body.amplitudes]), concatenate([v, body.rates])


def undeflected(body: Any) -> None:
    """Set the amplitudes and their rates to zero where a body with modes is made without them."""
    for field in ("amplitudes", "rates"):
        if getattr(body, field) is None:
            setattr(body, field, as_array((0.0,) * body.modes))
