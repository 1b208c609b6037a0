"""Points of the signs that joints and effects are drawn as, (points, 2) [m] each."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .marker import Pose

Points = Float[Array, "points 2"]
# In sizes of a sign: the reach of endless lines, which must cross every picture.
REACH = 200.0
# A hatched line, drawn in one stroke.
_TEETH = [point for x in np.linspace(-1, 1, 6) for point in ((x, 0), (x - 0.4, -0.45), (x, 0))]
GROUND = np.array(_TEETH)


def placed(pose: Pose, points: Points | np.ndarray) -> Points:
    """Points of the frame of a marker in the inertial one."""
    cos, sin = jnp.cos(pose.angle), jnp.sin(pose.angle)
    x, y = points[:, 0], points[:, 1]
    return pose.position[None] + jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=1)


def between(a: Float[Array, "2"], b: Float[Array, "2"], path: Points | np.ndarray) -> Points:
    """A path of shares of the way from a to b, 0 to 1, and distances across it [m]."""
    way = b - a
    squared = way @ way
    # The line between equal points has no direction: the path is then along x.
    length = jnp.sqrt(jnp.where(squared > 0, squared, 1.0))
    along = jnp.where(squared > 0, way / length, jnp.array([1.0, 0.0], way.dtype))
    across = jnp.stack([-along[1], along[0]])
    return a[None] + path[:, :1] * way[None] + path[:, 1:] * across[None]


def length_between(a: Float[Array, "2"], b: Float[Array, "2"]) -> Float[Array, ""]:
    """The distance of two points [m]."""
    return jnp.sqrt(jnp.sum((b - a) ** 2))


def zigzag(a: Float[Array, "2"], b: Float[Array, "2"], size: Float[Array, ""]) -> Points:
    """A coil spring; a short one is slim, and none between equal points."""
    turns = np.linspace(0.2, 0.8, 13)
    across = np.concatenate([[0.0, 0.0], np.resize([1.0, -1.0], 11), [0.0, 0.0]])
    width = jnp.minimum(0.5 * size, 0.2 * length_between(a, b))
    along = np.concatenate([[0.0], turns, [1.0]])
    return between(a, b, _path(along, across, width))


def dashpot(
    a: Float[Array, "2"], b: Float[Array, "2"], size: Float[Array, ""]
) -> tuple[Float[Array, "8 2"], Float[Array, "5 2"]]:
    """The cylinder on the side of a and the piston on that of b, beside the line from a to b, where
    a spring may be.
    """
    side = jnp.minimum(size, 0.3 * length_between(a, b))
    cup = [(0, 0), (0, 1.2), (0.35, 1.2), (0.35, 1.6), (0.65, 1.6), (0.35, 1.6), (0.35, 0.8)]
    cup += [(0.65, 0.8)]
    rod = [(1, 0), (1, 1.2), (0.5, 1.2), (0.5, 1.5), (0.5, 0.9)]
    cylinder, piston = (
        between(a, b, _path(x[:, 0], x[:, 1], side)) for x in (np.array(cup), np.array(rod))
    )
    return cylinder, piston


def arrow(tail: Float[Array, "2"], tip: Float[Array, "2"], size: Float[Array, ""]) -> Points:
    """An arrow; a short one has a small head."""
    length = length_between(tail, tip)
    head = jnp.minimum(size, 0.5 * length)
    back = 0.9 * head / jnp.where(length > 0, length, 1.0)
    along = jnp.array([1.0, 0, 0, 0, 0]) + np.array([0, 0, 1, 0, 1]) * back
    across = np.array([0, 0, 0.35, 0, -0.35]) * head
    return between(tip, tail, jnp.stack([along, across], axis=1))


def arc(
    centre: Float[Array, "2"],
    radius: Float[Array, " points"] | Float[Array, ""],
    start: Float[Array, ""],
    sweep: Float[Array, ""] | float,
    count: int = 41,
) -> Points:
    """A part of a circle from the angle `start` [rad] on; of a spiral, with a radius at each of the
    `count` points.
    """
    angle = start + sweep * np.linspace(0, 1, count)
    return centre[None] + jnp.stack([radius * jnp.cos(angle), radius * jnp.sin(angle)], axis=1)


def turning_arrow(
    centre: Float[Array, "2"],
    size: Float[Array, ""],
    start: Float[Array, ""],
    sense: Float[Array, ""],
) -> Points:
    """Three quarters of a circle with a head, counter-clockwise where `sense` is not negative."""
    sign = jnp.where(sense < 0, -1.0, 1.0)
    radius = 1.2 * size
    way = arc(centre, radius, start, 1.5 * np.pi * sign)
    # The head points along the chord of the piece of the circle that it covers.
    end = start + (1.5 * np.pi - 0.25) * sign
    outward = jnp.stack([jnp.cos(end), jnp.sin(end)])
    back = sign * jnp.stack([jnp.sin(end), -jnp.cos(end)])
    barbs = [way[-1] + size * (0.6 * back + side * 0.35 * outward) for side in (1, -1)]
    return jnp.concatenate([way, barbs[0][None], way[-1:], barbs[1][None]])


def box(pose: Pose, size: Float[Array, ""]) -> Points:
    """A slider that is longer along the x axis of a marker."""
    corners = np.array([(-1, -0.6), (1, -0.6), (1, 0.6), (-1, 0.6), (-1, -0.6)])
    return placed(pose, corners * size)


def rail(pose: Pose, beside: Float[Array, "2"], size: Float[Array, ""]) -> Points:
    """The x axis of a marker, to both sides of the foot of the point `beside`."""
    along = pose.along(beside) + REACH * size * np.array([-1.0, 1.0])
    return placed(pose, jnp.stack([along, jnp.zeros_like(along)], axis=1))


def wheel(pose: Pose, radius: Float[Array, ""]) -> Points:
    """A circle with a spoke along the x axis of a marker, which shows how it turns."""
    return jnp.concatenate([pose.position[None], arc(pose.position, radius, pose.angle, 2 * np.pi)])


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


def _path(along: np.ndarray, across: np.ndarray, width: Float[Array, ""]) -> Points:
    return jnp.stack([jnp.asarray(along, width.dtype), across * width], axis=1)
