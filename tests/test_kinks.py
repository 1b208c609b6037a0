"""Motions through kinks of forces, where stops begin, ropes get taut and points touch, and their
derivatives.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from scipy.special import beta
from tolerances import IDENTITY

import romjax as rj
from romjax.system.held import hold

GRAVITY, MASS, END, RTOL = 9.81, 0.4, 0.9, 1e-6


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


def thrown(numbers):
    """What is thrown at a floor, by its speed, its height and the floor's stiffness."""
    speed, height, stiffness = numbers
    body = rj.RigidBody("ball", MASS, 0.1, position=(0.0, height), velocity=(0.0, -speed))
    floor = rj.Contact(body.at(), rj.ground.at(), rj.Line(), stiffness)
    return rj.Scene([body], [], [floor]), "ball.y"


def returned(speed, height, stiffness):
    """Its height at the end: it has been thrown back as fast, by a force κ δ^(3/2) per mass."""
    deepest = (1.25 * MASS * speed**2 / stiffness) ** 0.4
    pushed = 2 * deepest / speed * 0.4 * beta(0.4, 0.5)
    return speed * (END - pushed) - height


CASES = {
    "stop": (wheel, turned, [(3.0, 0.4, 500.0), (4.1, 0.4, 500.0), (2.6, 0.3, 900.0)]),
    "contact": (thrown, returned, [(2.0, 0.5, 4e3), (3.0, 0.3, 1e3), (1.0, 0.3, 1e5)]),
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


# Of stops on both sides, which take energy, and of a rope that does.
LOWER, UPPER, LENGTH, STIFFNESS, DISSIPATION = -0.2, 0.6, 0.5, 300.0, 0.4


def pushed_by_stops(angle, rate, side):
    """The torque and the energy of the nearer stop, by what its law is held on."""
    edge, sign = (UPPER, 1) if angle > (LOWER + UPPER) / 2 else (LOWER, -1)
    return law(angle - edge, rate, sign, side)


def law(beyond, rate, sign, side):
    """A force and its energy beyond an edge in the direction of a sign: alike before it if held on
    the side -1, and none beyond it if held on the side 1.
    """
    acts = float(side < 0 or (side == 0 and sign * beyond > 0))
    factor = max(1 + DISSIPATION * sign * rate, 0)
    return -acts * STIFFNESS * beyond * factor, acts * STIFFNESS * beyond**2 / 2


def test_a_law_that_is_held_is_one_on_both_sides():
    """Of each of several effects by itself: two stops, of one structure, and a rope between."""
    wheels = [rj.RigidBody(name, 1.0, 0.27) for name in ("wheel", "other")]
    ball = rj.RigidBody("ball", 1.0, 0.1, position=(0.0, -0.3))
    numbers = {"stiffness": STIFFNESS, "dissipation": DISSIPATION}
    first, last = (rj.JointStop(b.at(), rj.ground.at(), LOWER, UPPER, **numbers) for b in wheels)
    rope = rj.Rope(ball.at(), rj.ground.at(), LENGTH, **numbers)
    hinges = [rj.Revolute(b.at(), rj.ground.at()) for b in wheels]
    system = rj.assemble(rj.Scene([wheels[0], ball, wheels[1]], hinges, [first, rope, last]))

    @jax.jit
    @jax.vmap
    def found(q, v, sides):
        state = hold(system, sides).state(0.0, q, v)
        return state.gaps(), state.force(), state.energy().potential

    lot = np.random.default_rng(5)
    q, v = lot.uniform(-0.9, 0.9, (8, 9)), lot.normal(size=(8, 9))
    rooms = [np.minimum(UPPER - q[:, i], q[:, i] - LOWER) for i in (2, 8)]
    rooms.insert(1, LENGTH - np.hypot(q[:, 3], q[:, 4]))
    assert all(np.ptp(np.sign(room)) == 2 for room in rooms)
    # The sides are in the order of the gaps.
    gaps = np.asarray(found(q, v, np.zeros((8, 3)))[0])
    order = [int(np.argmin(np.abs(gaps[0] - room[0]))) for room in rooms]
    assert_close(gaps[:, order].T, rooms, IDENTITY)
    for sides in itertools.product((-1.0, 0.0, 1.0), repeat=3):
        given = np.empty((8, 3))
        given[:, order] = sides
        _, forces, energies = found(q, v, given)
        for place, rate, force, energy in zip(q, v, forces, energies, strict=True):
            length = np.hypot(place[3], place[4])
            way = place[3:5] / length
            pull, stored = law(length - LENGTH, way @ rate[3:5], 1, sides[1])
            right = np.zeros(9)
            right[3:5] = pull * way
            for i, side in ((2, sides[0]), (8, sides[2])):
                right[i], one = pushed_by_stops(place[i], rate[i], side)
                stored += one
            assert_close(force, right, IDENTITY, STIFFNESS)
            assert_close(energy, stored, IDENTITY, STIFFNESS)
