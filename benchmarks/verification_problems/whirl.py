"""What whirls: a disk, a rigid rotor and a shaft, as seen from frames that turn with them."""

import numpy as np
import scipy.linalg

import romjax as rj
from romjax import spatial

from .problem import Problem, named
from .small import EIGEN, POLYNOMIAL
from .turning import EI, LENGTH, MASS, ORIGIN, Z

TURNING, ROTOR, SPRING, HEIGHT, AXIAL, TILT = 20.0, 2.0, 900.0, 0.4, 0.05, 0.03

Y = (0.0, 1.0, 0.0)


def disk(stiffness=25.0) -> rj.Scene:
    one = rj.RigidBody("disk", 1.3, 0.11)
    return rj.Scene([one], [], [rj.Spring(one.at(), rj.ground.at(), stiffness * 1.3)])


def disk_again(speed=2.0, stiffness=25.0) -> np.ndarray:
    """Of the rotating frame, x'' + 2 Ω J x' + (k − Ω²) x = 0."""
    turn = 2 * speed * np.array([[0.0, -1.0], [1.0, 0.0]])
    below = np.hstack([-(stiffness - speed**2) * np.eye(2), -turn])
    values = scipy.linalg.eigvals(np.vstack([np.eye(4)[2:], below]))
    return np.sort(np.abs(values.imag))[::2]


def rotor() -> rj.Scene:
    """A round disk on two springs without length, whose ends are on its axis."""
    along = np.array(Z)
    one = spatial.RigidBody("disk", ROTOR, (TILT, TILT, AXIAL))
    springs = [
        rj.Spring(one.at(side * HEIGHT * along), rj.ground.at(side * HEIGHT * along), SPRING)
        for side in (-1, 1)
    ]
    return rj.Scene([one], [], springs)


def rotor_right() -> np.ndarray:
    """Whirl of the shaft, ω = ±√(2k/m), and of the tilt, A ω² − C Ω ω − 2 k h² = 0, less the
    speed of the frame; and along the axis √(2k/m).
    """
    bounce = np.sqrt(2 * SPRING / ROTOR)
    tilt = np.roots([TILT, -AXIAL * TURNING, -2 * SPRING * HEIGHT**2])
    return np.sort([bounce, *np.abs(np.array([bounce, -bounce, *tilt]) - TURNING)])


def rotor_again() -> np.ndarray:
    """Of x + i y and of the tilt in that form, in the frame that stands, by companion matrices."""
    turns = []
    for mass, gyroscopic, stiffness in (
        (ROTOR, 0.0, 2 * SPRING),
        (TILT, AXIAL * TURNING, 2 * SPRING * HEIGHT**2),
    ):
        companion = np.array([[0.0, 1.0], [-stiffness / mass, 1j * gyroscopic / mass]])
        turns += list(scipy.linalg.eigvals(companion).imag)
    return np.sort([np.sqrt(2 * SPRING / ROTOR), *np.abs(np.array(turns) - TURNING)])


SPIN, THICK = 40.0, 0.02


def shaft() -> rj.Scene:
    """A Rayleigh shaft on a ball joint and a bearing that slides along it."""
    across = MASS * LENGTH**2 / 12 + THICK / 2
    one = spatial.Beam(
        "shaft",
        MASS,
        LENGTH,
        (THICK, across, across),
        EI=EI,
        bending=9,
        rotary=True,
        position=(LENGTH / 2, 0.0, 0.0),
    )
    far = (LENGTH, 0.0, 0.0)
    joints = [
        spatial.Spherical(one.at("start"), rj.ground.at(ORIGIN)),
        *(spatial.PointOnPlane(one.at("end"), rj.ground.at(far, axis=axis)) for axis in (Y, Z)),
    ]
    return rj.Scene([one], joints)


def whirling() -> np.ndarray:
    """(m/L + i β²) ω² − 2 i β² Ω ω − EI β⁴ = 0 of sections with a moment i about their diameters,
    β = kπ / L, seen from the frame that turns.
    """
    wanted = []
    for k in range(1, 5):
        beta = k * np.pi / LENGTH
        tilted = THICK / 2 / LENGTH * beta**2
        wanted += list(np.roots([MASS / LENGTH + tilted, -2 * tilted * SPIN, -EI * beta**4]) - SPIN)
    return np.sort(np.abs(wanted))[:3]


def whirling_again() -> np.ndarray:
    """Galerkin's method with sines for both planes in the frame that turns."""
    wanted = []
    for k in range(1, 5):
        beta = k * np.pi / LENGTH
        tilted = THICK / 2 / LENGTH * beta**2
        mass, turn = MASS / LENGTH + tilted, np.array([[0.0, -1.0], [1.0, 0.0]])
        # x'' → x'' + 2 Ω J x' − Ω² x, and the gyroscopic 2 i β² Ω J' x' → with − Ω² on it.
        damp = 2 * SPIN * mass * turn - 2 * tilted * SPIN * turn
        spring = (EI * beta**4 - mass * SPIN**2 + 2 * tilted * SPIN**2) * np.eye(2)
        below = -np.hstack([spring, damp]) / mass
        wanted += list(np.abs(scipy.linalg.eigvals(np.vstack([np.eye(4)[2:], below])).imag))
    return np.sort(wanted)[::2][:3]


def whirling_found() -> np.ndarray:
    found = rj.modes(rj.assemble(shaft()), turning=(SPIN, 0.0, 0.0)).frequencies
    return np.asarray([x for x in found if x > 1e-3][:3])


PROBLEMS = (
    Problem(
        "disk seen turning",
        "A disk on a spring without length, ω = 5 rad/s, from a frame that turns by 2 rad/s:\n"
        "ω ± Ω.",
        "closed form",
        lambda: named("backward [rad/s], forward [rad/s]", [3.0, 7.0]),
        ("closed form", EIGEN.format("the equations of the frame that turns")),
        lambda: rj.modes(rj.assemble(disk()), turning=2.0).frequencies[1:],
        disk_again,
        scene=disk,
    ),
    Problem(
        "whirl of a rigid rotor",
        "A disk on two springs of 900 N/m in space turns by 20 rad/s. Frequencies of bounce,\n"
        "whirl and gyroscopic tilt, from the frame that turns.",
        "closed form",
        lambda: named(
            "first [rad/s], second [rad/s], third [rad/s], fourth [rad/s], fifth [rad/s]",
            rotor_right(),
        ),
        (POLYNOMIAL, EIGEN.format("the equations of the frame that stands")),
        lambda: rj.modes(rj.assemble(rotor()), turning=TURNING).frequencies[1:],
        rotor_again,
        scene=rotor,
    ),
    Problem(
        "whirl of a shaft",
        "A Rayleigh shaft on two bearings spins by 40 rad/s: its three lowest frequencies as\n"
        "seen from the shaft, which gyroscopic moments of its sections split.",
        "closed form",
        lambda: named("first [rad/s], second [rad/s], third [rad/s]", whirling()),
        ("roots of the characteristic polynomial", "sines in the frame that turns, by SciPy"),
        whirling_found,
        whirling_again,
        scene=shaft,
    ),
)
