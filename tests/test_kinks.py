"""Derivatives of motions through kinks of forces, where stops begin and ropes get taut."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close

import romjax as rj

GRAVITY, END, RTOL = 9.81, 0.9, 1e-6


def wheel(numbers):
    """A wheel between two stops, by its rate, their angle and their stiffness."""
    rate, largest, stiffness = numbers
    body = rj.RigidBody("wheel", 1.0, 0.27, angular_velocity=rate)
    ends = body.at(), rj.ground.at()
    stop = rj.JointStop(*ends, -largest, largest, stiffness)
    return rj.Scene([body], [rj.Revolute(*ends)], [stop]), "wheel.phi"


def turned(rate, largest, stiffness):
    """Its angle at the end: at a steady rate, and half an oscillation at each stop."""
    fast = np.sqrt(stiffness / 0.27)
    free, pushed = largest / rate, np.pi / fast
    half, after = np.divmod(END + free, 2 * free + pushed)
    beyond = largest + rate / fast * np.sin(fast * (after - 2 * free))
    return (-1) ** half * np.where(after < 2 * free, rate * after - largest, beyond)


def ball(numbers):
    """What falls into a slack rope, by its mass, the rope's length and its stiffness."""
    mass, slack, stiffness = numbers
    body = rj.RigidBody("ball", mass, 0.1)
    rope = rj.Rope(body.at(), rj.ground.at(), slack, stiffness)
    return rj.Scene([body], effects=[rj.Gravity(), rope]), "ball.y"


def caught(mass, slack, stiffness):
    """Its height at the end: it has been thrown back once, and flies."""
    taut, fast = np.sqrt(2 * slack / GRAVITY), np.sqrt(stiffness / mass)
    speed, sag = GRAVITY * taut, GRAVITY / fast**2
    contact = 2 * (np.pi - np.arctan2(speed / fast, sag)) / fast
    flown = END - taut - contact
    assert 0 < flown < 2 * taut
    return -slack + speed * flown - 0.5 * GRAVITY * flown**2


CASES = {
    "stop": (wheel, turned, [(3.0, 0.4, 500.0), (4.1, 0.4, 500.0), (2.6, 0.3, 900.0)]),
    "rope": (ball, caught, [(2.0, 0.5, 4e3), (1.0, 0.4, 500.0), (3.0, 0.5, 9e3)]),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_gradients_through_kinks_are_as_accurate_as_the_motion(case):
    """Within 100 times rtol: stages on the wrong side of a kink gave errors of percents."""
    make, closed, batch = CASES[case]

    def end(numbers):
        scene, name = make(numbers)
        ts = jnp.array([0.0, END])
        return rj.simulate(rj.assemble(scene), ts, rtol=RTOL, audit=False)[name][-1]

    values, slopes = rj.jit(jax.vmap(jax.value_and_grad(end)))(jnp.array(batch))
    for numbers, value, slope in zip(np.array(batch), values, slopes, strict=True):
        assert_close(value, closed(*numbers), 10 * RTOL)
        steps = np.diag(1e-5 * numbers)
        right = [(closed(*(numbers + d)) - closed(*(numbers - d))) / (2 * np.sum(d)) for d in steps]
        assert_close(slope * numbers, right * numbers, 100 * RTOL, np.max(np.abs(right * numbers)))
