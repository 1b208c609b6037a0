"""Loads that move a mechanism out of its reduced model: runs of it tell."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from jaxtyping import Array
from numpy.testing import assert_allclose

import romjax as rj
from romjax.integrate import unmodelled
from romjax.integrate.departure import departure
from romjax.system.training import with_error

UNMODELLED = rj.Flag.UNMODELLED
# The first mass moves in the training; the last but one is held softly, the last by nothing.
OMEGA = np.array([2.0, 20.0, 3.0, 0.0])
TIMES = np.linspace(0.0, 3.0, 31)
# The way of the first mass.
WAY = np.max(1 - np.cos(OMEGA[0] * TIMES))


class Pushed(eqx.Module):
    """Springs, and a force on each coordinate, constant or alternating."""

    springs: zoo.Stiffness
    push: Array
    turning: Array

    def __call__(self, t, q, v):
        return self.springs(t, q, v) + self.push * jnp.cos(self.turning * t)


def masses(push=(0.0, 0.0, 0.0, 0.0), turning=0.0):
    """Masses of 1 kg on springs, each for itself, the first one released from 1 m."""
    springs = zoo.Stiffness(jnp.asarray(OMEGA**2), jnp.zeros(4))
    force = Pushed(springs, jnp.asarray(push), jnp.asarray(turning))
    return rj.CustomSystem(zoo.unit_mass, force, q0=np.eye(4)[0], v0=np.zeros(4))


@pytest.fixture(scope="module")
def of_the_first():
    """The model of a motion in which the first mass moves alone."""
    motion = rj.simulate(masses(), TIMES, rtol=1e-8)
    return rj.reduce(motion.system, rj.pod(motion), rj.Galerkin())


def run(rom):
    return rj.simulate(rom, TIMES, throw=False)


@pytest.mark.parametrize(("pushed", "push", "told"), [(1, 1e-2, False), (2, 1e-2, True)])
def test_forces_across_a_model_are_told_of_where_they_move_much(of_the_first, pushed, push, told):
    """By no more than that is seen: the same force on a stiff spring is not."""
    other = of_the_first.with_full(masses(push * np.eye(4)[pushed]))
    moved = run(other)
    assert_allclose(departure(other, moved), push / OMEGA[pushed] ** 2 / WAY, rtol=1e-3)
    assert moved.flags == (UNMODELLED if told else 0)
    assert ("out of its model" in moved.warnings()) == told


def test_what_nothing_holds_goes_as_far_as_there_is_time(of_the_first):
    push = 1e-3
    other = of_the_first.with_full(masses(push * np.eye(4)[3]))
    assert_allclose(departure(other, run(other)), push * TIMES[-1] ** 2 / 2 / WAY, rtol=1e-3)


def test_what_alternates_moves_a_free_mass_by_its_impulse(of_the_first):
    """And not as far as if it lasted."""
    push, turning = 2e-4, 20.0
    other = of_the_first.with_full(masses(push * np.eye(4)[3], turning))
    moved = run(other)
    way = push * np.max(1 - np.cos(turning * TIMES)) / turning**2
    assert 0.3 * way < departure(other, moved) * WAY < 3 * way
    assert moved.is_valid


def _gap(system, t, q, v):
    """Between a wall and the first mass, on which the last one reaches out."""
    moved = system.state(t, q, v).q
    return moved[0] + 0.5 + 0.3 * moved[3]


def test_impacts_across_a_model_are_told_of(of_the_first):
    """Also of the motion that it was made of, to which they did not belong."""
    wall = rj.Impact(_gap, restitution=0.8)
    moved = rj.simulate(of_the_first, TIMES, events=[wall], throw=False)
    assert moved.flags & UNMODELLED
    # The impulse that turns back both masses together also moves the last one.
    bounce = -1.8 * moved.events.v_before[0, 0] / (1 + 0.3**2)
    way = 0.3 * bounce * (TIMES[-1] - moved.events.time[0])
    size = np.ptp(moved.q[:, 0])
    assert_allclose(departure(of_the_first, moved, (wall,)), way / size, rtol=0.1)
    away = rj.Impact(_gap, level=-9.0)
    assert rj.simulate(of_the_first, TIMES, events=[away], throw=False).is_valid


def test_a_model_at_rest_tells_of_what_it_does_not_move(of_the_first):
    """A motion of no size has no relative error; an equilibrium has no departure."""
    still = of_the_first.starting_at(np.zeros(4), np.zeros(4), 0.0)
    assert not run(still).flags & UNMODELLED
    assert run(still.with_full(masses(1e-2 * np.eye(4)[2]))).flags & UNMODELLED


def test_batches_tell_as_single_runs_do(of_the_first):
    def flags(push):
        return run(of_the_first.with_full(masses(push * jnp.eye(4)[2]))).flags

    told = jax.jit(jax.vmap(flags))(jnp.array([0.0, 1e-4, 1e-2]))
    assert told.tolist() == [0, 0, int(UNMODELLED)]


def test_known_motions_and_whole_models_are_not_looked_at(of_the_first, monkeypatch):
    monkeypatch.setattr(unmodelled, "departure", None)
    assert run(of_the_first).is_valid
    whole = rj.Basis.from_modes(np.eye(4), np.zeros(4))
    assert run(rj.reduce(masses(), whole, rj.Galerkin())).is_valid


def test_a_model_that_promises_less_tells_of_more(of_the_first):
    """Whoever has estimated an error of two percent is not told of one percent."""
    for departs, told in ((0.03, False), (0.05, True)):
        other = of_the_first.with_full(masses(departs * WAY * OMEGA[2] ** 2 * np.eye(4)[2]))
        assert bool(run(with_error(other, 0.02)).flags & UNMODELLED) == told


def loaded_beam(tip=0.1, middle=0.0):
    """A clamped beam, loaded slowly at its tip, and in its middle."""
    beam = rj.Beam("beam", length=1.0, mass=1.0, EI=1.0, modes=6)
    loads = [((0.5, 0.0), tip), ((0.0, 0.0), middle)]
    forces = [rj.Force(beam.at(p), (0, 1), rj.Sine(f, 0.3)) for p, f in loads]
    return rj.Scene([beam], [rj.Weld(beam.at((-0.5, 0.0)), rj.ground.at((-0.5, 0.0)))], forces)


@pytest.mark.slow
def test_modes_that_a_load_elsewhere_asks_for_are_told_of():
    """Not of a load that is only smaller; the estimate is that of the error, by half."""
    motion = zoo.motion(loaded_beam, 2.0)
    formulation = rj.Local()
    basis = formulation.basis(motion.system, motion, rj.POD(3))
    rom = rj.reduce(motion.system, basis, formulation)
    for numbers, told in (({"tip": 0.08}, False), ({"middle": -0.1}, True)):
        truth = zoo.motion(loaded_beam, 2.0, **numbers)
        other = rom.with_full(truth.system)
        moved = rj.simulate(other, truth.t)
        assert bool(moved.flags & UNMODELLED) == told
        if told:
            error = float(rj.compare(truth, moved).error)
            assert 0.5 * error < departure(other, moved) < 2 * error
