"""Flexible bodies of any shape, by their inertia invariants and mode shapes at some points."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Number, Vector, as_array, concrete, each
from ...common.errors import SceneError
from ...linalg.dense import multiply
from ..fields import Converted, check_numbers, number, parts, radians
from ..marker import Marker
from .base import AbstractBody, check_name, check_start, flexible_start, undeflected
from .component_modes import Matrix
from .finite_elements import reduce_mesh
from .inertia import Inertia
from .mesh_ports import PortNodes
from .spatial.inertia import SpatialInertia

B = TypeVar("B", bound="AbstractModalBody")


class AbstractModalBody(AbstractBody):
    """The base of bodies with inertia invariants, and with shapes at some points."""

    inertia: eqx.AbstractVar[Inertia | SpatialInertia]
    stiffness: eqx.AbstractVar[Float[Array, "modes *modes"]]
    points: eqx.AbstractVar[Float[Array, "points d"]]
    shapes: eqx.AbstractVar[Float[Array, "points motions modes"]]
    damping: eqx.AbstractVar[Float[Array, "modes *modes"] | None]
    ports: eqx.AbstractVar[tuple[str, ...]]
    unturned: eqx.AbstractVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        self.stiffness = each(self.stiffness, 1)
        self.modes = len(self.stiffness)
        undeflected(self)

    @classmethod
    def of_mesh(
        cls: type[B],
        name: str,
        stiffness: Matrix,
        mass: Matrix,
        nodes: Vector,
        ports: Mapping[str, PortNodes],
        *,
        modes: int,
        interface: str = "fixed",
        dofs: Vector | None = None,
        damping: Number | None = None,
        **start: Any,
    ) -> B:
        """A body of the matrices of a mesh, free of supports: a plane one, or in space a solid or a
        shell.

        **Arguments:**

        - `name`: unique in the scene.
        - `stiffness`, `mass`: K and M, as NumPy arrays, SciPy sparse matrices, or names of files:
          Matrix Market (`.mtx`) or SciPy's `.npz`.
        - `nodes`: positions in the body frame [m], (nodes, 2), in space (nodes, 3).
        - `ports`: where joints and effects may act: names, each with a node or with the nodes of a
          rim, an edge or a face, which are held together as by a rigid pin; markers sit in their
          mean place, `body.at("name")`. Or each with a kind and nodes: {"rigid": nodes} is the
          same; {"mean": nodes} leaves them as free as they are, moves as the rigid motion nearest
          to theirs, and shares loads among them; {"point": node} is one node, on which a mesh
          without rotations takes forces and joints of positions only.
        - `modes`: how many vibration modes. `interface`: "fixed" for Craig–Bampton, whose static
          modes represent loads at the ports exactly: 3 per port are added, in space 6, of points
          that do not turn 2 or 3, and rigid motion taken out; where no port is rigid, the vibration
          modes are those of the free body. "free" for these alone.
        - `dofs`: rows of K that belong to each node, its displacements along x and y and, if the
          mesh has them, its rotation: (nodes, 2) or (nodes, 3); in space three displacements and,
          of shells and beams, three rotations: (nodes, 3) or (nodes, 6), with −1 for the rotations
          of nodes without, such as those of solids. Node after node unless given. Rows that are in
          none of them are modal coordinates of a body that is reduced already (Craig–Bampton).
        - `damping`: damping ratio ζ of all modes; none unless given.
        - `start`: `position`, …, initial pose and motion as of the body itself.

        The modes are natural modes of the free body in the span of these, orthogonal to rigid
        motion: the frame is Buckens', which has no momentum of its own. Raises SceneError, with the
        remedy, if matrices, nodes and ports do not fit: if the mesh is not free, if turning its
        nodes strains it, if its mass differs between directions, or if no solid carries sound as
        fast or is as dense.
        """
        owner = f"body '{name}'"
        mesh = reduce_mesh(
            owner, cls.dimension, stiffness, mass, nodes, ports, modes, interface, dofs
        )
        damped = None if damping is None else 2 * as_array(damping) * mesh.frequencies
        made: Callable[..., B] = cls
        return made(
            name,
            mesh.inertia,
            mesh.frequencies**2,
            mesh.points,
            mesh.shapes,
            damping=damped,
            ports=tuple(ports),
            unturned=mesh.unturned,
            **start,
        )

    def named_points(self) -> Mapping[str, Float[Array, " d"]]:
        return dict(zip(self.ports, self.points, strict=False))

    @property
    def damped(self) -> bool:
        return self.damping is not None and self.modes > 0

    def natural_frequencies(self) -> Float[Array, " modes"]:
        if self.stiffness.ndim == 2 or self.inertia.modal is not None:
            return super().natural_frequencies()
        return jnp.sqrt(self.stiffness)

    def invariants(self) -> Inertia | SpatialInertia:
        return self.inertia

    def start(self) -> tuple[Float[Array, " size"], Float[Array, " size"]]:
        return flexible_start(self)

    def mass_matrix(self, q: Float[Array, " size"]) -> Float[Array, "size *size"]:
        return self.inertia.matrix(q)

    def elastic_energy(self, q: Float[Array, " size"]) -> Float[Array, ""]:
        return 0.5 * multiply(q[self.frame_size :], _times(self.stiffness, q[self.frame_size :]))

    def damping_force(self, v: Float[Array, " size"]) -> Float[Array, " size"]:
        if self.damping is None:
            return jnp.zeros_like(v)
        return jnp.concatenate(
            [jnp.zeros_like(v[: self.frame_size]), -_times(self.damping, v[self.frame_size :])]
        )

    def first_moment(self, q: Float[Array, " size"]) -> Float[Array, " d"]:
        return self.inertia.first_moment_at(q)

    def mode_shapes(self, point: Float[Array, " d"]) -> Float[Array, "motions modes"]:
        # The nearest point is the marker's own, as `check_marker` has seen.
        return self.shapes[jnp.argmin(jnp.sum((self.points - point[None]) ** 2, axis=1))]

    def outline(self) -> Float[Array, "points d"]:
        drawn = self.points[len(self.ports) :]
        return drawn if len(drawn) else self.points

    def check_marker(self, owner: str, marker: Marker, turning: bool = False) -> None:
        points, point = concrete(self.points), concrete(marker.point)
        if points is None or point is None:
            return
        distances, size = np.linalg.norm(points - point, axis=1), np.max(np.ptp(points, axis=0))
        away, nearest = np.min(distances), int(np.argmin(distances))
        # Modes are known at the points alone, and nothing lies between two of them.
        if away > 1e-6 * size:
            raise SceneError(
                f"{owner}: its marker on '{self.name}' is at {point}, {away:g} m from the nearest "
                f"of the body's points; use a port: {', '.join(self.ports) or points.tolist()}."
            )
        there = np.flatnonzero(distances[: len(self.ports)] <= away + 1e-9 * size)
        if len(there) > 1 and not _alike(self.shapes, there):
            raise SceneError(
                f"{owner}: its marker on '{self.name}' is at {point}, where the ports "
                f"{', '.join(self.ports[i] for i in there)} are, which move in different ways; "
                "leave one out, or move it by other nodes."
            )
        if turning and nearest in there and self.ports[nearest] in self.unturned:
            raise SceneError(
                f"{owner}: its marker on '{self.name}' is at the port '{self.ports[nearest]}', a "
                "point whose rotation the mesh does not have, but it asks how the marker is turned "
                "there, or turns it; make the port 'mean' or 'rigid', of several nodes."
            )

    def check(self) -> None:
        check_name(self.name)
        owner = f"body '{self.name}'"
        count = self.modes
        motions = 3 if self.dimension == 2 else 6
        check_numbers(owner, self, "points", shape=(None, self.dimension))
        check_numbers(owner, self, "shapes", shape=(len(self.points), motions, count))
        for field in ("stiffness", "damping"):
            full = getattr(getattr(self, field), "ndim", 1) == 2
            check_numbers(owner, self, field, shape=(count, count) if full else (count,))
        check_numbers(owner, self, "amplitudes", "rates", shape=(count,))
        check_start(owner, self)
        self.inertia.check(owner, count)


class ModalBody(AbstractModalBody):
    """A linear elastic body of any shape in a floating frame: a mesh, by its modes.

    Coordinates x, y [m], φ [rad] of the frame, then modal amplitudes. A step costs the same for any
    number of nodes: what moves with the modes is in the inertia invariants, and joints and effects
    see the body at its ports only. `ModalBody.of_mesh` makes one of finite-element matrices.

    **Arguments:**

    - `name`: unique in the scene.
    - `inertia`: an `Inertia`.
    - `stiffness`: elastic energy ½ q_fᵀ K q_f, (modes, modes), or the diagonal of a diagonal one.
    - `points`: where markers can sit, in the body frame [m] (points, 2).
    - `shapes`: displacement along local x and y and rotation there per unit amplitude,
      (points, 3, modes).
    - `damping`: generalized force −D q̇_f, as `stiffness`; none unless given.
    - `ports`: names of the first points, for `body.at("name")`. The points after them, if there are
      any, are its outline in pictures. `unturned`: those of the ports whose rotation is not known;
      only what asks for positions alone may act there, and what is measured there has the rotation
      of the frame.
    - `position`, `angle`, `velocity`, `angular_velocity`: initial pose and motion of the frame.
    - `amplitudes`, `rates`: initial modal coordinates and velocities, zero unless given.
    """

    name: str = eqx.field(static=True)
    inertia: Inertia
    stiffness: Converted[Float[Array, "modes *modes"], Vector] = number()
    points: Converted[Float[Array, "points 2"], Vector] = number()
    shapes: Converted[Float[Array, "points 3 modes"], Vector] = number()
    _: dataclasses.KW_ONLY
    damping: Converted[Float[Array, "modes *modes"] | None, Vector | None] = number(default=None)
    position: Converted[Float[Array, "2"], Vector] = number(default=(0.0, 0.0))
    angle: Converted[Float[Array, ""]] = radians(default=0.0)
    velocity: Converted[Float[Array, "2"], Vector] = number(default=(0.0, 0.0))
    angular_velocity: Converted[Float[Array, ""]] = number(default=0.0)
    amplitudes: Converted[Float[Array, " modes"], Vector | None] = number(default=None)
    rates: Converted[Float[Array, " modes"], Vector | None] = number(default=None)
    ports: Converted[tuple[str, ...], Sequence[str]] = parts(static=True, default=())
    unturned: Converted[tuple[str, ...], Sequence[str]] = parts(static=True, default=())
    modes: int = eqx.field(static=True, init=False)

    @property
    def constant_mass(self) -> bool:
        return self.modes == 0 and self.inertia.diagonal


def _times(matrix: Array, vector: Array) -> Array:
    """A matrix, or a diagonal one by its diagonal, times a vector."""
    return matrix * vector if matrix.ndim == 1 else multiply(matrix, vector)


def _alike(shapes: Array, points: np.ndarray) -> bool:
    """Whether some points move alike in all modes."""
    numbers = concrete(shapes)
    return numbers is None or bool(np.all(numbers[points] == numbers[points[:1]]))
