"""Links as beams: what `Scene.flexible` puts in the place of a body."""

import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..common.arrays import as_array, as_jax, concrete, namespace, untraced
from ..common.errors import SceneError
from ..linalg import quaternions
from .body.base import AbstractBody
from .body.beam import Beam
from .body.sections import AbstractSection
from .body.spatial.beam import Beam as BeamInSpace
from .editing import against, composed
from .marker import Marker, Pose
from .orientation import quaternion_of
from .placing import start_pose, velocity_at

# A warning tells of a uniform beam whose centre of mass or inertia differs from that of the link
# that it replaces by more than this share of the length, or of the largest moment.
_OTHER = 0.1
# Points that are beyond an end by less than this share of the length are at it.
_AT_END = 1e-9


def flexible_body(
    body: AbstractBody,
    markers: Sequence[Marker],
    *,
    modes: int,
    ends: Sequence[Any] | None,
    section: AbstractSection | None,
    options: dict[str, Any],
) -> Any:
    """The beam in the place of a body that the `markers` of joints hold; see `Scene.flexible`."""
    owner = f"flexible: body '{body.name}'"
    if not hasattr(body, "mass") or body.modes:
        raise SceneError(
            f"{owner}: it is a {type(body).__name__}, but only rigid bodies become beams; put in "
            "another body by scene.replace."
        )
    frame, length = _frame(body, points := _ends(body, markers, ends)), _distance(points)
    speed, spin = _motion(body, frame)
    options = {"velocity": speed, "angular_velocity": spin, "position": frame.position} | options
    options |= {"points": _points(body, frame, length)}
    if body.dimension == 2:
        options |= {"angle": frame.turn}
        counts = {"modes": modes}
    else:
        options |= {"orientation": frame.turn}
        stiff = {"torsion": "GJ", "extension": "EA"}
        counts = {"bending": modes} | {
            k: modes for k, given in stiff.items() if options.get(given) is not None
        }
    options = counts | options
    kind: Any = Beam if body.dimension == 2 else BeamInSpace
    if section is not None:
        return kind.of_section(body.name, length, section, **options)
    if options.get("EI") is None:
        raise SceneError(
            f"{owner}: EI is missing; give the bending stiffness [N m²], or section, density and "
            "modulus.",
            field="EI",
        )
    if body.dimension == 2:
        return kind(body.name, body.mass, length, **options)
    return kind(body.name, body.mass, length, _inertia(body, frame, length), **options)


def on_beam(beam: Any, owner: str, marker: Marker) -> Marker:
    """A marker in the frame of a beam, at its end where it is beyond by rounding alone.

    Raises SceneError, beginning with `owner`, for one that is further beyond.
    """
    point, known = concrete(marker.point), concrete(beam.length)
    if point is None or known is None:
        return marker
    length = float(known)
    beyond = abs(float(point[0])) - 0.5 * length
    if beyond <= 0:
        return marker
    if beyond > _AT_END * length:
        raise SceneError(
            f"{owner} is {beyond:.3g} m beyond the ends of the beam '{beam.name}'; give ends that "
            "have it between them.",
            field="ends",
        )
    moved = np.array(point)
    moved[0] = math.copysign(0.5 * length, moved[0])
    return Marker(marker.body, as_jax(moved), marker.turn)


def _points(body: AbstractBody, frame: Pose, length: float) -> dict[str, Any]:
    """The named points of a body that are between the ends, in the frame of the beam."""
    points = {}
    for name, point in body.named_points().items():
        place = against(start_pose(body, point), frame).position
        known = concrete(place)
        within = known is None or abs(float(known[0])) <= 0.5 * length * (1 + _AT_END)
        if name not in ("start", "end") and within:
            points[name] = as_array(place)
    return points


def _inertia(body: Any, frame: Pose, length: float) -> Any:
    """The moments of a thin beam in space, with that of the link about its axis."""
    mass, inertia, turn, own = untraced(body.mass, body.inertia, frame.turn, body.start()[0][3:7])
    xp = namespace(mass)
    axes = quaternions.matrix(quaternions.product(quaternions.conjugate(own), turn))
    tensor = inertia if inertia.ndim == 2 else inertia * np.eye(3)
    thin = mass * length**2 / 12
    # No more than what a body can have.
    about = xp.minimum(axes[:, 0] @ tensor @ axes[:, 0], 2 * thin)
    return as_array(xp.stack([about, thin, thin]))


def _distance(ends: Any) -> float:
    return float(np.linalg.norm(ends[1] - ends[0]))


def _ends(body: AbstractBody, markers: Sequence[Marker], given: Sequence[Any] | None) -> Any:
    """The points of a body at which a beam in its place begins and ends (2, d): those `given`, or
    the two points of its joints that are furthest apart, or its joint and the named point that is.
    """
    owner = f"flexible: body '{body.name}'"
    if given is not None:
        if len(given) != 2:
            raise SceneError(f"{owner}: ends has {len(given)} entries; give two points or names.")
        points = [body.at(point).point for point in given]
    else:
        points = [marker.point for marker in markers]
        if not points:
            raise SceneError(f"{owner}: no joint is on it; give its two ends.", field="ends")
    known = [concrete(x) for x in points]
    if any(x is None for x in known):
        raise SceneError(f"{owner}: JAX traces its points; give ends that are numbers.")
    pair = _furthest(known, known)
    if pair[2] <= 0 and given is None:
        named = [np.asarray(x) for x in body.named_points().values()]
        pair = _furthest(known[:1], named)
    if not pair[2] > 0:
        raise SceneError(
            f"{owner}: its joints are at one point; give ends=(…, …), names of points or places."
        )
    return np.stack(pair[:2])


def _furthest(ones: Sequence[Any], others: Sequence[Any]) -> tuple[Any, Any, float]:
    pairs = [(a, b, float(np.linalg.norm(np.asarray(b) - a))) for a in ones for b in others]
    return max(pairs, key=lambda pair: pair[2], default=(None, None, 0.0))


def _frame(body: AbstractBody, ends: np.ndarray) -> Pose:
    """The pose at the start of a frame in the middle of both ends, with x from one to the other; in
    space with z as near to the z axis of the body as can be, or to its y axis.
    """
    middle, along = 0.5 * (ends[0] + ends[1]), ends[1] - ends[0]
    along = along / np.linalg.norm(along)
    pose = start_pose(body, tuple(float(x) for x in middle))
    if body.dimension == 2:
        turn: Any = math.atan2(along[1], along[0])
    else:
        up = np.array([0.0, 0.0, 1.0])
        # Along z itself nothing is left of it across the axis; y takes its place within 26 degrees.
        up = up if abs(along @ up) < 0.9 else np.array([0.0, 1.0, 0.0])
        across = np.cross(up, along)
        across /= np.linalg.norm(across)
        axes = np.stack([along, across, np.cross(along, across)], axis=1)
        turn = quaternion_of("flexible", given=axes)
    return Pose(pose.position, as_array(composed(pose.turn, as_array(turn), body.dimension)))


def _motion(body: AbstractBody, at: Pose) -> tuple[Any, Any]:
    """The velocity of a point of a body at the start, and its angular velocity."""
    speed, spin, here, there = untraced(
        body.velocity,  # type: ignore[attr-defined]
        body.angular_velocity,  # type: ignore[attr-defined]
        body.position,  # type: ignore[attr-defined]
        at.position,
    )
    return velocity_at(speed, spin, there - here), as_array(spin)


def warn_of_other_inertia(body: Any, beam: Any) -> None:
    """Say how a uniform beam differs from the link that it replaces."""
    d, known = body.dimension, concrete(beam.length)
    if known is None:
        return
    length = float(known)
    (q,) = untraced(beam.start()[0])
    frame = Pose(q[:d], q[2] if d == 2 else q[d:7])
    middle = (0.0,) * d if body.centre is None else body.centre
    centre = concrete(against(start_pose(body, middle), frame).position)
    mass, inertia = concrete(body.mass), concrete(body.inertia)
    if centre is None or mass is None or inertia is None:
        return
    moved = float(np.linalg.norm(centre)) / length
    moments = inertia if inertia.ndim < 2 else np.linalg.eigvalsh(inertia)
    thin = float(mass) * length**2 / 12
    other = float(np.max(moments)) / thin
    if moved > _OTHER or abs(other - 1) > _OTHER:
        warnings.warn(
            f"flexible: the mass of body '{body.name}' is kept, spread evenly along the beam: its "
            f"centre moves by {moved * length:.3g} m to the middle, and its largest moment of "
            f"inertia was {other:.3g} times that of the beam. Make a ModalBody of a mesh for "
            "another spread, and put it in by scene.replace.",
            stacklevel=3,
        )
