"""The benchmark bicycle: four bodies on two wheels that roll without slip.

Meijaard, Papadopoulos, Ruina, Schwab, "Linearized dynamics equations for the balance and steer of a
bicycle", Proc. R. Soc. A 463 (2007), doi:10.1098/rspa.2007.1857. Their y and z axes point to the
right and down, those here to the left and up.
"""

import functools

import jax
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import romjax as rj
from romjax.linalg import quaternions
from romjax.system.dynamics import jacobian

r = rj.spatial
BASE, TRAIL, TILT, GRAVITY = 1.02, 0.08, np.pi / 10, 9.81
SPEED, KNOCK = 5.0, 1e-3  # [m/s], and the rate of lean at the start [rad/s]
# M q̈ + v C₁ q̇ + (g K₀ + v² K₂) q = 0 of lean and steer, equations (A 25) on.
MASS = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
DAMPING = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
STIFFNESS = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
QUADRATIC = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])
# Required of lean and steer, as a share of the largest: what is left out is of second order.
LINEAR = 1e-6
EXACT = 1e-8  # required of accelerations that are those of other equations


def body(name, mass, place, inertia, radius=None) -> rj.AbstractBody:
    """Upright, and falling over about the line on the ground."""
    x, z = place
    return r.RigidBody(
        name,
        mass,
        inertia,
        position=(x, 0.0, z),
        velocity=(SPEED, -KNOCK * z, 0.0),
        angular_velocity=(KNOCK, 0.0 if radius is None else SPEED / radius, 0.0),
    )


def tensor(xx, yy, zz, xz=0.0) -> np.ndarray:
    return np.array([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])


def bicycle() -> rj.Scene:
    rear = body("rear", 2.0, (0.0, 0.3), tensor(0.0603, 0.12, 0.0603), 0.3)
    frame = body("frame", 85.0, (0.3, 0.9), tensor(9.2, 11.0, 2.8, 2.4))
    fork = body("fork", 4.0, (0.9, 0.7), tensor(0.05892, 0.06, 0.00708, -0.00756))
    front = body("front", 3.0, (BASE, 0.35), tensor(0.1405, 0.28, 0.1405), 0.35)
    axle, steer = (0.0, 1.0, 0.0), (-np.sin(TILT), 0.0, np.cos(TILT))

    def hinge(a, b, place, axis):
        ends = [x.at(np.array(place) - np.asarray(x.position), axis=axis) for x in (a, b)]
        return r.Revolute(*ends)

    middle, road = (0.0, 0.0, 0.0), rj.ground.at((0.0, 0.0, 0.0))
    joints = [
        hinge(rear, frame, (0.0, 0.0, 0.3), axle),
        hinge(front, fork, (BASE, 0.0, 0.35), axle),
        hinge(fork, frame, (BASE + TRAIL, 0.0, 0.0), steer),
        r.RollingDisc(rear.at(middle, axis=axle), road, 0.3),
        r.RollingDisc(front.at(middle, axis=axle), road, 0.35),
    ]
    return rj.Scene([rear, frame, fork, front], joints, [rj.Gravity((0.0, 0.0, -GRAVITY))])


@pytest.mark.slow
def test_bicycle_moves_as_published():
    """It is stable by itself at this speed."""
    times = np.linspace(0.0, 1.0, 21)
    system = rj.assemble(bicycle())
    moved = rj.simulate(system, times, rtol=1e-11, solver=rj.Rodas5P())
    frame, fork = (
        np.asarray(rj.measure(system, moved, x.at((0.0, 0.0, 0.0))).rotation)
        for x in bicycle().bodies[1:3]
    )
    lean = np.arcsin(frame[:, 2, 1])
    turned = np.swapaxes(frame, 1, 2) @ fork
    sine = np.stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 1, 0] - turned[:, 0, 1]], axis=1)
    # About the steering axis, which points down there.
    steer = -(sine @ np.array([-np.sin(TILT), np.cos(TILT)])) / 2
    stiffness = GRAVITY * STIFFNESS + SPEED**2 * QUADRATIC
    slopes = -np.linalg.solve(MASS, np.hstack([stiffness, SPEED * DAMPING]))
    matrix = np.vstack([np.hstack([np.zeros((2, 2)), np.eye(2)]), slopes])
    start = np.array([0.0, 0.0, KNOCK, 0.0])
    wanted = np.stack([scipy.linalg.expm(matrix * t) @ start for t in times])
    # Published digits: weave, capsize and castering.
    known = [-14.07838969279822, -0.77534188219585, -0.77534188219585, -0.32286642900409]
    assert np.allclose(np.sort(np.linalg.eigvals(matrix).real), known, atol=1e-6)
    for found, exact in ((lean, wanted[:, 0]), (steer, wanted[:, 1])):
        assert np.max(np.abs(found - exact)) <= LINEAR * np.max(np.abs(exact))
    assert moved.is_valid, moved.warnings()


def placed(q, lean, steer) -> np.ndarray:
    """Coordinates with the fork and its wheel turned about the steering axis, and all leaning."""
    q, axis = np.array(q), np.array([-np.sin(TILT), 0.0, np.cos(TILT)])
    foot = np.array([BASE + TRAIL, 0.0, 0.0])
    for i in range(4):
        own, turn = q[7 * i : 7 * i + 7], _quaternion([1.0, 0.0, 0.0], lean)
        if i >= 2:
            steered = _quaternion(axis, steer)
            own[:3] = foot + quaternions.rotate(steered, own[:3] - foot)
            own[3:] = quaternions.product(steered, own[3:])
        own[:3], own[3:] = quaternions.rotate(turn, own[:3]), quaternions.product(turn, own[3:])
    return q


def _quaternion(axis, angle) -> np.ndarray:
    return np.append(np.cos(angle / 2), np.sin(angle / 2) * np.asarray(axis))


@functools.cache
def moving():
    """Of lean, steer and their rates, at a speed: the coordinates, the velocities and accelerations
    that the joints allow, the matrices of angular velocities, and the steering axis.
    """
    system = rj.assemble(bicycle())
    rows_of = jax.jit(lambda q: jacobian(system, 0.0, q))
    accelerations = jax.jit(lambda q, v: system.acceleration(0.0, q, v)[0])

    def state(x, speed):
        q, lean = placed(system.q0, *x[:2]), _quaternion([1.0, 0.0, 0.0], x[0])
        steer = quaternions.rotate(lean, np.array([-np.sin(TILT), 0.0, np.cos(TILT)]))
        axle = quaternions.rotate(lean, np.array([0.0, 1.0, 0.0]))
        spins, lengths = np.zeros((4, 3, 28)), np.zeros((4, 28))
        for i in range(4):
            turn = slice(7 * i + 3, 7 * i + 7)
            spins[i, :, turn], lengths[i, turn] = 2 * quaternions.space_matrix(q[turn]), q[turn]
        # Of all velocities that the rows allow, the one of these rates and this spin of the wheel.
        own = [spins[1, 0], steer @ (spins[2] - spins[1]), axle @ (spins[0] - spins[1])]
        rows = np.vstack([rows_of(q), lengths, own])
        wanted = [*np.zeros(system.m + 4), *x[2:], speed / 0.3]
        v = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        return q, v, np.asarray(accelerations(q, v)), spins, steer

    return state


def linear():
    """The matrix of lean, steer and their rates at a speed, by differences of accelerations."""
    state = moving()

    def rates(x, speed):
        *_, a, spins, steer = state(x, speed)
        # Of unit quaternions p that keep their length, p·p' = 0, ω' = 2 E p''.
        turning = spins @ a
        return np.array([turning[1, 0], steer @ (turning[2] - turning[1])])

    def matrix(speed, step=1e-4):
        steps = step * np.eye(4)
        slopes = [(rates(x, speed) - rates(-x, speed)) / (2 * step) for x in steps]
        return np.vstack([np.eye(2, 4, 2), np.transpose(slopes)])

    return matrix


@pytest.mark.slow
def test_bicycle_is_stable_by_itself_between_published_speeds():
    """From where weave dies out to where capsize begins, section 6 of the paper."""
    matrix = linear()

    def growth(speed, weaving):
        roots = np.linalg.eigvals(matrix(speed))
        return np.max(roots.real[(np.abs(roots.imag) > 1e-6) == weaving])

    for weaving, known in ((True, 4.29238253634111), (False, 6.02426201538837)):
        ends = known - 0.3, known + 0.3
        found = scipy.optimize.brentq(lambda v, w=weaving: growth(v, w), *ends, xtol=1e-10)
        assert abs(found - known) <= 1e-6


def newton_and_euler(q, v, spins) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations and angular accelerations (4, 3) of the bodies, with a multiplier for each of
    the 15 conditions of three hinges and the 6 of two points on the road that stand still.
    """
    bodies = bicycle().bodies
    turns = [quaternions.matrix(q[7 * i + 3 : 7 * i + 7]) for i in range(4)]
    speed, spin = v.reshape(4, 7)[:, :3], spins @ v
    mass, force, rows, known = np.zeros((24, 24)), np.zeros(24), [], []
    for i, body in enumerate(bodies):
        inertia = turns[i] @ np.asarray(body.inertia) @ turns[i].T
        own = slice(6 * i, 6 * i + 3), slice(6 * i + 3, 6 * i + 6)
        mass[own[0], own[0]], mass[own[1], own[1]] = float(body.mass) * np.eye(3), inertia
        force[own[0]] = [0.0, 0.0, -float(body.mass) * GRAVITY]
        force[own[1]] = -np.cross(spin[i], inertia @ spin[i])

    def point(i, arm):
        """Rows of the velocity of a point of a body."""
        found = np.zeros((3, 24))
        found[:, 6 * i : 6 * i + 3] = np.eye(3)
        found[:, 6 * i + 3 : 6 * i + 6] = np.cross(np.eye(3), arm).T
        return found

    axle, steer = np.array([0.0, 1.0, 0.0]), np.array([-np.sin(TILT), 0.0, np.cos(TILT)])
    places = (0.0, 0.0, 0.3), (BASE, 0.0, 0.35), (BASE + TRAIL, 0.0, 0.0)
    for i, j, place, axis in zip((0, 3, 2), (1, 2, 1), places, (axle, axle, steer), strict=True):
        arms = [turns[k] @ (np.array(place) - np.asarray(bodies[k].position)) for k in (i, j)]
        rows += [point(i, arms[0]) - point(j, arms[1])]
        known += [
            np.cross(spin[j], np.cross(spin[j], arms[1]))
            - np.cross(spin[i], np.cross(spin[i], arms[0]))
        ]
        across = (turns[i] @ np.linalg.svd(axis[None])[2][1:].T).T
        both = np.zeros((2, 24))
        both[:, 6 * i + 3 : 6 * i + 6], both[:, 6 * j + 3 : 6 * j + 6] = across, -across
        rows += [both]
        known += [-np.cross(spin[i], across) @ (spin[i] - spin[j])]
    up = np.array([0.0, 0.0, 1.0])
    for i, radius in ((0, 0.3), (3, 0.35)):
        normal = turns[i] @ axle
        rate = np.cross(spin[i], normal)
        high, change = up - normal[2] * normal, -rate[2] * normal - normal[2] * rate
        size = np.linalg.norm(high)
        arm = -radius * high / size
        swing = -radius * (change - high * (high @ change) / size**2) / size
        rows += [point(i, arm)]
        known += [-np.cross(spin[i], swing)]
    rows, known = np.vstack(rows), np.concatenate(known)
    assert np.max(np.abs(rows @ np.hstack([speed, spin]).ravel())) < 1e-12 * np.max(np.abs(v))
    whole = np.block([[mass, rows.T], [rows, np.zeros((21, 21))]])
    found = np.linalg.solve(whole, np.concatenate([force, known]))[:24].reshape(4, 6)
    return found[:, :3], found[:, 3:]


@pytest.mark.slow
def test_bicycle_that_leans_far_obeys_newton_and_euler():
    """Written down a second time, with a row for each condition."""
    for x in ([0.0, 0.0, 0.1, 0.2], [0.3, -0.4, 0.5, 1.0], [-0.6, 0.7, -1.0, 0.3]):
        q, v, a, spins, _ = moving()(np.array(x), SPEED)
        known, turning = newton_and_euler(q, v, spins)
        size = max(np.max(np.abs(known)), np.max(np.abs(turning)))
        assert np.max(np.abs(a.reshape(4, 7)[:, :3] - known)) <= EXACT * size
        assert np.max(np.abs(spins @ a - turning)) <= EXACT * size
