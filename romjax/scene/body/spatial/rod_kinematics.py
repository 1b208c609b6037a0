"""Kinematics of the points of a rod in space: one discrete map, and its derivatives.

Sections turn by steps of `magnus` from Gauss point to Gauss point, and positions are integrals of
r' = R (1 + ε, γ) by the weights of the rod in the plane. Turns per unit amplitude are sums of those
of the steps, and all else follows from them, so they are the derivatives of the discrete positions
and rotations themselves, to rounding.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import namespace, untraced
from ....linalg import magnus, quaternions
from ..strains import gauss, weights_to
from .rod_strains import SpatialStrains, moments, path

_UNTURNED = np.array([[1.0, 0.0, 0.0, 0.0]])


class Line(NamedTuple):
    """The line of a rod.

    - `strains`: its strain shapes. `length`: Length [m]. `curvature`: the coefficients (3, k) of
      its initial twist and curvature times length, or None.
    """

    strains: SpatialStrains
    length: Any
    curvature: Any

    def bent(self, start: Any, size: Any) -> Any:
        """The moments (..., 4, 3) of the undeformed rod in steps of a `size` from a `start`."""
        if self.curvature is None:
            return 0.0
        xp = namespace(start)
        table, curvature = untraced(
            moments(self.curvature.shape[1], start, size, xp), self.curvature
        )
        return table @ curvature.T

    def origin(self) -> Any:
        """The position of the anchor in the frame (3,)."""
        (length,) = untraced(self.length)
        return length * np.array([self.strains.anchor - 0.5, 0.0, 0.0])


class Material(NamedTuple):
    """Data of a material point that its pose needs, computed once.

    - `weights` (points,): of its position as an integral [m]. `near` (points + 1,): one for the
      Gauss point, or the anchor, that is nearest. `step` (12, modes): the moments of curvature from
      there per unit amplitude, and `bent` (4, 3) those of the undeformed rod.
    - `off` (3,): where it is in its section [m].
    """

    weights: Any
    near: Any
    step: Any
    bent: Any
    off: Any


class Sections(NamedTuple):
    """Sections at the Gauss points, and at a material point beside them, by the axes of the frame.

    - `moments` (steps, 4, 3): of curvature in the steps to them. `turns` (steps + 1, 4): unit
      quaternions of the anchor, and of sections. `axes` (steps + 1, 3, 3): their matrices.
    - `slope` (points, 3): dr/dξ per length.
    - `before` (steps, points + 1): one for the section where a step begins; `sums` (steps, steps):
      one for each step on the way to a section. `tables` (steps, 12, modes): moments per amplitude.
    """

    moments: Any
    turns: Any
    axes: Any
    slope: Any
    before: Any
    sums: Any
    tables: Any


def sections(line: Line, amplitudes: Any, point: Material | None = None) -> Sections:
    """The sections of a rod, and that of a material `point`; by NumPy where JAX does not trace."""
    own = line.strains
    tables, amplitudes, *given = untraced(own.steps, amplitudes, *(point or ()))
    way, xp = own.path(), namespace(tables)
    bent = line.bent(way.starts, gauss(own.points)[0] - way.starts)
    before, sums = way.before, way.sums
    if given:
        _, near, step, more, _ = given
        tables = xp.concatenate([tables, step[None]])
        bent = xp.concatenate([bent + xp.zeros((own.points, 4, 3)), more[None]])
        before = xp.concatenate([before, near[None]])
        last = xp.concatenate([near[1:] @ sums, xp.ones(1)])
        sums = xp.concatenate([xp.pad(sums, ((0, 0), (0, 1))), last[None]])
    along = (tables @ amplitudes).reshape(-1, 4, 3) + bent
    outwards = _outwards if xp is np else _differentiable
    turns, axes = outwards(own.points, own.anchor, along, before, sums)
    slope = axes[1 : own.points + 1, :, 0]
    if own.strain is not None:
        strained = xp.asarray(own.strain) @ amplitudes
        slope = slope + quaternions.apply(axes[1 : own.points + 1], strained)
    return Sections(along, turns, axes, slope, before, sums, tables)


def _outwards(points: int, anchor: float, moments: Any, before: Any, sums: Any) -> tuple[Any, Any]:
    """The `turns` and `axes` of sections, as products of the rotations from the anchor to them."""
    del sums
    xp = namespace(moments)
    turns = xp.concatenate([xp.asarray(_UNTURNED, moments.dtype), magnus.rotation(moments)])
    own, more = turns[: points + 1], turns[points + 1 :]
    # Products of steps, each time twice as long: as many loops as the logarithm of the points.
    for reach in path(points, anchor).levels:
        own = quaternions.product(own[reach], own)
    if len(moments) > points:
        more = quaternions.product(before[points:] @ own, more)
    turns = xp.concatenate([own, more])
    return turns, quaternions.matrix(turns)


# The derivative of the products by what turns in each step, which compiles faster.
_differentiable = jax.custom_jvp(_outwards, nondiff_argnums=(0, 1))


@_differentiable.defjvp
def _turned(points: int, anchor: float, given: Any, rates: Any) -> tuple[Any, Any]:
    (moments, before, sums), (rate, *_) = given, rates
    turns, axes = _differentiable(points, anchor, moments, before, sums)
    each = quaternions.apply(_starts(before, axes), magnus.spin(moments, rate))
    spin = jnp.concatenate([jnp.zeros((1, 3), each.dtype), sums @ each])
    turning = quaternions.product(quaternions.from_vector(0.5 * spin), turns)
    return (turns, axes), (turning, magnus.skew(spin) @ axes)


def _starts(before: Any, axes: Any) -> Any:
    """The axes (steps, 3, 3) where steps begin."""
    count = before.shape[1]
    return (before @ axes[:count].reshape(count, 9)).reshape(-1, 3, 3)


def turning(at: Sections) -> Any:
    """How sections turn per unit amplitude, (steps, 3, modes)."""
    each = _starts(at.before, at.axes) @ magnus.slopes(at.moments) @ at.tables
    return (at.sums @ each.reshape(len(each), -1)).reshape(each.shape)


def columns(line: Line, at: Sections, turned: Any) -> Any:
    """The derivatives of `slope` by the amplitudes, (points, 3, modes), for the turns `turned`."""
    own = line.strains
    derivatives = _crossed(at.slope, turned[: own.points])
    if own.strain is not None:
        (strain,) = untraced(own.strain)
        derivatives = derivatives + at.axes[1 : own.points + 1] @ strain
    return derivatives


class Motion(NamedTuple):
    """How the Gauss points move for unaccelerated amplitudes, by the axes of the frame and against
    it: `rate`, `acceleration` of positions, and `spin`, `spinning` (its rate), each (points, 3).
    """

    rate: Any
    acceleration: Any
    spin: Any
    spinning: Any


def motion(line: Line, at: Sections, rates: Float[Array, " modes"]) -> Motion:
    """The motion of the Gauss points for the `rates` of amplitudes."""
    own, cross = line.strains, magnus.cross
    changed = (own.steps @ rates).reshape(at.moments.shape)
    steps = jax.jvp(lambda moments: magnus.spin(moments, changed), (at.moments,), (changed,))
    starts = _starts(at.before, at.axes)
    first, second = (quaternions.apply(starts, x) for x in steps)
    spin = at.sums @ first
    # Turns of steps are by the axes at their starts, which turn as well.
    spinning = at.sums @ (second + cross(at.before[:, 1:] @ spin, first))
    # With constant ε̇, r' has the rate ω × r' + A ε̇ and the second rate
    # ω̇ × r' + ω × (ω × r' + 2 A ε̇).
    rate, force = cross(spin, at.slope), cross(spinning, at.slope)
    straining = jnp.zeros_like(rate)
    if own.strain is not None:
        straining = quaternions.apply(at.axes[1:], own.strain @ rates)
    force = force + cross(spin, rate + 2 * straining)
    to = line.length * own.positions()
    return Motion(to @ (rate + straining), to @ force, spin, spinning)


def material(line: Line, point: Any) -> Material:
    """Prepare a material point, (arc length from the middle, y and z in the section)."""
    own = line.strains
    point, length, basis = untraced(point, line.length, own.basis)
    xi, count, xp = point[0] / length + 0.5, basis.shape[1], namespace(point)
    starts = np.append(own.anchor, gauss(own.points)[0])
    nearest = xp.argmin(xp.abs(starts - xi))
    near = xp.where(np.arange(len(starts)) == nearest, 1.0, 0.0)
    start = xp.asarray(xp.asarray(starts)[nearest])
    along = moments(count, start, xi - start, xp)
    turned = along @ xp.swapaxes(basis[:3], 0, 1).reshape(count, -1)
    return Material(
        length * weights_to(own.points, own.anchor, xi, xp),
        near,
        turned.reshape(12, -1),
        line.bent(start, xi - start) + xp.zeros((4, 3)),
        point * np.array([0.0, 1.0, 1.0]),
    )


def pose(line: Line, point: Material, amplitudes: Any) -> tuple[Any, Any]:
    """Position (3,) and quaternion (4,) of a material point in the frame."""
    at = sections(line, amplitudes, point)
    slope, axes, weights, off = untraced(at.slope, at.axes[-1], point.weights, point.off)
    return line.origin() + weights @ slope + axes @ off, at.turns[-1]


def gradient(line: Line, point: Material, amplitudes: Any) -> Any:
    """Displacement and turn of a material point per unit amplitude, (6, modes)."""
    at = sections(line, amplitudes, point)
    turned = turning(at)
    moved, weights, off = untraced(columns(line, at, turned), point.weights, point.off)
    own, xp = turned[-1], namespace(moved)
    moved = (weights @ moved.reshape(len(moved), -1)).reshape(own.shape)
    return xp.concatenate([moved + _crossed(at.axes[-1] @ off, own), own])


def _crossed(vectors: Any, turned: Any) -> Any:
    """How `vectors` (..., 3) move that turn by `turned` (..., 3, modes)."""
    return -magnus.skew(vectors) @ turned
