"""One number that says how a marker has moved against another: what joints of robots measure."""

from typing import Literal, get_args

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..linalg import quaternions
from ..linalg.dense import length
from .counted_angle import counted_angle
from .fields import check_choice
from .marker import Pose

# The motions of marker `a` against `b` are these:
# - "angle": about the z axis, with full turns; "bounded angle": the same between −π and π, for
#   hinges with stops, which need no counter in space;
# - "travel": along the axis on which joints slide, z in space and x in the plane;
# - "distance": of both points;
# - "1 of 2" and "2 of 2": the angles about the x axis of `b` and the y axis of `a`, which stay at
#   right angles; "1 of 3" to "3 of 3": those about x, y and z, each turned by those before it.
Motion = Literal[
    "angle",
    "bounded angle",
    "travel",
    "distance",
    "1 of 2",
    "2 of 2",
    "1 of 3",
    "2 of 3",
    "3 of 3",
]
MOTIONS: tuple[str, ...] = get_args(Motion)
_PLANAR = MOTIONS[:4]
# The motion of a ball joint is the angle of the whole rotation, from 0 to π, in any direction,
# which is none at zero. Only stops have it, which do not act there.
TURN = "turn"
# Motions that are lengths; the others are angles.
LENGTHS = ("travel", "distance")
# The sine of the second of three angles up to which they are told apart, that of 87 degrees.
_STEEP = 0.9986
# What is added to the sine of half of a whole rotation, far below any angle at which stops act.
_LITTLE = 1e-9


def moved(motion: str, *poses: Pose) -> Float[Array, ""]:
    """The motion of the first pose against the second [rad] or [m]; a counter may follow."""
    a, b, *_ = poses
    if motion == "angle":
        return counted_angle(*poses)
    if motion == "bounded angle":
        return a.angle_against(b)
    if motion == "travel":
        return b.along(a.position)
    if motion == "distance":
        return length(a.position - b.position)
    relative = quaternions.product(quaternions.conjugate(b.turn), a.turn)
    if motion == TURN:
        # A little more than nothing keeps the square of the angle smooth at zero.
        sine = jnp.sqrt(jnp.sum(relative[1:] ** 2) + _LITTLE**2)
        return 2 * jnp.arctan2(sine, jnp.abs(relative[0]))
    return _turned(motion, quaternions.matrix(relative))


def _turned(motion: str, r: Float[Array, "3 3"]) -> Float[Array, ""]:
    """An angle of the rotation R = X(θ₁) Y(θ₂), or X(θ₁) Y(θ₂) Z(θ₃) of three."""
    # These entries do not mix the angles. Of three, r₀₂ = sin θ₂, and the cosine of θ₂ is a factor
    # of both numbers of each of the others.
    if motion == "1 of 2":
        return jnp.arctan2(r[2, 1], r[1, 1])
    if motion == "2 of 2":
        return jnp.arctan2(r[0, 2], r[0, 0])
    if motion == "1 of 3":
        return jnp.arctan2(-r[1, 2], r[2, 2])
    if motion == "2 of 3":
        return jnp.arctan2(r[0, 2], jnp.sqrt(r[0, 0] ** 2 + r[0, 1] ** 2))
    return jnp.arctan2(-r[0, 1], r[0, 0])


def limit_of(motion: str, *poses: Pose) -> Float[Array, ""]:
    """A number that changes sign where the motion ceases to be known: of three angles, where that
    about y comes near a right angle, beyond which the same rotation has others.
    """
    a, b, *_ = poses
    if not is_limited(motion):
        return jnp.ones((), a.position.dtype)
    # r₀₂ = sin β: at a right angle the axes of α and γ coincide.
    sine = quaternions.matrix(quaternions.product(quaternions.conjugate(b.turn), a.turn))[0, 2]
    return _STEEP**2 - sine**2


def is_limited(motion: str) -> bool:
    """Whether the motion is known within a limit only."""
    return motion in MOTIONS[-3:]


def counts(motion: str) -> tuple[tuple[int, int], ...]:
    """The pairs of markers whose angle counts full turns."""
    return ((0, 1),) if motion == "angle" else ()


def points_of(motion: str) -> tuple[int, ...]:
    """The numbers of the markers whose positions are all that the motion asks for."""
    return {"distance": (0, 1), "travel": (0,)}.get(motion, ())


def check_motion(owner: str, motion: str, dimension: int) -> None:
    """Check that there is such a motion in the plane (2) or in space (3)."""
    check_choice(owner, "motion", motion, _PLANAR if dimension == 2 else MOTIONS)
