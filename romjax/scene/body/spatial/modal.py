"""A flexible body of any shape in space."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ....common.arrays import Vector, as_array
from ...fields import number
from ...orientation import orientation_field, quaternion_of
from ..modal import AbstractModalBody
from .flexible import AbstractFlexibleBody
from .inertia import SpatialInertia


class ModalBody(AbstractFlexibleBody, AbstractModalBody):
    """A linear elastic body of any shape in space: a mesh, by its modes.

    Coordinates x, y, z [m] and the quaternion of the frame, then modal amplitudes. A step costs the
    same for any number of nodes: what moves with the modes is in the inertia invariants, and joints
    and effects see the body at its ports only. `ModalBody.of_mesh` makes one of finite-element
    matrices.

    **Arguments:**

    - `name`: unique in the scene.
    - `inertia`: a `SpatialInertia`.
    - `stiffness`: elastic energy ½ q_fᵀ K q_f, (modes, modes), or the diagonal of a diagonal one.
    - `points`: where markers can sit, in the body frame [m] (points, 3).
    - `shapes`: displacements along local x, y, z and rotations about them there per unit
      amplitude, (points, 6, modes).
    - `damping`: generalized force −D q̇_f, as `stiffness`; none unless given.
    - `ports`: names of the first points, for `body.at("name")`. The points after them, if there are
      any, are its outline in pictures. `unturned`: those of the ports whose rotation is not known;
      only what asks for positions alone may act there, and what is measured there has the rotation
      of the frame.
    - `position`, `orientation`, `velocity`, `angular_velocity`: initial pose and motion of the
      frame, as of a rigid body.
    - `amplitudes`, `rates`: initial modal coordinates and velocities, zero unless given.
    """

    dimension: ClassVar[int] = 3

    name: str = eqx.field(static=True)
    inertia: SpatialInertia
    stiffness: Float[Array, "modes *modes"] = number()
    points: Float[Array, "points 3"] = number()
    shapes: Float[Array, "points 6 modes"] = number()
    damping: Float[Array, "modes *modes"] | None = number(default=None)
    position: Float[Array, "3"] = number(default=(0.0, 0.0, 0.0))
    orientation: Float[Array, "4"] = orientation_field(default=None)
    velocity: Float[Array, "3"] = number(default=(0.0, 0.0, 0.0))
    angular_velocity: Float[Array, "3"] = number(default=(0.0, 0.0, 0.0))
    amplitudes: Float[Array, " modes"] = number(default=())
    rates: Float[Array, " modes"] = number(default=())
    ports: tuple[str, ...] = eqx.field(static=True, default=())
    unturned: tuple[str, ...] = eqx.field(static=True, default=())
    modes: int = eqx.field(static=True, default=0)

    def __init__(
        self,
        name: str,
        inertia: SpatialInertia,
        stiffness: Vector,
        points: Vector,
        shapes: Vector,
        *,
        damping: Vector | None = None,
        ports: Sequence[str] = (),
        unturned: Sequence[str] = (),
        position: Vector = (0.0, 0.0, 0.0),
        orientation: Vector | None = None,
        velocity: Vector = (0.0, 0.0, 0.0),
        angular_velocity: Vector = (0.0, 0.0, 0.0),
        amplitudes: Vector | None = None,
        rates: Vector | None = None,
    ):
        self.name, self.inertia = name, inertia
        self.ports, self.unturned = tuple(ports), tuple(unturned)
        self.stiffness = jnp.atleast_1d(as_array(stiffness))
        self.points, self.shapes = as_array(points), as_array(shapes)
        self.modes = len(self.stiffness)
        self.damping = None if damping is None else as_array(damping)
        self.position = as_array(position)
        self.orientation = quaternion_of(f"body '{name}'", None, orientation)
        self.velocity, self.angular_velocity = as_array(velocity), as_array(angular_velocity)
        zero = jnp.zeros(self.modes)
        self.amplitudes = zero if amplitudes is None else as_array(amplitudes)
        self.rates = zero if rates is None else as_array(rates)

    def invariants(self) -> SpatialInertia:
        return self.inertia

    @property
    def inverts_mass(self) -> bool:
        return self.inertia.inverts
