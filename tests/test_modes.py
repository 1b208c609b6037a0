"""Natural frequencies and modes against closed forms and independent eigenproblems."""

import re
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import zoo
from at_rest import both_slopes, hung_twice
from comparison import assert_close
from tolerances import SOLVED
from verification_problems import small
from verification_problems.small import ARM, CLAMPED, INERTIA, MASS
from verification_problems.whirl import disk
from zoo import GRAVITY

import romjax as rj
from romjax.scene.body.modes import bending_roots, bending_shapes

# Required: relative to the largest frequency.
EXACT = 1e-9


def pendulum(*numbers, **named) -> rj.AbstractSystem:
    return rj.assemble(small.pendulum(*numbers, **named))


def test_a_damped_pendulum():
    """J φ̈ + d φ̇ + (k + m g l) φ = 0."""
    found = rj.modes(pendulum())
    inertia = INERTIA + MASS * ARM**2
    stiffness = 2.0 + MASS * GRAVITY * ARM
    frequency = np.sqrt(stiffness / inertia)
    assert found.values.shape == (2,)
    assert_close(found.frequencies, [frequency], EXACT)
    assert_close(found.damping, [0.3 / (2 * frequency * inertia)], EXACT)
    assert found.is_stable


def test_an_overdamped_pendulum():
    found = rj.modes(pendulum(damping=20.0))
    inertia, stiffness = INERTIA + MASS * ARM**2, 2.0 + MASS * GRAVITY * ARM
    frequency = np.sqrt(stiffness / inertia)
    assert_close(found.values, np.sort(np.roots([inertia, 20.0, stiffness]))[::-1], EXACT, 50.0)
    assert_close(found.frequencies, [frequency], EXACT)
    assert_close(found.damping, [20.0 / (2 * frequency * inertia)], EXACT)


def test_frequencies_ascend_past_an_overdamped_mode():
    """One of 10 rad/s, which begins with the smallest eigenvalue, beside one of 5 rad/s."""
    force = zoo.Stiffness(jnp.array([100.0, 25.0]), jnp.array([60.0, 1.0]))
    found = rj.modes(rj.CustomSystem(zoo.unit_mass, force, q0=jnp.ones(2), v0=jnp.zeros(2)))
    assert_close(found.frequencies, [5.0, 10.0], EXACT)
    assert_close(found.damping, [0.1, 3.0], EXACT)
    assert_close(jnp.abs(found.shapes), [[0.0, 1.0], [1.0, 0.0]], EXACT)


def test_upright_is_unstable():
    found = rj.modes(pendulum(stiffness=0.0, damping=0.0, angle=np.pi / 2))
    growth = np.sqrt(MASS * GRAVITY * ARM / (INERTIA + MASS * ARM**2))
    assert_close(found.values, [growth, -growth], EXACT)
    assert not found.is_stable


def test_a_hanging_chain():
    """By Lagrange's equations in absolute angles: no coordinate in common with the chain's. With
    a hinge that is made twice.
    """
    found = rj.modes(hung_twice((1.3, 0.7), (-np.pi / 2, -np.pi / 2)))
    wanted = small.two_bars_again(1.3, 0.7)
    assert found.frequencies.shape == (2,)
    assert_close(found.frequencies, wanted, EXACT, scale=wanted[-1])
    assert_close(found.damping, np.zeros(2), EXACT)


def welded(modes, shapes="free-free") -> rj.AbstractSystem:
    """A clamped beam of 1 m, 1 kg and EI = 1 N m², made of two welded ones."""

    def beam(i):
        place = (0.5 * i + 0.25, 0.0)
        return rj.Beam(f"beam{i}", 0.5, 0.5, EI=1.0, modes=modes, shapes=shapes, position=place)

    first, second = beam(0), beam(1)
    welds = [
        rj.Weld(first.at((-0.25, 0.0)), rj.ground.at()),
        rj.Weld(second.at((-0.25, 0.0)), first.at((0.25, 0.0))),
    ]
    return rj.assemble(rj.Scene([first, second], welds))


@pytest.mark.slow
def test_a_clamped_beam_of_welded_ones():
    """The eigenproblem in coordinates that the welds leave free, by matrices written down here."""
    modes, half = 4, 0.25
    # Of a straight beam: displacements and the angle of an end, by x, y, φ and the modes.
    ends = []
    for x in (-half, half):
        values, slopes = bending_shapes("free-free", modes, x / 0.5 + 0.5, np)[:2]
        rigid = np.array([[1, 0, 0], [0, 1, x], [0, 0, 1.0]])
        shapes = np.stack([0 * values, values, slopes / 0.5]) / np.sqrt(0.5)
        ends.append(np.concatenate([rigid, shapes], axis=1))
    none = np.zeros_like(ends[0])
    welds = np.block([[ends[0], none], [-ends[1], ends[0]]])
    inertia = 0.5 * 0.5**2 / 12
    mass = np.diag(np.tile([0.5, 0.5, inertia, *np.ones(modes)], 2))
    squares = bending_roots("free-free", modes) ** 4 / 0.5**4
    stiffness = np.diag(np.tile([0, 0, 0, *squares], 2))
    free = scipy.linalg.null_space(welds)
    wanted = scipy.linalg.eigvalsh(free.T @ stiffness @ free, free.T @ mass @ free)
    found = np.asarray(rj.modes(welded(modes)).frequencies)
    assert_close(found, np.sqrt(wanted), EXACT, scale=np.sqrt(wanted[-1]))


@pytest.mark.slow
def test_welded_beams_become_one():
    """Natural modes do not meet the loads of a weld: errors fall like one over their number. Static
    ones do.
    """

    def error(modes, shapes):
        found = np.asarray(rj.modes(welded(modes, shapes)).frequencies[:2])
        assert np.all(found > CLAMPED[:2] ** 2)
        return np.max(found / CLAMPED[:2] ** 2 - 1)

    few, many = (error(modes, "free-free") for modes in (4, 16))
    assert many < 0.6**2 * few
    assert error(4, "static") < 1e-3 * many


SPEED, SPRING = 2.0, 25.0


def seen_turning(t, q, v):
    return 2 * SPEED * jnp.stack([v[1], -v[0]]) + (SPEED**2 - SPRING) * q


def test_a_rotating_frame():
    """Gyroscopic pairs i (ω ± Ω), by coordinates of the rotating frame."""
    system = rj.CustomSystem(zoo.unit_mass, seen_turning, q0=[0.0, 0.0], v0=[0.0, 0.0])
    found = rj.modes(system)
    assert_close(found.frequencies, [3.0, 7.0], EXACT)
    assert_close(found.damping, [0.0, 0.0], EXACT)


def test_a_mechanism_that_turns():
    """The same as bodies in the inertial frame, seen from a frame that turns with them."""
    system = rj.assemble(disk(SPRING))
    found = rj.modes(system, turning=SPEED)
    assert_close(found.frequencies[1:], [3.0, 7.0], EXACT)
    with pytest.raises(rj.InputError, match="turning implies the velocity"):
        rj.modes(system, v=np.zeros(3), turning=SPEED)
    with pytest.raises(rj.InputError, match="turning needs a system of bodies"):
        rj.modes(zoo.oscillator(), turning=SPEED)


def test_a_bar_on_an_arm_that_is_driven():
    """Outwards it swings in the plane by 3 a Ω² / (2 l), at any angle of the arm."""
    system = rj.assemble(driven_arm(SPEED, 0.7))
    found = rj.modes(system, v=system.v0)
    assert_close(found.frequencies, [np.sqrt(1.5) * SPEED], EXACT)


def test_states_that_the_drive_contradicts():
    """It moves at v = 0, which is no rest, and is elsewhere at another time; but a frame that turns
    takes the ground with it.
    """
    system = rj.assemble(driven_arm(SPEED, 0.7))
    for verb in (rj.modes, linear_model):
        with pytest.raises(rj.InputError, match=r"PrescribedAngle.* is violated at the rate -2 /s"):
            verb(system, v=np.zeros(6))
        with pytest.raises(
            rj.InputError, match=r"PrescribedAngle.* is violated by -1 in the state"
        ):
            verb(system, t=0.5)
    found = rj.modes(system, turning=SPEED)
    assert_close(found.frequencies, [np.sqrt(1.5) * SPEED], EXACT)
    with pytest.raises(
        rj.InputError, match=r"PrescribedAngle.* moves by 2 /s and turning makes it move by 3, so"
    ):
        rj.modes(system, turning=SPEED + 1)


def linear_model(system, **at):
    return rj.linearize(system, {}, ["bar2.phi"], **at)


def driven_arm(speed: float, angle: float) -> rj.Scene:
    scene = zoo.bars(angles=(angle, angle), spins=(speed, speed), gravity=0.0)
    drive = rj.PrescribedAngle(scene.bodies[0].at(), rj.ground.at(), rj.Ramp(speed))
    return rj.Scene(scene.bodies, [*scene.joints, drive])


def test_a_batch_over_velocities_at_one_configuration():
    """What joints say of the configuration is known there, and not what they say of velocities."""
    whole = zoo.system(zoo.bars, spins=(1.0, 3.0))
    speeds = np.outer([1.0, 2.0], whole.v0)
    lanes = jax.vmap(lambda v: rj.modes(whole, v=v).frequencies)(speeds)
    single = [rj.modes(whole, v=v).frequencies for v in speeds]
    assert_close(lanes, np.stack(single), SOLVED, scale=np.max(single))


def test_joints_that_repeat_others_in_a_batch():
    """How many do is known of a mechanism whose numbers are, and at which others are refused."""
    scene = zoo.bars((1.0,) * 3, 1.0, (-np.pi / 2,) * 3, (0.0,) * 3)
    whole = rj.assemble(rj.Scene(scene.bodies, [*scene.joints, scene.joints[0]], scene.effects))
    single = rj.modes(whole).frequencies
    lanes = jax.vmap(lambda q: rj.modes(whole, q).frequencies)(np.stack([whole.q0, whole.q0]))
    assert_close(lanes, np.stack([single, single]), SOLVED, scale=np.max(single))
    with pytest.raises(RuntimeError, match="modes: constraints repeat each other"):
        jax.block_until_ready(jax.jit(lambda whole: rj.modes(whole).frequencies)(whole))


@jax.jit
@jax.vmap
def frequency_and_slopes(stiffness):
    def frequency(stiffness):
        return rj.modes(pendulum(stiffness, damping=0.0)).frequencies[0]

    return both_slopes(frequency, stiffness)


@pytest.mark.slow
def test_the_slope_of_a_frequency():
    """d√((k + m g l) / J) / dk, forwards and backwards, in a batch."""
    given = np.array([2.0, 3.0])
    frequency, forward, backward = frequency_and_slopes(given)
    inertia, stiffness = INERTIA + MASS * ARM**2, given + MASS * GRAVITY * ARM
    slope = 0.5 / np.sqrt(stiffness * inertia)
    assert_close(frequency, np.sqrt(stiffness / inertia), EXACT)
    assert_close(forward, slope, EXACT)
    assert_close(backward, slope, EXACT)


@pytest.mark.slow
def test_modes_of_a_reduced_model():
    """With as many as degrees of freedom it hangs as the full model does, and swings about that."""
    hanging = np.array([0.0, -0.5, -np.pi / 2, 0.0, -1.5, -np.pi / 2])
    system, motion = zoo.system(zoo.bars), zoo.motion(zoo.bars)
    rom = rj.reduce(system, rj.pod(motion, rank=2), "minimal")
    at = rj.equilibrium(rom, rom.starting_at(motion.q[80], motion.v[80]).q0)
    found, _ = jax.jit(rom.reconstruct)(0.0, at, np.zeros(2))
    assert_close(found, hanging, EXACT)
    full, reduced = rj.modes(system, hanging), rj.modes(rom, at)
    assert_close(reduced.frequencies, full.frequencies, SOLVED, scale=full.frequencies[-1])


@pytest.mark.instant
def test_a_shape_that_does_not_fit():
    with pytest.raises(rj.InputError, match=r"at.*\(2,\)"):
        rj.modes(pendulum(), at=[0.0, 0.0])


def test_modes_of_what_is_not_in_balance_warn():
    """Of a pendulum that hangs askew, unless by little, or where this very state is asked for."""
    near, far = (pendulum(0.0, 0.0, angle - np.pi / 2) for angle in (0.2, 0.5))
    with pytest.warns(UserWarning, match=r"modes: the state is not in balance.* by 1.3 %.*filter"):
        found = rj.modes(far)
    largest = np.sqrt(MASS * GRAVITY * ARM / (INERTIA + MASS * ARM**2))
    assert_close(found.frequencies, [largest * np.sqrt(np.cos(0.5))], EXACT)
    # Silent, by the filters of the tests.
    assert_close(rj.modes(near).frequencies, [largest * np.sqrt(np.cos(0.2))], EXACT)
    assert_close(rj.modes(far, v=jnp.zeros(far.n)).frequencies, found.frequencies, EXACT)


def test_to_silence_that_changes_no_mode():
    """Of a bar that hangs askew, by 0.5 rad, on one that a drive swings."""
    scene = zoo.bars(angles=(0.0, 0.5 - np.pi / 2), spins=(0.8 * np.pi, 0.0))
    drive = rj.PrescribedAngle(scene.bodies[0].at(), rj.ground.at(), rj.Sine(0.8, 0.5))
    system = rj.assemble(rj.Scene(scene.bodies, [*scene.joints, drive], scene.effects))
    askew = np.sqrt(1.5 * zoo.GRAVITY * np.cos(0.5))
    for model in (system, rj.reduce(system, formulation="joint")):
        with pytest.warns(UserWarning, match="modes: the state is not in balance") as told:
            found = rj.modes(model)
        assert_close(found.frequencies, [askew], SOLVED)
        given = re.search(r"warnings\.filterwarnings\('(\w+)', '(.*)'\)", str(told[0].message))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings(*given.groups())
            assert_close(rj.modes(model).frequencies, found.frequencies, EXACT)
