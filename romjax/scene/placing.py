"""Placing of bodies: by one of their points, and the positions of their points."""

from collections.abc import Mapping
from typing import Any, TypeVar

import equinox as eqx
from jaxtyping import Array

from ..common.arrays import Number, Vector, as_array, as_jax, namespace, untraced
from ..common.errors import SceneError
from ..linalg import quaternions
from ..linalg.plane import perpendicular
from .fields import check_kind, check_shape
from .marker import GROUND, Marker, Pose
from .orientation import quaternion_of

B = TypeVar("B", bound=Any)


def start_pose(body: Any, point: Vector) -> Pose:
    """Return the pose of a material `point` [m] of a body at the start."""
    (q,) = untraced(body.start()[0])
    d, frame = body.dimension, body.frame_size
    local = _local(body, q, point)
    position = _moved(q[:d], _turn(q, d), local.position)
    q, turn = untraced(q, local.turn)
    turn = q[2] + turn if d == 2 else quaternions.product(q[d:frame], turn)
    return Pose(as_jax(position), as_jax(turn))


def marker_start(bodies: Mapping[str, Any], marker: Marker) -> Pose:
    """Return the start pose of a marker on one of the `bodies`, by name, or on the ground."""
    if marker.body == GROUND:
        return Pose(marker.point, marker.turn)
    pose = start_pose(bodies[marker.body], marker.point)
    turn, own = untraced(pose.turn, marker.turn)
    turned = turn + own if pose.dimension == 2 else quaternions.product(turn, own)
    return Pose(pose.position, as_jax(turned))


def brought(body: B, point: Vector, to: Pose, angle: Number | None, rotation: Any = None) -> B:
    """The body whose material `point` [m] is where a pose is, its frame turned by `angle` [rad] in
    the plane, by a `rotation` in space, as it is unless given.
    """
    if not hasattr(body, "position"):
        raise SceneError(
            f"body '{body.name}': a {type(body).__name__} has no position of its own; place the "
            "body that it is made of."
        )
    owner, d = f"body '{body.name}'", body.dimension
    check_kind(owner, "the pose", to, Pose, "ground.pose(point), or other.pose(point) of a body")
    if to.dimension != d:
        raise SceneError(f"{owner}: it has {d} dimensions, but the pose has {to.dimension}.")
    if (rotation if d == 2 else angle) is not None:
        remedy = "an angle in the plane" if d == 2 else "a rotation in space"
        raise SceneError(f"{owner}: it is turned by {remedy}.")
    turned = body.angle if d == 2 else body.orientation
    if angle is not None:
        turned = as_array(angle)
    elif rotation is not None:
        turned = quaternion_of(owner, given=rotation)
    q, _ = body.start()
    arm = _local(body, q, point).position
    if body.centre is not None:
        arm = as_array(point)
    position = as_array(_moved(to.position, turned, arm, sign=-1))
    field = "angle" if d == 2 else "orientation"
    fields = lambda b: (b.position, getattr(b, field))  # noqa: E731
    placed: B = eqx.tree_at(fields, body, (position, turned))
    placed.check()
    return placed


def started(body: B, q: Array, v: Array) -> B:
    """The body whose own coordinates and velocities at the start are q and v."""
    if not hasattr(body, "position"):
        raise SceneError(
            f"body '{body.name}': a {type(body).__name__} has no fields `position`, `angle`, …; "
            "give it a method `started`."
        )
    d, frame = body.dimension, body.frame_size
    names = ["position", "angle" if d == 2 else "orientation", "velocity", "angular_velocity"]
    turning = v[2]
    if d == 3:
        turning = as_array(quaternions.angular_velocity(*untraced(q[d:frame], v[d:frame])))
    position, velocity = q[:d], v[:d]
    if body.centre is not None:
        position, velocity = apart(body.centre, position, _turn(q, d), velocity, turning, sign=-1)
    values = [position, _turn(q, d), velocity, turning]
    if body.modes:
        names, values = [*names, "amplitudes", "rates"], [*values, q[frame:], v[frame:]]
    moved: B = eqx.tree_at(lambda b: [getattr(b, name) for name in names], body, values)
    return moved


def _turn(q: Array, dimension: int) -> Array:
    """The angle or the quaternion of a frame."""
    return q[2] if dimension == 2 else q[3:7]


def _local(body: Any, q: Array, point: Vector) -> Pose:
    """A material point in the frame of a body as it is bent, X + S q_f − ½ q_fᵀ G q_f [m], and how
    it is turned there.
    """
    at, d = as_array(point), body.dimension
    check_shape(f"body '{body.name}'", "point", at, (d,))
    if body.bends:
        bent = body.local_pose(body.prepare(at), q[body.frame_size :])
        return Pose(*map(as_jax, bent))
    unturned = as_array(0.0 if d == 2 else (1.0, 0.0, 0.0, 0.0))
    if not body.modes:
        return Pose(at if body.centre is None else from_centre(at, body.centre), unturned)
    place, shapes, q = untraced(at, body.mode_shapes(at), q)
    amplitudes = q[body.frame_size :]
    moved = shapes @ amplitudes
    arm = place + moved[:d]
    if body.foreshortens:
        (second, amplitudes) = untraced(body.foreshortening(at), amplitudes)
        arm = arm - 0.5 * (second @ amplitudes) @ amplitudes
    turn = moved[2] if d == 2 else quaternions.small_turn(moved[d:])
    return Pose(as_array(arm), as_array(turn))


def from_centre(points: Any, centre: Any, sign: int = 1) -> Any:
    """Points of a body (…, d) from the origin of its coordinates, which is at `centre` [m]; or back
    in its frame, by a negative `sign`.
    """
    points, centre = untraced(points, centre)
    return as_jax(points - sign * namespace(points).broadcast_to(centre, points.shape))


def apart(
    arm: Any, position: Any, turn: Any, velocity: Any, spin: Any, sign: int = 1
) -> tuple[Any, Any]:
    """The position and the velocity of a point at an `arm` in a frame, from those of its origin; or
    of its origin from those of the point, by a negative `sign`.
    """
    moved = _moved(position, turn, arm, sign)
    there, here = untraced(moved, position)
    return as_array(moved), velocity_at(velocity, spin, there - here)


def velocity_at(velocity: Any, spin: Any, arm: Any) -> Array:
    """The velocity of a point of a body at an `arm` from another point, which has `velocity`."""
    velocity, spin, arm = untraced(velocity, spin, arm)
    turning = quaternions.cross(spin, arm) if spin.ndim else spin * perpendicular(arm)
    return as_array(velocity + turning)


def _moved(origin: Any, turn: Any, arm: Any, sign: int = 1) -> Any:
    """The position origin + sign A arm; by NumPy, without compiling, where JAX does not trace."""
    origin, turn, arm = untraced(origin, turn, arm)
    if turn.ndim:
        return origin + sign * quaternions.rotate(turn, arm)
    xp = namespace(arm)
    c, s = xp.cos(turn), xp.sin(turn)
    return origin + sign * xp.stack([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])
