"""Passive effects in the joints of a robot: springs, damping, friction, inertia and stops."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...scene.effect.bushing import Bushing
from ...scene.effect.contact import Friction
from ...scene.effect.damper import Damper
from ...scene.effect.joint_damper import ANY, JointDamper
from ...scene.effect.joint_inertia import JointInertia
from ...scene.effect.joint_spring import JointSpring
from ...scene.effect.joint_stop import JointStop
from ...scene.marker import Marker
from ...scene.motion import LENGTHS, TURN
from .attributes import open_ends
from .impedance import reference
from .joints import Measured
from .model import Model

# The dissipation of a stop [s], and the creep of friction that sticks [1/s]: for angles in radians,
# and for lengths in sizes of the robot.
_DISSIPATION, _CREEP = 2.0, 1e-3


class Reflected:
    """The inertia and the damping of actuators that joints feel, by the numbers of the joints."""

    def __init__(self, arrays: Any):
        self.inertia, self.damping = np.zeros(arrays.njnt), np.zeros(arrays.njnt)
        for i in range(arrays.nu):
            joint = int(arrays.actuator_trnid[i, 0])
            if int(arrays.actuator_trntype[i]) in (0, 1):
                squared = float(arrays.actuator_gear[i, 0]) ** 2
                self.inertia[joint] += squared * float(arrays.actuator_armature[i])
                self.damping[joint] += squared * float(arrays.actuator_damping[i])


def passive(model: Model, measured: dict[int, Measured]) -> Iterator[Any]:
    """The effects in all joints."""
    reflected = Reflected(model.arrays)
    for number, joint in measured.items():
        _refuse_polynomials(model, number)
        yield from _of_joint(model, number, joint, reflected)


def _of_joint(model: Model, number: int, joint: Measured, reflected: Reflected) -> Iterator[Any]:
    arrays, a, b = model.arrays, joint.a, joint.b
    dof = int(arrays.jnt_dofadr[number])
    stiffness = float(arrays.jnt_stiffness[number])
    damping = float(arrays.dof_damping[dof]) + reflected.damping[number]
    inertia = float(arrays.dof_armature[dof]) + reflected.inertia[number]
    friction = float(arrays.dof_frictionloss[dof])
    if joint.motion in ("", ANY):
        yield from _of_turns(model, number, joint, stiffness, damping)
        if inertia or friction:
            words = "armature" if inertia else "frictionloss"
            remedy = "hinges and slides can have it; take it out, or use <freejoint/>"
            raise model.refuse("joint", number, f"it has {words} in several directions; {remedy}.")
        return
    motion, sign = joint.motion, joint.sign
    if stiffness:
        rest = sign * float(arrays.qpos_spring[arrays.jnt_qposadr[number]])
        yield JointSpring(a, b, stiffness, rest, motion)
    if damping or friction:
        yield JointDamper(a, b, damping, rubbing(model, friction, motion), motion)
    if inertia:
        yield JointInertia(a, b, inertia, motion)
    if arrays.jnt_limited[number]:
        ends = open_ends(sign * arrays.jnt_range[number])
        if ends != (None, None):
            yield stop(a, b, ends, motion, model, number)


def _of_turns(
    model: Model, number: int, joint: Measured, stiffness: float, damping: float
) -> Iterator[Any]:
    """Return the effects in a ball joint, or between a free body and the ground."""
    a, b, free = joint.a, joint.b, joint.motion == ""
    if stiffness:
        yield Bushing(a, b, [stiffness if free else 0.0] * 3 + [stiffness] * 3)
    if damping:
        yield JointDamper(a, b, damping, motion=ANY)
        if free:
            yield Damper(a, b, damping)
    if model.arrays.jnt_limited[number]:
        largest = float(model.arrays.jnt_range[number, 1])
        # No turn is larger than π.
        if largest <= np.pi:
            yield stop(a, b, (None, largest), TURN, model, number)


def rubbing(model: Model, friction: float, motion: str) -> Friction | None:
    """The friction of a motion, if there is some."""
    return Friction(friction, _CREEP * _size(model, motion)) if friction else None


def dissipation(model: Model, motion: str) -> float:
    """How much a stop of a motion takes of what hits it."""
    return _DISSIPATION / _size(model, motion)


def _size(model: Model, motion: str) -> float:
    """Return the size of a large motion: the size of the robot, or 1 rad."""
    return model.size if motion in LENGTHS else 1.0


def stop(
    a: Marker,
    b: Marker,
    ends: tuple[float | None, float | None],
    motion: str,
    model: Model,
    number: int,
) -> JointStop:
    """The stops of a joint, as stiff as MuJoCo's for the inertia that the joint has at first."""
    arrays = model.arrays
    stiffness, _ = reference(model, arrays.jnt_solref[number])
    mass = 1 / float(arrays.dof_invweight0[arrays.jnt_dofadr[number]])
    return JointStop(a, b, *ends, mass * stiffness, dissipation(model, motion), motion)


def _refuse_polynomials(model: Model, number: int) -> None:
    arrays, dof = model.arrays, int(model.arrays.jnt_dofadr[number])
    for what, values in (
        ("stiffness", arrays.jnt_stiffnesspoly[number]),
        ("damping", arrays.dof_dampingpoly[dof]),
    ):
        if np.any(values):
            raise model.refuse(
                "joint", number, f"its {what} is a polynomial; give one number, the linear part."
            )
