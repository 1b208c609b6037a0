"""A flexible body of any shape in space."""

import dataclasses
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ....common.arrays import Vector
from ...fields import Converted, number, parts
from ...orientation import orientation_field
from ..base import ORIGIN
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
    stiffness: Converted[Float[Array, "modes *modes"], Vector] = number()
    points: Converted[Float[Array, "points 3"], Vector] = number()
    shapes: Converted[Float[Array, "points 6 modes"], Vector] = number()
    _: dataclasses.KW_ONLY
    damping: Converted[Float[Array, "modes *modes"] | None, Vector | None] = number(default=None)
    position: Converted[Float[Array, "3"], Vector] = number(default=ORIGIN)
    orientation: Converted[Float[Array, "4"], Vector | None] = orientation_field(default=None)
    velocity: Converted[Float[Array, "3"], Vector] = number(default=ORIGIN)
    angular_velocity: Converted[Float[Array, "3"], Vector] = number(default=ORIGIN)
    amplitudes: Converted[Float[Array, " modes"], Vector | None] = number(default=None)
    rates: Converted[Float[Array, " modes"], Vector | None] = number(default=None)
    ports: Converted[tuple[str, ...], Sequence[str]] = parts(static=True, default=())
    unturned: Converted[tuple[str, ...], Sequence[str]] = parts(static=True, default=())
    modes: int = eqx.field(static=True, init=False)

    def invariants(self) -> SpatialInertia:
        return self.inertia

    @property
    def inverts_mass(self) -> bool:
        return self.inertia.inverts
