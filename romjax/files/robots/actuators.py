"""The actuators of a robot, which signals of their names drive."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...common.checks import unknown_name
from ...common.errors import SceneError
from ...scene.effect.activation import Activation
from ...scene.effect.actuator import Actuator
from ...scene.effect.joint_damper import ANY
from ...scene.marker import Marker
from ...scene.signal import AbstractSignal, Constant
from .attributes import open_ends, within
from .connections import tendon_ends
from .joints import Measured
from .model import Model
from .tree import Tree

# MuJoCo's numbers of what an actuator moves, and of the state that it has.
_JOINT, _TENDON = (0, 1), 3
_NO_STATE, _INTEGRATOR, _FILTERS = 0, 1, (2, 3)


def actuators(
    model: Model,
    tree: Tree,
    measured: dict[int, Measured],
    signals: Mapping[str, AbstractSignal],
    data: Any,
) -> Iterator[Actuator]:
    """The actuators, with their signals or, without one, what MuJoCo's `data` of the start say they
    have at it; and motors at the joints that `signals` name.

    Raises SceneError for a signal of no actuator and no joint.
    """
    arrays, used = model.arrays, set[str]()
    for i in range(arrays.nu):
        name = model.numbered("actuator", i)
        used.add(name)
        held = Constant(float(data.ctrl[arrays.actuator_ctrladr[i]]))
        yield _actuator(model, tree, i, measured, signals.get(name, held), data.act)
    free = {
        joint.name: number
        for number, joint in measured.items()
        if joint.motion not in ("", ANY) and joint.name not in used
    }
    for name, signal in signals.items():
        if name in used:
            continue
        if name not in free:
            raise SceneError(
                str(unknown_name(str(model.root.path), "actuator or joint", name, [*used, *free]))
            )
        joint = measured[free[name]]
        least, largest = _joint_range(model, free[name], 1.0)
        yield Actuator(
            joint.a,
            joint.b,
            signal,
            gear=joint.sign,
            least=least,
            largest=largest,
            motion=joint.motion,
            name=name,
        )


def _actuator(
    model: Model,
    tree: Tree,
    number: int,
    measured: dict[int, Measured],
    signal: AbstractSignal,
    states: Any,
) -> Actuator:
    arrays = model.arrays
    a, b, motion, sign, joint = _moves(model, tree, number, measured)
    _check_law(model, number)
    gear, bias = float(arrays.actuator_gear[number, 0]), arrays.actuator_biasprm[number]
    least, largest = _range(arrays, "force", number)
    if joint is not None:
        lower, upper = _joint_range(model, joint, gear)
        # The joint cuts off what is left of the force by then.
        least = lower if least is None else within(least, lower, upper)
        largest = upper if largest is None else within(largest, lower, upper)
    lowest, highest = _range(arrays, "ctrl", number)
    biased = int(arrays.actuator_biastype[number]) != 0
    # MuJoCo's bias b₀ + b₁ s + b₂ s' is added; here feedback is subtracted.
    offset, proportional, derivative = (float(x) if biased else 0.0 for x in bias[:3])
    return Actuator(
        a,
        b,
        signal,
        gear=sign * gear,
        gain=float(arrays.actuator_gainprm[number, 0]),
        offset=offset,
        proportional=-proportional,
        derivative=-derivative,
        least=least,
        largest=largest,
        least_signal=lowest,
        largest_signal=highest,
        motion=motion,
        name=model.numbered("actuator", number),
        activation=_activation(model, number, states),
    )


def _activation(model: Model, number: int, states: Any) -> Activation | None:
    """The state of an actuator that filters or integrates its control, from its start on."""
    arrays = model.arrays
    kind = int(arrays.actuator_dyntype[number])
    if kind == _NO_STATE:
        return None
    least, largest = _range(arrays, "act", number)
    start = float(states[arrays.actuator_actadr[number]])
    return Activation(
        None if kind == _INTEGRATOR else float(arrays.actuator_dynprm[number, 0]),
        least,
        largest,
        # MuJoCo brings one that begins beyond its range back.
        within(start, least, largest),
    )


def _moves(
    model: Model, tree: Tree, number: int, measured: dict[int, Measured]
) -> tuple[Marker, Marker, str, float, int | None]:
    """The markers, the motion and its sign, and the number of the joint, if it moves one."""
    kind, target = (
        int(model.arrays.actuator_trntype[number]),
        int(model.arrays.actuator_trnid[number, 0]),
    )
    if kind == _TENDON:
        return *tendon_ends(model, tree, target), "distance", 1.0, None
    if kind not in _JOINT or measured[target].motion in ("", ANY):
        raise model.refuse(
            "actuator", number, "it moves no hinge, slide or tendon; drive one of these."
        )
    joint = measured[target]
    return joint.a, joint.b, joint.motion, joint.sign, target


def _check_law(model: Model, number: int) -> None:
    """Refuse what is no affine law of one control, or one state that filters or integrates it."""
    arrays = model.arrays
    words = ""
    kind = int(arrays.actuator_dyntype[number])
    if kind not in (_NO_STATE, _INTEGRATOR, *_FILTERS) or arrays.actuator_ctrlnum[number] != 1:
        words = "romjax has no such state; set dyntype to none, integrator, filter or filterexact"
    elif kind in _FILTERS and not arrays.actuator_dynprm[number, 0] > 0:
        words = "its time constant is zero; give a positive one, or set dyntype to none"
    elif int(arrays.actuator_gaintype[number]) != 0 or int(arrays.actuator_biastype[number]) > 1:
        words = "its force is no linear law of the signal, the position and the speed; give one"
    elif np.any(arrays.actuator_dampingpoly[number]):
        words = "its damping is a polynomial; give one number"
    if words:
        raise model.refuse("actuator", number, f"{words}.")


def _range(arrays: Any, kind: str, number: int) -> tuple[float | None, float | None]:
    if not getattr(arrays, f"actuator_{kind}limited")[number]:
        return None, None
    return open_ends(getattr(arrays, f"actuator_{kind}range")[number])


def _joint_range(model: Model, joint: int, gear: float) -> tuple[float | None, float | None]:
    """The range of an actuator's force that the range of the joint leaves it."""
    arrays = model.arrays
    if not arrays.jnt_actfrclimited[joint] or not gear:
        return None, None
    drives = [
        i
        for i in range(arrays.nu)
        if int(arrays.actuator_trntype[i]) in _JOINT and int(arrays.actuator_trnid[i, 0]) == joint
    ]
    if len(drives) > 1:
        raise model.refuse(
            "joint", joint, "its actuatorfrcrange is for several actuators; give each a forcerange."
        )
    ends = (None if x is None else x / gear for x in open_ends(arrays.jnt_actfrcrange[joint]))
    least, largest = ends
    return (least, largest) if gear > 0 else (largest, least)
