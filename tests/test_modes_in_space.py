"""Small motions in space, on a tangent space without lengths of quaternions."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from comparison import assert_close
from verification_problems.small import platform, platform_right
from zoo import GRAVITY

import romjax as rj
from romjax import spatial
from romjax.study.reduction import Run

# Required: relative to the largest frequency.
EXACT = 1e-9
Y = (0.0, 1.0, 0.0)


def hinged(height, *effects, **pose) -> rj.AbstractSystem:
    """A mass at a `height` above, or below, a hinge about y."""
    body = spatial.RigidBody("top", 1.0, (0.1, 0.2, 0.3), position=(0.0, 0.0, height), **pose)
    hinge = spatial.Revolute(
        body.at((0.0, 0.0, -height), axis=Y), rj.ground.at((0.0, 0.0, 0.0), axis=Y)
    )
    return rj.assemble(rj.Scene([body], [hinge], [rj.Gravity((0.0, 0.0, -GRAVITY)), *effects]))


@pytest.mark.slow
def test_a_floating_platform():
    """Six modes, by 6 × 6 matrices; under a transformation, where no singular value is known and
    the count of modes is that of the structure.
    """
    wanted = platform_right()
    found = jax.jit(lambda scene: rj.modes(rj.assemble(scene)).frequencies)(platform())
    assert_close(found, wanted, EXACT, scale=wanted[-1])


@pytest.mark.slow
def test_flapping_on_an_arm_that_is_driven():
    """J ω² = Ω² (J − J_x + m a l / 2) of a blade with its hinge at a = l from the axis."""
    speed, inertia = 3.0, (1e-3, 1 / 12, 1 / 12)
    arm, blade = (
        spatial.RigidBody(
            name,
            1.0,
            inertia,
            position=(at, 0.0, 0.0),
            velocity=(0.0, at * speed, 0.0),
            angular_velocity=(0.0, 0.0, speed),
        )
        for name, at in (("arm", 0.5), ("blade", 1.5))
    )
    root = arm.at((-0.5, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0))
    flap = blade.at((-0.5, 0.0, 0.0), axis=Y), arm.at((0.5, 0.0, 0.0), axis=Y)
    joints = rj.Revolute(*root), rj.Revolute(*flap), rj.PrescribedAngle(*root, rj.Ramp(speed))
    system = rj.assemble(rj.Scene([arm, blade], joints))
    found = rj.modes(system, v=system.v0)
    assert_close(found.frequencies, [np.sqrt(3 * (1 / 3 - 1e-3 + 1 / 2)) * speed], EXACT)


def test_a_pendulum_has_one_mode():
    """√(m g l / (J + m l²)), for a quaternion of any length; and one freedom in reports."""
    system = hinged(-1.0)
    at = jnp.asarray([0.0, 0.0, -1.0, 3.0, 0.0, 0.0, 0.0])
    for q in (system.q0, at):
        found = rj.modes(system, q)
        assert_close(found.frequencies, [np.sqrt(GRAVITY / 1.2)], EXACT)
    assert_close(found.shapes[3:, 0] @ at[3:], 0.0, EXACT)


MIDDLE = rj.Marker("top", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
TORQUE = spatial.Torque(MIDDLE, Y, rj.Constant(1.0))


class Regulator(rj.AbstractMarkerEffect):
    """A torque about y, −k x, of a state of the angle about y and its rate."""

    at: rj.Marker
    gain: jax.Array
    needs_twists: ClassVar[bool] = True
    dimensions: ClassVar[tuple[int, ...]] = (3,)

    def wrenches(self, t, poses, twists):
        w, _, y, _ = poses[0].turn
        state = jnp.stack([2 * jnp.arctan2(y, w), twists[0].angular_velocity[1]])
        torque = jnp.stack([jnp.zeros(()), -(self.gain @ state), jnp.zeros(())])
        return (rj.Wrench(jnp.zeros(3), torque),)

    def check(self):
        pass


@pytest.mark.slow
def test_a_regulator_in_space():
    """A linear quadratic regulator exists, its poles are those of the mechanism with it, and it
    catches half a radian.
    """
    model = rj.linearize(hinged(1.0), {"torque": TORQUE}, ["top.p2", "top.p2'"])
    a, b, c = (np.asarray(x) for x in (model.A, model.B, model.C))
    growth = np.sqrt(GRAVITY / 1.2)
    assert_close(np.sort(np.linalg.eigvals(a).real), [-growth, growth], EXACT)
    c = 2 * c  # angles, of which p2 is half
    riccati = scipy.linalg.solve_continuous_are(a, b, c.T @ np.diag([30.0, 1.0]) @ c, np.eye(1))
    gain = b.T @ riccati @ np.linalg.inv(c)
    poles = np.linalg.eigvals(a - b @ gain @ c)
    closed = hinged(1.0, Regulator(MIDDLE, jnp.asarray(gain[0])))
    found = np.asarray(rj.modes(closed).values)
    assert_close(np.sort_complex(found), np.sort_complex(poles), EXACT, scale=growth)
    tilt = 0.5
    start = [np.sin(tilt), 0.0, np.cos(tilt), np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0]
    run = rj.simulate(closed, np.linspace(0.0, 5.0, 11), q0=np.asarray(start), audit=False)
    assert run.is_valid
    assert abs(run.q[-1, 0]) < 1e-3


def test_reports_count_no_lengths():
    """Of a full model in space, its freedoms."""
    system = rj.assemble(rj.gallery.wing_nut())
    assert Run("full", system, None, 0.0, 0.0, None).degrees_of_freedom == 6
