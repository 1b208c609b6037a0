"""Attributes of elements of MJCF that become arguments of parts of a scene."""

from typing import Any

import numpy as np

from ...common.errors import SceneError
from ...scene.effect.actuator import Actuator
from ...scene.effect.joint_damper import JointDamper
from ...scene.effect.joint_inertia import JointInertia
from ...scene.effect.joint_spring import JointSpring
from ...scene.effect.joint_stop import JointStop
from ...scene.effect.torsion_damper import TorsionDamper
from ...scene.effect.torsion_spring import TorsionSpring
from ...scene.motion import TURN

# The end of a range that has none: the largest number of MuJoCo.
_OPEN = 1e10


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
    """Name what a joint has instead of an effect; "" if it can have nothing of the kind."""
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
        case JointStop():
            # The range of a ball joint begins at zero.
            return limits("", 0.0 if part.motion == TURN else part.lower, part.upper)
    return ""


def activated(part: Actuator) -> str:
    """The attributes of the state of an actuator.

    Raises SceneError for one that does not begin at zero, which files have in keyframes alone.
    """
    a = part.activation
    if a is None:
        return ""
    if float(a.start) != within(0.0, a.least, a.largest):
        raise SceneError(
            f"save: the activation of '{part.label()}' begins at {float(a.start):g}, and in MJCF "
            "without keyframes at zero; set start to zero, or save the scene as TOML."
        )
    text = ' dyntype="integrator"'
    if a.time_constant is not None:
        text = f' dyntype="filterexact" dynprm="{words(a.time_constant)}"'
    return text + limits("act", a.least, a.largest)


def limits(kind: str, low: Any, high: Any) -> str:
    """The attributes of a range that may be open on one side; "" if it has no end."""
    if low is None and high is None:
        return ""
    ends = [-_OPEN if low is None else low, _OPEN if high is None else high]
    return f' {kind}limited="true" {kind}range="{words(ends)}"'


def open_ends(values: Any) -> tuple[float | None, float | None]:
    """The ends of a range of MuJoCo's, in order; None for one that is open, the inverse of
    `limits`.
    """
    low, high = sorted(float(x) for x in values)
    return None if low <= -_OPEN else low, None if high >= _OPEN else high


def within(x: float, least: Any, largest: Any) -> float:
    """A number cut off at two values, where they are given."""
    above = x if least is None else max(x, float(least))
    return above if largest is None else min(above, float(largest))


def words(numbers: Any) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(x)) for x in np.ravel(np.asarray(numbers, float)))
