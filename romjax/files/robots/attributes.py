"""What elements of MJCF say of the parts of a scene."""

from typing import Any

import numpy as np

from ...scene.effect.joint_damper import JointDamper
from ...scene.effect.joint_inertia import JointInertia
from ...scene.effect.joint_spring import JointSpring
from ...scene.effect.joint_stop import JointStop
from ...scene.effect.torsion_damper import TorsionDamper
from ...scene.effect.torsion_spring import TorsionSpring


def box(body: Any, pad: str) -> str:
    """The box that a body is drawn in, for viewers: it has no mass, and touches nothing."""
    extent = np.asarray(body.extent, float)
    low, high = (
        (-0.5 * extent, 0.5 * extent) if extent.ndim == 1 else (extent.min(0), extent.max(0))
    )
    return (
        f'{pad}  <geom type="box" pos="{words(0.5 * (low + high))}" '
        f'size="{words(np.maximum(0.5 * (high - low), 1e-3))}" contype="0" conaffinity="0"/>\n'
    )


def motion_of(part: Any) -> str:
    """The motion that an effect measures, "" of one that measures none."""
    if isinstance(part, TorsionSpring | TorsionDamper):
        return "angle"
    return str(getattr(part, "motion", ""))


def attributes(part: Any) -> str:
    """What a joint has instead of an effect; "" if it can have nothing of the kind."""
    match part:
        case JointSpring():
            return f' stiffness="{words(part.stiffness)}" springref="{words(part.rest)}"'
        case TorsionSpring():
            return f' stiffness="{words(part.stiffness)}" springref="{words(part.rest_angle)}"'
        case TorsionDamper():
            return f' damping="{words(part.damping)}"'
        case JointDamper():
            friction = part.friction
            rubbing = f' frictionloss="{words(friction.coefficient)}"' if friction else ""
            return f' damping="{words(part.damping)}"{rubbing}'
        case JointInertia():
            return f' armature="{words(part.inertia)}"'
        case JointStop() if part.lower is not None and part.upper is not None:
            return f' range="{words([part.lower, part.upper])}"'
    return ""


def words(numbers: Any) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(x)) for x in np.ravel(np.asarray(numbers, float)))
