"""Modes of mechanisms in space that turn steadily, as seen from a frame that turns with them."""

import numpy as np
import pytest
from comparison import assert_close

import romjax as rj
from romjax import spatial

# Required: relative to the largest frequency.
EXACT = 1e-9
SPEED, MASS, STIFFNESS, HEIGHT = 20.0, 2.0, 900.0, 0.4
AXIAL, ACROSS = 0.05, 0.03
Z = (0.0, 0.0, 1.0)


def rotor(axis) -> rj.AbstractSystem:
    """A round disk on two springs without length, whose ends are on its axis."""
    along = np.eye(3)[axis]
    disk = spatial.RigidBody("disk", MASS, ACROSS + (AXIAL - ACROSS) * along)
    springs = [
        rj.Spring(disk.at(side * HEIGHT * along), rj.ground.at(side * HEIGHT * along), STIFFNESS)
        for side in (-1, 1)
    ]
    return rj.assemble(rj.Scene([disk], [], springs))


@pytest.mark.parametrize("axis", [2, 0])
def test_whirl(axis):
    """Both whirls of the shaft, ω = ±√(2k/m), those of the tilt, A ω² − C Ω ω − 2 k h² = 0, less
    the speed of the frame; and along the axis √(2k/m).
    """
    turning = SPEED if axis == 2 else SPEED * np.eye(3)[axis]
    found = rj.modes(rotor(axis), turning=turning)
    bounce = np.sqrt(2 * STIFFNESS / MASS)
    tilt = np.roots([ACROSS, -AXIAL * SPEED, -2 * STIFFNESS * HEIGHT**2])
    seen = np.abs(np.array([bounce, -bounce, *tilt]) - SPEED)
    wanted = np.sort([bounce, *seen])
    assert found.frequencies.shape == (6,)  # and the spin
    assert_close(found.frequencies[1:], wanted, EXACT, scale=wanted[-1])
    assert found.is_stable


def blade(parts, hinge) -> rj.AbstractSystem:
    """A hub on a bearing, and a blade on a hinge about an axis, in space, at its rim."""
    if parts is rj:
        hub, arm = rj.RigidBody("hub", 3.0, 0.2), rj.RigidBody("arm", 0.5, 0.012, (0.7, 0.0))
        middle, rim, root = (0.0, 0.0), (0.3, 0.0), (-0.4, 0.0)
        turned = [{}, {}]
    else:
        hub = spatial.RigidBody("hub", 3.0, (0.1, 0.1, 0.2))
        arm = spatial.RigidBody("arm", 0.5, (0.001, 0.0115, 0.012), (0.7, 0.0, 0.0))
        middle, rim, root = (0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (-0.4, 0.0, 0.0)
        turned = [{"axis": Z}, {"axis": hinge}]
    bearing = parts.Revolute(hub.at(middle, **turned[0]), rj.ground.at(middle, **turned[0]))
    ends = arm.at(root, **turned[1]), hub.at(rim, **turned[1])
    spring = rj.TorsionSpring(*ends, stiffness=4.0)
    return rj.assemble(rj.Scene([hub, arm], [bearing, parts.Revolute(*ends)], [spring]))


@pytest.mark.slow
def test_lead_lag_as_in_the_plane():
    """The same blade and hub in the plane: the turn of all, and lead and lag."""
    plane = rj.modes(blade(rj, None), turning=SPEED)
    space = rj.modes(blade(spatial, Z), turning=SPEED)
    assert_close(space.frequencies[1], plane.frequencies[1], EXACT, scale=SPEED)
    assert space.frequencies.shape == plane.frequencies.shape == (2,)


@pytest.mark.slow
def test_flap():
    """ω² = (k + Ω² (m r (e + r) + J_z − J_x)) / (J_y + m r²)."""
    found = rj.modes(blade(spatial, (0.0, 1.0, 0.0)), turning=SPEED)
    mass, arm, rim = 0.5, 0.4, 0.3
    stiffness = 4.0 + SPEED**2 * (mass * arm * (rim + arm) + 0.012 - 0.001)
    wanted = np.sqrt(stiffness / (0.0115 + mass * arm**2))
    assert_close(found.frequencies[1], wanted, EXACT, scale=wanted)


@pytest.mark.instant
def test_a_vector_in_the_plane():
    with pytest.raises(rj.InputError, match=r"turning has shape \(3,\)"):
        rj.modes(blade(rj, None), turning=np.ones(3))
