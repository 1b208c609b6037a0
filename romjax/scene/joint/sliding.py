"""The sign of joints that slide."""

from jaxtyping import Array, Float

from ..drawing import box, rail
from ..marker import Pose
from ..outline import Outline


def sliding(slider: Pose, b: Pose, size: Float[Array, ""]) -> tuple[Outline, Outline]:
    """A box at the pose `slider`, and the axis of the marker `b` along which it slides."""
    return (
        Outline(rail(b, slider.position, size), "track", endless=True),
        Outline(box(slider, size), "link"),
    )
