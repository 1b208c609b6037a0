"""Points of the signs that joints and effects are drawn as, (points, d) [m] each.

Flat signs, (points, 2), lie in the plane of x and y of a marker: in space across its z axis, which
is that of joints.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..linalg.dense import invert
from ..linalg.quaternions import cross
from .marker import Pose

Points = Float[Array, "points d"]
# In sizes of a sign: the reach of endless lines, which must cross every picture.
REACH = 200.0
# An axis in space, and two at right angles, of length seven. Little lies along the opposite of the
# first.
_OBLIQUE = (2, 3, 6), (3, -6, 2), (6, 2, -3)


def placed(pose: Pose, points: Float[Array | np.ndarray, "points given"]) -> Points:
    """Points of the frame of a marker in the inertial one; flat ones have no z."""
    missing = pose.dimension - points.shape[1]
    points = jnp.pad(jnp.asarray(points, pose.position.dtype), ((0, 0), (0, missing)))
    return pose.position[None] + jax.vmap(pose.turned)(points)


def between(
    a: Float[Array, " d"], b: Float[Array, " d"], path: Float[Array | np.ndarray, "points given"]
) -> Points:
    """A path of shares of the way from a to b, 0 to 1, and distances across it [m], of which there
    are two in space; flat signs have the first.
    """
    way = b - a
    squared = way @ way
    # The line between equal points has no direction: the path is then along x.
    length = jnp.sqrt(jnp.where(squared > 0, squared, 1.0))
    along = jnp.where(squared > 0, way / length, jnp.zeros_like(way).at[0].set(1.0))
    across = path[:, 1:] @ normals(along)[: path.shape[1] - 1]
    return a[None] + path[:, :1] * way[None] + across


def normals(along: Float[Array, " d"]) -> Float[Array, "less d"]:
    """Vectors of length one at right angles to one, and in space to each other, by the right hand.

    In space they come with the shortest rotation that brings an oblique axis along the given one:
    u − (u·t) (e + t) / (1 + e·t), so that they turn about no line that signs are likely to have.
    """
    if along.shape[0] == 2:
        return jnp.stack([-along[1], along[0]])[None]
    # Turned by the rotation that takes the oblique axis to the line: it fails only for the opposite
    # of that axis.
    oblique, *others = jnp.array(_OBLIQUE, along.dtype) / 7
    units, cosine = jnp.stack(others), 1 + oblique @ along
    share = units @ along / jnp.where(cosine > 0, cosine, 1.0)
    across: Float[Array, "less d"] = units - share[:, None] * (oblique + along)[None]
    return across


def hatched(origin: tuple[float, ...], size: float) -> Float[np.ndarray, "points d"]:
    """A hatched line on the ground, drawn in one stroke; in space upright, across y."""
    teeth = [point for x in np.linspace(-1, 1, 6) for point in ((x, 0), (x - 0.4, -0.45), (x, 0))]
    across = np.eye(2) if len(origin) == 2 else np.eye(3)[[0, 2]]
    line: Float[np.ndarray, "points d"] = np.array(origin) + size * np.array(teeth) @ across
    return line


def length_between(a: Float[Array, " d"], b: Float[Array, " d"]) -> Float[Array, ""]:
    """The distance of two points [m]."""
    return jnp.sqrt(jnp.sum((b - a) ** 2))


def zigzag(a: Float[Array, " d"], b: Float[Array, " d"], size: Float[Array, ""]) -> Points:
    """A coil spring; a short one is slim, and none between equal points. In space it winds about
    its line, to be one from all sides.
    """
    turns = np.linspace(0.2, 0.8, 13)
    winding = [(1.0, -1.0)] if a.shape[0] == 2 else [(1.0, 0.0, -1.0, 0.0), (0.0, 1.0, 0.0, -1.0)]
    across = np.stack([np.pad(np.resize(x, 11), 2) for x in winding], axis=1)
    width = jnp.minimum(0.5 * size, 0.2 * length_between(a, b))
    along = np.concatenate([[0.0], turns, [1.0]])
    return between(a, b, _path(along, across, width))


def dashpot(
    a: Float[Array, " d"], b: Float[Array, " d"], size: Float[Array, ""]
) -> tuple[Float[Array, "8 d"], Float[Array, "5 d"]]:
    """The cylinder on the side of a and the piston on that of b, beside the line from a to b, where
    a spring may be.
    """
    side = jnp.minimum(size, 0.3 * length_between(a, b))
    cup = [(0, 0), (0, 1.2), (0.35, 1.2), (0.35, 1.6), (0.65, 1.6), (0.35, 1.6), (0.35, 0.8)]
    cup += [(0.65, 0.8)]
    rod = [(1, 0), (1, 1.2), (0.5, 1.2), (0.5, 1.5), (0.5, 0.9)]
    cylinder, piston = (
        between(a, b, _path(x[:, 0], x[:, 1:], side)) for x in (np.array(cup), np.array(rod))
    )
    return cylinder, piston


def arrow(tail: Float[Array, " d"], tip: Float[Array, " d"], size: Float[Array, ""]) -> Points:
    """An arrow; a short one has a small head, which has four barbs in space."""
    length = length_between(tail, tip)
    head = jnp.minimum(size, 0.5 * length)
    back = 0.9 * head / jnp.where(length > 0, length, 1.0)
    sides = np.eye(len(tail) - 1)
    barbs = np.concatenate([sides, -sides])
    # The path goes from the tail to the tip, then to each barb and back.
    shares, away = np.zeros((2, 1 + 2 * len(barbs))), np.zeros((1 + 2 * len(barbs), len(sides)))
    shares[0, 0], shares[1, 2::2], away[2::2] = 1.0, 1.0, 0.35 * barbs
    along = shares[0] + shares[1] * back
    return between(tip, tail, jnp.concatenate([along[:, None], away * head], axis=1))


def arc(
    radius: Float[Array, " points"] | Float[Array, ""],
    sweep: Float[Array, ""] | float,
    count: int = 41,
) -> Float[Array, "points 2"]:
    """A part of a circle about the origin from the x axis on; of a spiral, with a radius at each of
    the `count` points.
    """
    angle = sweep * np.linspace(0, 1, count)
    return jnp.stack([radius * jnp.cos(angle), radius * jnp.sin(angle)], axis=1)


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


def turning_arrow(size: Float[Array, ""], sense: Float[Array, ""]) -> Float[Array, "points 2"]:
    """Three quarters of a circle with a head, counter-clockwise where `sense` is not negative."""
    sign = jnp.where(sense < 0, -1.0, 1.0)
    way = arc(1.2 * size, 1.5 * np.pi * sign)
    # The head points along the chord of the piece of the circle that it covers.
    end = (1.5 * np.pi - 0.25) * sign
    outward = jnp.stack([jnp.cos(end), jnp.sin(end)])
    back = sign * jnp.stack([jnp.sin(end), -jnp.cos(end)])
    barbs = [way[-1] + size * (0.6 * back + side * 0.35 * outward) for side in (1, -1)]
    return jnp.concatenate([way, barbs[0][None], way[-1:], barbs[1][None]])


def box(pose: Pose, size: Float[Array, ""]) -> Points:
    """A slider that is longer along the axis on which markers slide: x in the plane, z in space."""
    if pose.dimension == 3:
        return placed(pose, cuboid(jnp.array([1.2, 1.2, 2.0], size.dtype) * size))
    corners = np.array([(-1, -0.6), (1, -0.6), (1, 0.6), (-1, 0.6), (-1, -0.6)])
    return placed(pose, corners * size)


def cuboid(edges: Float[Array, "3"]) -> Float[Array, "16 3"]:
    """A path along all edges of a box about the origin."""
    path = "000 100 110 010 000 001 101 100 101 111 110 111 011 010 011 001"
    corners = np.array([[int(digit) for digit in corner] for corner in path.split()])
    return edges[None] * (corners - 0.5)


def axis_line(pose: Pose, size: Float[Array, ""]) -> Points:
    """The axis of a joint, a size of a sign to both sides."""
    return on_axis(pose, size * np.array([-1.0, 1.0]))


def rail(pose: Pose, beside: Float[Array, " d"], size: Float[Array, ""]) -> Points:
    """The axis on which markers slide, to both sides of the foot of the point `beside`."""
    return on_axis(pose, pose.along(beside) + REACH * size * np.array([-1.0, 1.0]))


def on_axis(pose: Pose, travels: Float[Array, " points"]) -> Points:
    """Points on this axis."""
    column = (0, pose.dimension - 1) if pose.dimension == 2 else (2, 0)
    return placed(pose, jnp.pad(travels[:, None], ((0, 0), column)))


def square(point: Float[Array, "3"], size: Float[Array, ""]) -> Float[Array, "5 2"]:
    """A piece of the plane of x and y about the foot of a point."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    return point[None, :2] + 2 * size * corners


def wheel(pose: Pose, radius: Float[Array, ""]) -> Points:
    """A circle with a spoke along the x axis of a marker, which shows how it turns."""
    rim = arc(radius, 2 * np.pi)
    return placed(pose, jnp.concatenate([jnp.zeros_like(rim[:1]), rim]))


def follow(
    residual: Callable[[Float[Array, " d"]], Float[Array, " less"]],
    point: Float[Array, " d"],
    size: Float[Array, ""],
) -> Points:
    """A curve on which a residual is zero, of one number in the plane and two in space.

    100 steps of half a size to each side of the foot of a point, each along the tangent and back to
    the curve by two of Newton.
    """

    def newton(point: Array, _: object) -> tuple[Array, None]:
        slope = jax.jacfwd(residual)(point)
        # A curve may have no direction at some point.
        squared = slope @ slope.T + 1e-30 * np.eye(len(slope))
        return point - slope.T @ (invert(squared) @ residual(point)), None

    def step(point: Array, side: Array) -> tuple[Array, Array]:
        slope = jax.jacfwd(residual)(point)
        # Across the gradient in the plane; in space along the line in which two surfaces meet.
        tangent = jnp.flip(slope[0]) * np.array([1.0, -1.0]) if len(slope) == 1 else cross(*slope)
        steep = jnp.sqrt(jnp.maximum(tangent @ tangent, 1e-30))
        point, _ = jax.lax.scan(newton, point + side * size / steep * tangent, None, length=2)
        return point, point

    foot, _ = jax.lax.scan(newton, point, None, length=12)
    left, right = (jax.lax.scan(step, foot, jnp.full(100, side))[1] for side in (-0.5, 0.5))
    return jnp.concatenate([left[::-1], foot[None], right])


def belt(
    a: Float[Array, "2"], b: Float[Array, "2"], radii: tuple[Float[Array, ""], Float[Array, ""]]
) -> tuple[Points, Points]:
    """The outer tangents of two wheels about a and b that do not hold each other."""
    apart = length_between(a, b)
    length = jnp.where(apart > 0, apart, 1.0)
    # (r_a − r_b) / |b − a| is the cosine of the angle at which a tangent leaves the wheels.
    cos = jnp.clip((radii[0] - radii[1]) / length, -1.0, 1.0)
    sin = jnp.sqrt(1 - cos**2)
    along = jnp.stack([radii[0] * cos / length, 1 + radii[1] * cos / length])
    across = jnp.stack([radii[0] * sin, radii[1] * sin])
    left, right = (between(a, b, jnp.stack([along, x], axis=1)) for x in (across, -across))
    return left, right


def _path(
    along: np.ndarray, across: np.ndarray, width: Float[Array, ""]
) -> Float[Array, "points given"]:
    return jnp.concatenate([jnp.asarray(along, width.dtype)[:, None], across * width], axis=1)
