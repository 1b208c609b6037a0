"""Kinematics of the points of a rod: one discrete map, and its derivatives by hand.

Positions are integrals of r' = (1 + ε) t + γ n at the Gauss points. Derivatives by the amplitudes
and rates are integrals of those of r' by the same weights, so they are the derivatives of the
discrete positions themselves, to rounding.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import namespace, untraced
from ...linalg.plane import perpendicular
from .strains import Strains, gauss, turning, weights_to


class Line(NamedTuple):
    """The line of a rod.

    - `strains`: its strain shapes. `length`: Length [m]. `curvature`: the coefficients (k,) of its
      initial curvature times length, or None.
    """

    strains: Strains
    length: Any
    curvature: Any

    def bent(self, xi: Any) -> Any:
        """The turning of the undeformed rod at ξ."""
        if self.curvature is None:
            return 0.0
        table = turning(self.curvature.shape[0], xi, self.strains.anchor, namespace(xi))
        table, curvature = untraced(table, self.curvature)
        return table @ curvature

    def origin(self) -> Any:
        """The position of the anchor in the frame (2,)."""
        (length,) = untraced(self.length)
        return length * np.array([self.strains.anchor - 0.5, 0.0])


class Slopes(NamedTuple):
    """Slopes and their derivatives at the Gauss points.

    - `tangent`, `normal` (2, points): unit vectors in the frame. `slope` (2, points): dr/dξ per
      length.
    """

    tangent: Any
    normal: Any
    slope: Any


def slopes(line: Line, amplitudes: Any) -> Slopes:
    """The slopes of a rod; by NumPy where JAX does not trace."""
    own = line.strains
    amplitudes, turn = untraced(amplitudes, own.turn)
    theta = turn @ amplitudes + line.bent(gauss(own.points)[0])
    xp = namespace(theta)
    c, s = xp.cos(theta), xp.sin(theta)
    tangent, normal = xp.stack([c, s]), xp.stack([-s, c])
    slope = tangent
    for table, vector in ((own.stretch, tangent), (own.shear, normal)):
        if table is not None:
            slope = slope + vector * (xp.asarray(table) @ amplitudes)[None]
    return Slopes(tangent, normal, slope)


def columns(line: Line, at: Slopes) -> Any:
    """The derivatives of `slope` by the amplitudes, (2, points, modes)."""
    own, xp = line.strains, namespace(at.slope)
    # θ turns all of r', so that ∂r'/∂θ is r' turned by a right angle; strains add along t and n.
    derivatives = perpendicular(at.slope)[:, :, None] * xp.asarray(own.turn)[None]
    for table, vector in ((own.stretch, at.tangent), (own.shear, at.normal)):
        if table is not None:
            derivatives = derivatives + vector[:, :, None] * xp.asarray(table)[None]
    return derivatives


def jacobian(
    line: Line, q: Float[Array, " size"]
) -> tuple[Float[Array, "2 points"], Float[Array, "2 points size"]]:
    """Positions of the Gauss points in the frame, and the derivatives of the inertial ones by all
    coordinates, along the axes of the frame.
    """
    own, at = line.strains, slopes(line, q[3:])
    to = line.length * own.positions()
    position = line.origin()[:, None] + at.slope @ to.T
    # x and y by the axes of the frame, φ with the arm; and the integrals of ∂r'/∂a.
    c, s = jnp.cos(q[2]), jnp.sin(q[2])
    frame = jnp.broadcast_to(jnp.stack([c, s, -s, c]).reshape(2, 1, 2), (2, own.points, 2))
    parts = [frame, perpendicular(position)[:, :, None], to @ columns(line, at)]
    return position, jnp.concatenate(parts, axis=2)


def acceleration(
    line: Line,
    q: Float[Array, " size"],
    v: Float[Array, " size"],
    position: Float[Array, "2 points"],
) -> Float[Array, "2 points"]:
    """The accelerations of the Gauss points at `position` for q̈ = 0, along the axes of
    the frame.
    """
    own, at, rates = line.strains, slopes(line, q[3:]), v[3:]
    to = line.length * own.positions().T
    spin = (own.turn @ rates)[None]
    straining = jnp.zeros_like(at.slope)
    for table, vector in ((own.stretch, at.tangent), (own.shear, at.normal)):
        if table is not None:
            straining = straining + vector * (table @ rates)[None]
    rate = (perpendicular(at.slope) * spin + straining) @ to
    # The second rate of r' with ä = 0: while a section turns, its strains change, and r' itself is
    # turned.
    second = (2 * perpendicular(straining) * spin - at.slope * spin**2) @ to
    # And the frame turns: the terms of Coriolis and of Huygens.
    total: Array = second + 2 * v[2] * perpendicular(rate) - v[2] ** 2 * position
    return total


class Material(NamedTuple):
    """Data of a material point that its pose needs, computed once.

    - `weights` (points,): of its position as an integral [m]. `turn` (modes,): the turning of its
      section per unit amplitude. `bent`: that of the undeformed rod. `off`: how far it is from the
      axis [m].
    """

    weights: Any
    turn: Any
    bent: Any
    off: Any


def material(line: Line, point: Any) -> Material:
    """Prepare a material point, (arc length from the middle, distance from the axis)."""
    own = line.strains
    point, length, basis = untraced(point, line.length, own.basis)
    xi, count, xp = point[0] / length + 0.5, own.counts[0], namespace(point)
    return Material(
        length * weights_to(own.points, own.anchor, xi, xp),
        turning(count, xi, own.anchor, xp) @ basis[:count],
        line.bent(xi),
        point[1],
    )


def pose(line: Line, point: Material, amplitudes: Any) -> tuple[Any, Any]:
    """Position (2,) and turning of a material point in the frame."""
    at = slopes(line, amplitudes)
    slope, amplitudes, weights, turn, bent, off = untraced(at.slope, amplitudes, *point)
    theta = turn @ amplitudes + bent
    xp = namespace(theta)
    aside = off * xp.stack([-xp.sin(theta), xp.cos(theta)])
    return line.origin() + slope @ weights + aside, theta


def gradient(line: Line, point: Material, amplitudes: Any) -> Any:
    """Derivatives of `pose` by the amplitudes, (3, modes)."""
    at = slopes(line, amplitudes)
    own, amplitudes, weights, turn, bent, off = untraced(columns(line, at), amplitudes, *point)
    theta = turn @ amplitudes + bent
    xp = namespace(theta)
    # The normal turns against the tangent: dn/dθ = −t.
    moved = weights @ own - off * xp.stack([xp.cos(theta), xp.sin(theta)])[:, None] * turn[None]
    return xp.concatenate([moved, turn[None]])
