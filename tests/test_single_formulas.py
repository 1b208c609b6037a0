"""Formulas that no motion of other tests tells from a wrong one, each against a closed form."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY
from zoo import unit_mass

import romjax as rj
from romjax import spatial as r
from romjax.analysis.statics import Statics
from romjax.integrate.rodas5p import RodasInterpolation
from romjax.integrate.rodas5p_tableau import DENSE, GAMMA, A, C
from romjax.linalg import quaternions
from romjax.march.record import Record
from romjax.march.transpose import Transposed, TransposedSteps
from romjax.reduction.lift.base import differentiate
from romjax.reduction.tables.expansion import tabulate
from romjax.reduction.tables.frames import Frames
from romjax.reduction.tables.grid import Grid
from romjax.reduction.tables.interpolation import SIDE
from romjax.scene.marker import Pose
from romjax.system import unit_length


@jax.jit
def slide(b, along, value, off):
    """What a slide that keeps an angle says where marker `a` is turned by that and `off` more."""
    angle = b.angle + value + off
    position = b.position + along * jnp.stack([jnp.cos(b.angle), jnp.sin(b.angle)])
    body = rj.RigidBody("body", 1.0, 1.0)
    joint = rj.Prismatic(body.at(), rj.ground.at(), value)
    return joint.residual(0.0, Pose(position, angle), b)


def test_a_slide_keeps_its_angle():
    b = Pose(np.array([0.3, -0.4]), np.asarray(0.5))
    for value, off in ((0.0, 0.0), (0.7, 0.0), (-0.3, 0.2)):
        assert_close(slide(b, 1.3, value, off), [0.0, off], IDENTITY)


@jax.jit
def torque(stiffness, turn, relative):
    """Of a bushing on its marker `a`, turned by `relative` in the frame of `b`; axes of space."""
    body = r.RigidBody("body", 1.0, (1.0, 1.0, 1.0))
    bushing = r.Bushing(body.at((0, 0, 0)), rj.ground.at((0, 0, 0)), stiffness=stiffness)
    a = Pose(jnp.zeros(3), quaternions.product(turn, relative))
    return bushing.wrenches(0.0, (a, Pose(jnp.zeros(3), turn)), ())[0].torque


@pytest.mark.parametrize("axis", range(3))
def test_a_bushing_turns_about_its_own_axes(axis):
    """About one of them alone the torque is that of one spring, however the bushing lies."""
    turn = np.array([0.7, 0.3, -0.5, 0.4])
    turn /= np.linalg.norm(turn)
    angle, unit = 0.6, np.eye(3)[axis]
    relative = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * unit])
    stiffness = np.array([1.0, 1.0, 1.0, 2.0, 3.0, 5.0])
    wanted = -stiffness[3 + axis] * angle * quaternions.matrix(turn)[:, axis]
    assert_close(torque(stiffness, turn, relative), wanted, IDENTITY)


@pytest.mark.instant
def test_angles_of_known_rotations_at_a_half_turn_and_less_than_an_unknown_one():
    """By NumPy, which warns of no division by zero, and by JAX where it traces what is less."""
    still, half = np.eye(4)[0], np.eye(4)[3]
    assert quaternions.angle(half, still) == np.pi
    assert_close(quaternions.angle(half, still, np.asarray(0.5)), np.pi - 0.5, IDENTITY)
    less = jax.ShapeDtypeStruct((), float)
    assert jax.eval_shape(lambda x: quaternions.angle(half, still, x), less).shape == ()


def shifting_mass(q):
    return jnp.array([[2.0, 0.0], [0.0, 1.0]]) + jnp.outer(jnp.cos(q), jnp.cos(q))


def push(t, q, v):
    return jnp.array([1.0, -0.5]) * q + 0.3 * v + t


@eqx.filter_jit
def power_and_rate(system, t, q, v):
    """The power of all forces, and the rate of ½ vᵀ M v along the motion."""
    a = jnp.linalg.solve(system.mass(q), system.force(t, q, v))
    energy = lambda q, v: 0.5 * v @ system.mass(q) @ v  # noqa: E731
    return system.state(t, q, v).power().total, jax.jvp(energy, (q, v), (v, a))[1]


def test_the_power_of_a_system_whose_mass_changes():
    """Of one that tells no energy, all work goes into its motion."""
    system = rj.CustomSystem(shifting_mass, push, q0=[0.3, 0.8], v0=[1.0, -2.0])
    power, rate = power_and_rate(system, 0.2, system.q0, system.v0)
    assert_close(power, rate, IDENTITY)


@jax.jit
def lifted(t, z, w):
    """The motion of q = (sin(t) z², t³ z)."""
    return differentiate(lambda t, z: jnp.append(jnp.sin(t) * z**2, t**3 * z), t, z, w)


def test_a_lift_that_changes_with_time():
    """Its bias is the acceleration where ẇ is zero: (G w)_z w + 2 G_t w + L_tt."""
    t, z, w = 0.7, 1.3, -0.4
    s, c = np.sin(t), np.cos(t)
    motion = lifted(t, jnp.array([z]), jnp.array([w]))
    assert_close(motion.v, [c * z**2 + 2 * s * z * w, 3 * t**2 * z + t**3 * w], IDENTITY)
    bias = [2 * s * w**2 + 4 * c * z * w - s * z**2, 6 * t**2 * w + 6 * t * z]
    assert_close(motion.bias, bias, IDENTITY)


@eqx.filter_jit
def mass_of(system, q):
    return system.mass(q)


def test_bodies_are_projected_in_their_modal_mass():
    """What a mode misses of a deflection is orthogonal to it in the mass matrix of the body, also
    where that is not the unit matrix, as by a reduction on modes of a mesh.
    """
    mass = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.3], [0.0, 0.3, 1.5]])
    skew = np.array([[0.0, 0.2, 0.1], [-0.2, 0.0, 0.3], [-0.1, -0.3, 0.0]])
    inertia = rj.Inertia(2.0, 0.8, modal=mass, gyration=skew)
    shapes = np.random.default_rng(3).normal(size=(1, 3, 3))
    body = rj.ModalBody("body", inertia, [30.0, 80.0, 200.0], [(0.5, 0.0)], shapes)
    system = rj.assemble(rj.Scene([body], [], [rj.Gravity()]))
    metric = np.asarray(mass_of(system, system.q0))
    modes = np.linalg.qr(np.random.default_rng(4).normal(size=(6, 1)))[0]
    rom = rj.reduce(system, rj.Basis.from_modes(modes, system.q0, metric), rj.Local())
    q = np.array([0.1, 0.2, 0.3, 0.7, -0.4, 0.5])
    z, _ = (np.asarray(x) for x in rom.restrict(jnp.asarray(q), jnp.asarray(q)))
    (mode,) = (np.asarray(x) for x in rom.bases.by_body())
    assert_close(mode.T @ metric[3:, 3:] @ mode, np.eye(1), IDENTITY)
    missed = q[3:] - mode @ z[3:]
    assert_close(mode.T @ metric[3:, 3:] @ missed, np.zeros(1), IDENTITY)


@eqx.filter_jit
def lengths_and_slopes(system, q):
    """The rows that take lengths of quaternions out, and their derivatives, by autodiff and not."""
    slopes = jax.jacfwd(lambda q: unit_length.extended(system, 0.0, q))(q)
    at_rest = Statics(system, jnp.zeros(()), q).constraint(q)
    return (
        unit_length.extended(system, 0.0, q),
        slopes,
        unit_length.jacobian(system, 0.0, q),
        at_rest,
    )


def test_constraints_of_unit_length():
    """½ (|p|² − 1) of each body, and its derivative; in statics that of the start instead of 1."""
    system = zoo.system(zoo.ball_bars)
    q = np.asarray(system.q0) + 0.1 * np.cos(np.arange(system.n))
    rows, slopes, written, at_rest = lengths_and_slopes(system, q)
    wanted = 0.5 * (np.sum(q.reshape(2, 7)[:, 3:] ** 2, axis=1) - 1)
    assert_close(rows[system.m :], wanted, IDENTITY)
    assert_close(at_rest, np.concatenate([rows[: system.m], 0 * wanted]), IDENTITY)
    assert_close(written, slopes, IDENTITY, np.max(np.abs(slopes)))


def no_force(t, q, v):
    return 0 * q


def bent(t, q):
    return (q[0] + q[2] ** 2 + 3 * q[2] * q[3])[None]


def test_deflections_of_a_table_by_second_derivatives():
    """Where C = y + a² + 3 a b is zero, those of y by the amplitudes a and b are −2, −3 and 0."""
    system = rj.CustomSystem(unit_mass, no_force, bent, q0=np.zeros(4), v0=np.zeros(4))
    frames = Frames(1, (0, 1), (0,), np.eye(4), np.zeros(()))
    count = 2 * SIDE + 2
    grid = Grid(np.zeros((count, 4)), np.tile(np.eye(4)[:, 1:2], (count, 1, 1)), np.ones(1), None)
    values = np.asarray(tabulate(system, frames, grid, np.eye(4)[:, 2:]))[0, -1].reshape(6, 4)
    # Constant along the table: q, its derivatives by both amplitudes, and the second ones.
    assert_close(values[:3], np.eye(4)[[1, 2, 3]] * np.array([[0.0], [1.0], [1.0]]), IDENTITY)
    assert_close(values[3:], np.outer([-2.0, -3.0, 0.0], np.eye(4)[0]), IDENTITY)


def test_a_step_of_rodas5p_by_its_coefficients():
    """The stages of y' = J y, one after the other: the end, the error, and the dense output."""
    jacobian, start, h = np.array([[-3.0, 1.0], [0.5, -20.0]]), np.array([1.0, -0.4]), 0.1
    matrix, k = np.eye(2) / (h * GAMMA) - jacobian, np.zeros((8, 2))
    for i in range(8):
        y = start + A[i] @ k
        k[i] = np.linalg.solve(matrix, jacobian @ y + C[i] @ k / h)
    term = diffrax.ODETerm(lambda t, y, args: jacobian @ y)

    @jax.jit
    def step():
        end, error, dense, *_ = rj.Rodas5P().step(term, 0.0, h, start, None, None, False)
        return end, error, RodasInterpolation(t0=0.0, t1=h, **dense).evaluate(0.3 * h)

    end, error, between = step()
    assert_close(end, y + k[7], IDENTITY)
    assert_close(error, k[7], IDENTITY)
    h1, h2, h3 = DENSE @ k
    wanted = 0.7 * start + 0.3 * (y + k[7] + 0.7 * (h1 + 0.3 * (h2 + 0.3 * h3)))
    assert_close(between, wanted, IDENTITY)


@jax.jit
def by_event(happens):
    """The number of events before a step, and the derivative by the time of that at its end, where
    results change with the times of two events by 2 and 5, and with the start of what follows by 3.
    """
    none = jnp.zeros((2, 0))
    steps = TransposedSteps(
        None, None, None, Record(None, jnp.array([2.0, 5.0]), *4 * [none]), None
    )
    later = Transposed(None, None, None, None, None, jnp.asarray(3.0), None, jnp.asarray(2))
    number, (time, *_) = steps.at_event(happens, later)
    return number, time


def test_what_follows_an_event_starts_at_its_time():
    assert_close(by_event(np.asarray(True)), (1, 5.0 + 3.0), IDENTITY)
    assert_close(by_event(np.asarray(False)), (2, 0.0), IDENTITY)
