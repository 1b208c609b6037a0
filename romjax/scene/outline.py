"""Outlines: what pictures show of bodies, joints and effects."""

from typing import Literal, get_args

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .fields import check_choice
from .marker import Poses

# What an outline stands for; pictures choose colours and widths by it. The last three are marks,
# of one size on every picture, at each of the points; the others are lines through them.
Style = Literal[
    "body",  # material points of a body
    "link",  # a connection without mass
    "track",  # along which something slides
    "spring",
    "damper",
    "load",  # forces, torques and drives, with the head of an arrow
    "surface",  # of what can be touched
    "trace",  # the path of a point over all times
    "ground",
    "hinge",
    "weld",
    "point",
]
STYLES: tuple[str, ...] = get_args(Style)


class Outline(eqx.Module):
    """A line through points, or marks at them.

    **Arguments:**

    - `points`: in the inertial frame [m], (points, 2), in space (points, 3); with a leading axis
      where it moves.
    - `style`: what it stands for: "body", "link", "track", "spring", "damper", "load", "surface",
      "trace" or "ground" for lines; "hinge", "weld" or "point" for marks.
    - `endless`: whether it goes on beyond its ends; then pictures cut it off, where finite ones
      are shown as a whole.
    """

    points: Float[Array, "*frames points d"]
    style: Style = eqx.field(static=True, default="link")
    endless: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        check_choice("Outline", "style", self.style, STYLES)


Outlines = tuple[Outline, ...]


def marks(poses: Poses, style: Style = "hinge") -> Outline:
    """Marks at the markers of a joint: at one position, unless the joint is torn."""
    return Outline(jnp.stack([pose.position for pose in poses]), style)


def linked(poses: Poses) -> Outlines:
    """Dots at the markers and a line from each to the next, the plain sign of any part."""
    points = jnp.stack([pose.position for pose in poses])
    return Outline(points, "link"), Outline(points, "point")
