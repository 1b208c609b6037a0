"""How MuJoCo's constraints yield, by the numbers solref and solimp of a file."""

import numpy as np

from .model import Model

# Within these MuJoCo cuts off the impedances and the middle of the width, and its own default of
# solref (mjMINIMP, mjMAXIMP, mj_defaultSolRefImp); denominators are no less than mjMINVAL.
_LEAST, _LARGEST = 1e-4, 0.9999
_DEFAULT = 0.02, 1.0
_TINY = 1e-15


def reference(model: Model, solref: np.ndarray) -> tuple[float, float]:
    """The stiffness [1/s²] per mass of a constraint of impedance one, and its damping ratio.

    As in MuJoCo, solref is a time constant [s] and a damping ratio, both positive, or a stiffness
    and a damping with negative signs; mixed, it is the default. A time constant is no less than two
    time steps, unless <flag refsafe="disable"/> says that it may be.
    """
    time, ratio = (float(x) for x in solref)
    if (time > 0) != (ratio > 0):
        time, ratio = _DEFAULT
    if time <= 0:
        return -time, -0.5 * ratio / max(-time, _TINY) ** 0.5
    option = model.arrays.opt
    if not option.disableflags & int(model.mujoco.mjtDisableBit.mjDSBL_REFSAFE):
        time = max(time, 2 * float(option.timestep))
    return 1 / max((time * ratio) ** 2, _TINY), ratio


def held(stiffness: float, solimp: np.ndarray, depth: float) -> float:
    """The force per mass [m/s²] that a contact of MuJoCo's holds at rest at a depth r [m].

    With the impedance d(r), from d₀ to d₁, it is r k d² / (1 − d) for the `stiffness` k / d₁² of
    the reference acceleration (MuJoCo's documentation, Computation, "Parameters").
    """
    d = _impedance(solimp, depth)
    largest = float(np.clip(solimp[1], _LEAST, _LARGEST))
    return depth * stiffness / largest**2 * d**2 / (1 - d)


def resting_depth(stiffness: float, solimp: np.ndarray, weight: float) -> float:
    """The depth [m] at which a contact of MuJoCo's holds a weight per mass [m/s²], both positive;
    `stiffness` as that of `held`.
    """
    low, high = 0.0, weight / stiffness
    while held(stiffness, solimp, high) < weight:
        high *= 2
    # These are more halvings than the digits of a double allow, whatever the bracket is.
    for _ in range(100):
        middle = 0.5 * (low + high)
        enough = held(stiffness, solimp, middle) >= weight
        low, high = (low, middle) if enough else (middle, high)
    return high


def _impedance(solimp: np.ndarray, depth: float) -> float:
    """MuJoCo's d(r), between 0 and 1: two powers that meet in the middle of the width; without a
    width it is the mean of both ends.
    """
    first, last, middle = (float(np.clip(solimp[i], _LEAST, _LARGEST)) for i in (0, 1, 3))
    width, power = float(solimp[2]), max(float(solimp[4]), 1.0)
    if width <= _TINY:
        return 0.5 * (first + last)
    x = min(depth / width, 1.0)
    y = (
        x**power / middle ** (power - 1)
        if x <= middle
        else 1 - (1 - x) ** power / (1 - middle) ** (power - 1)
    )
    return float(first + y * (last - first))
