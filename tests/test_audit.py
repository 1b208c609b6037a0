"""The balance of energy of a run: it finds what is wrong, and nothing where all is right."""

import diffrax
import jax
import numpy as np
import pytest
from comparison import assert_close
from groups import in_groups
from parallelogram import parallelogram
from planted_errors import CHANGE_POINT, LENGTH, MASS, PLANTED, STIFFNESS, bead, swing
from tolerances import IDENTITY
from zoo import GRAVITY, point_pendulum, slider_crank, system
from zoo import run as moved

import romjax as rj

TS = np.linspace(0.0, 2.0, 41)


pytestmark = pytest.mark.usefixtures("without_optimisation")


def run(system, **settings):
    """A run whose warnings are looked at by the test."""
    settings = {"solver": diffrax.Dopri8(), "throw": False, "rtol": 1e-7} | settings
    if isinstance(system, rj.Scene):
        system = rj.assemble(system)
    return rj.simulate(system, TS, **settings)


# One of each kind: forces, bodies, joints and energies. A tolerance that is too loose is that of
# `test_a_batch_is_doubted_lane_by_lane`, a change point that of `test_the_words_...`.
SLOW = ("a spring that pulls one end", "a joint with a wrong slope", "a wrong energy")


@pytest.mark.parametrize("name", in_groups(PLANTED, slow=SLOW))
@pytest.mark.filterwarnings("ignore:simulate. the motion is doubtful")
def test_what_is_wrong_is_found(name):
    made, settings = PLANTED[name]
    motion = run(made(), **settings)
    assert not motion.is_valid
    words = motion.warnings()
    # At a change point rounding decides which branch is taken, and only one of them gains energy.
    assert any(word in words for word in ("energy", "CONSTRAINTS_VIOLATED", "singular position"))


@pytest.mark.instant
def test_there_are_twenty():
    assert len(PLANTED) == 20


def springs_and_dampers():
    return swing(
        lambda a, b: rj.Spring(a, b, STIFFNESS, rest_length=0.3),
        lambda a, b: rj.Damper(a, b, 0.4),
        lambda a, b: rj.Bushing(a, b, BUSHING, damping=(1.0, 1.0, 0.1)),
    )


def loads():
    """A load that turns with the bar, a motor, and a floor on which the end rubs."""
    return swing(
        lambda a, b: rj.Force(a, (0.0, 1.0), rj.Sine(20.0, 2.0), frame="body"),
        lambda a, b: rj.Motor(a, b, rj.Sine(1.0, 1.0), 5.0, 0.5),
        lambda a, b: rj.Contact(
            a, rj.ground.at((0.0, -0.5)), rj.Line(), 1e4, 0.3, rj.Friction(0.3, 0.01)
        ),
    )


def prescribed():
    """An angle that is prescribed."""
    return swing(
        joint=lambda bar: rj.PrescribedAngle(bar.at(), rj.ground.at(), rj.Step(2.0, 0.1, 0.8))
    )


BUSHING = (20.0, 30.0, 1.0)
RIGHT = {
    "springs and dampers": springs_and_dampers,
    "loads": loads,
    "a prescribed angle": prescribed,
    "a bead": bead,
}
SHOWN = {"a prescribed angle"}


@pytest.mark.parametrize("name", in_groups(RIGHT, fast=SHOWN, slow=RIGHT.keys() - SHOWN))
def test_what_is_right_is_not_doubted(name):
    for rtol in (1e-4, 1e-8):
        motion = run(RIGHT[name](), rtol=rtol)
        assert motion.is_valid, motion.warnings()
        assert motion.balance.extent > 0.1


def test_the_balance_is_that_of_the_states():
    """What it calls energy and work, from states by hand: a damped pendulum."""
    motion = run(springs_and_dampers(), rtol=1e-10)
    q, v = np.asarray(motion.q), np.asarray(motion.v)
    tip = q[:, :2] + LENGTH / 2 * np.stack([np.cos(q[:, 2]), np.sin(q[:, 2])], axis=1)
    away = tip - np.array([1.0, -0.5])
    stretch = np.linalg.norm(away, axis=1) - 0.3
    kinetic = 0.5 * MASS * np.sum(v[:, :2] ** 2, axis=1) + 0.5 * 0.07 * v[:, 2] ** 2
    energy = kinetic + MASS * GRAVITY * q[:, 1] + 0.5 * STIFFNESS * stretch**2
    energy += 0.5 * (BUSHING[0] * away[:, 0] ** 2 + BUSHING[1] * away[:, 1] ** 2)
    energy += 0.5 * BUSHING[2] * q[:, 2] ** 2
    assert float(motion.balance.energy) == pytest.approx(energy[-1], rel=1e-8)
    assert float(motion.balance.largest) <= 1e-7 * np.ptp(energy)
    history = rj.energy(rj.assemble(springs_and_dampers()), motion)
    assert_close(history.kinetic, kinetic, IDENTITY, scale=np.max(kinetic))
    assert_close(history.total, energy, IDENTITY, scale=np.ptp(energy))
    assert np.max(np.abs(history.balance)) <= float(motion.balance.largest)
    # What the dampers have taken is what is missing.
    assert energy[-1] < energy[0] - 1


@pytest.mark.slow
def test_energies_of_a_reduced_model_are_those_of_the_mechanism():
    """A rod that bends, in a loop with a spring."""
    whole = system(slider_crank, bends=True)
    settings = {"audit": True, "rtol": 1e-8}
    truth = moved(whole, TS[:21], **settings)
    rom = rj.reduce(whole, rj.pod(truth, rank=6), "minimal")
    motion = moved(rom, TS[:21], **settings)
    own, full = rj.energy(rom, motion), rj.energy(whole, truth)
    error = rj.compare(truth, motion).error
    for reduced, other in zip(own[:4], full[:4], strict=True):
        assert_close(reduced, other, 10 * error, scale=np.max(np.abs(full.total)))
    assert np.max(np.abs(own.balance)) <= 1e-6 * np.max(full.kinetic)


def test_a_run_without_a_balance_has_no_energy_history():
    motion = moved(point_pendulum(), TS)
    assert motion.balance is None
    assert motion.is_valid
    with pytest.raises(rj.InputError, match="no balance of energy; simulate it with audit=True"):
        rj.energy(point_pendulum(), motion)


def test_a_batch_is_doubted_lane_by_lane():
    @jax.jit
    @jax.vmap
    def motion(rtol):
        settings = {"solver": diffrax.Tsit5(), "stabilization": rj.Baumgarte.critical(1.0)}
        return run(point_pendulum(), rtol=rtol, atol=rtol, **settings)

    batch = motion(np.array([1e-8, 0.3]))
    assert batch.is_valid.tolist() == [True, False]
    first, *others = batch.each_warning()
    assert first.startswith("lane 1: its energy changes")
    assert all(words.startswith("lane 1: ") for words in others)


def test_the_words_name_time_joints_and_remedy():
    # It passes two change points, at 0.887 s and at 1.497 s.
    words = r"t = (0\.8869|1\.497) s.*near t = 1\.5 s.*Distance.*Projection"
    with pytest.warns(UserWarning, match=words) as seen:
        motion = run(parallelogram(), **CHANGE_POINT)
    assert len(seen) == 1
    assert not motion.is_valid
