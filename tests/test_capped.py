"""Capped modes: statics exact, errors of second order in the cap, energy kept."""

import equinox as eqx
import jax
import numpy as np
import pytest
from comparison import assert_close
from motions import through
from tolerances import IDENTITY, SOLVED
from zoo import RODAS5P, TIGHT, run

import romjax as rj

TS = np.linspace(0.0, 1.0, 101)
# Required: of the error of the coarser run that the difference of two caps is.
EFFECTIVITY = (0.6, 0.9)
# Required: how much more accurate than the finer run the extrapolated one is, 9 to 13 times here.
GAIN = 5.0
# Required of a gradient, against that of the full model.
GRADIENT = 1e-5


def cantilever(**settings):
    """A clamped beam under its weight, and a load at its end."""
    beam = rj.Beam("beam", 0.5, 1.2, EI=3.0, modes=4, shapes="clamped-free", **settings)
    joint = rj.Weld(beam.at((-0.6, 0.0)), rj.ground.at((-0.6, 0.0)))
    load = rj.Force(beam.at((0.6, 0.0)), (0.0, 1.0), rj.Constant(-0.7))
    return rj.Scene([beam], [joint], [rj.Gravity(), load])


@pytest.mark.slow
def test_statics_are_exact():
    """The forces at rest of all modes, capped or not, and the joints are the same everywhere."""
    full, capped = (rj.assemble(scene) for scene in (cantilever(), rj.cap(cantilever(), 3.0)))
    q = np.asarray(full.q0) + 0.1 * np.cos(np.arange(1.0, full.n + 1))

    @eqx.filter_jit
    def at_rest(system):
        return system.force(0.0, q, 0 * q), system.constraint(0.0, q)

    own, wanted = at_rest(capped), at_rest(full)
    for x, y in zip(own, wanted, strict=True):
        assert_close(x, y, IDENTITY, np.max(np.abs(y)))


def test_no_mode_is_above_the_cap():
    scene = cantilever()
    own = np.asarray(scene.bodies[0].natural_frequencies()) / (2 * np.pi)
    cap = 0.5 * float(own[1] + own[2])
    capped = rj.cap(scene, cap)
    system = rj.assemble(capped)
    wanted = np.minimum(own, cap)
    found = np.asarray(capped.bodies[0].natural_frequencies()) / (2 * np.pi)
    assert_close(found, wanted, IDENTITY, wanted)

    @jax.jit
    @jax.vmap
    def bent(q):
        return system.state(0.0, q, q).energy().elastic, system.mass(q)

    # Of unit amplitudes, one after the other.
    amplitudes = np.asarray(system.q0) + np.eye(system.n)[3:]
    energies, masses = map(np.asarray, bent(amplitudes))
    mass = np.diag(masses[0])[3:]
    assert_close(np.sqrt(2 * energies / mass) / (2 * np.pi), wanted, IDENTITY, wanted)
    assert system.structure.labels == rj.assemble(scene).structure.labels


@pytest.mark.slow
def test_modes_above_the_cap_that_vibrate_are_flagged():
    """They are right where they follow their loads only."""
    scene = cantilever()
    system = rj.assemble(rj.cap(rj.Scene(scene.bodies, scene.joints), 8.0))
    slow, fast = np.array(system.v0), np.array(system.v0)
    slow[3], fast[-1] = 0.05, 0.05
    found = run(system, TS[:21], v0=slow, solver=RODAS5P)
    assert found.is_valid, found.warnings()
    found = run(system, TS[:21], v0=slow + fast, solver=RODAS5P)
    assert found.flags == rj.Flag.CAPPED
    words = found.warnings()
    assert "above the cap vibrate" in words


@pytest.mark.slow
def test_energy_is_kept():
    """With a stiffened, damped and turning beam, whose mass matrix is not constant."""
    beam = rj.Beam(
        "beam",
        0.5,
        1.2,
        EI=3.0,
        modes=3,
        shapes="clamped-free",
        damping=0.02,
        stiffening=True,
        angular_velocity=4.0,
        velocity=(0.0, 4.0 * 0.6),
    )
    hinge = rj.Revolute(beam.at((-0.6, 0.0)), rj.ground.at((-0.6, 0.0)))
    system = rj.assemble(rj.cap(rj.Scene([beam], [hinge], [rj.Gravity()]), 10.0))
    run = rj.simulate(system, TS, rtol=TIGHT)
    assert run.is_valid
    assert_close(rj.energy(system, run).balance, 0.0, SOLVED, scale=float(run.balance.extent))


def test_bodies_of_one_kind_are_one_group():
    beams = [
        rj.Beam(f"beam {i}", 0.5, 1.0, EI=3.0 + i, modes=2, position=(float(i), 0.0))
        for i in range(2)
    ]
    joint = rj.Revolute(beams[0].at((0.5, 0.0)), beams[1].at((-0.5, 0.0)))
    scene = rj.cap(rj.Scene(beams, [joint], [rj.Gravity()]), 20.0)
    assert len(rj.assemble(scene).bodies) == 1


def errors(**numbers):
    """Of caps of 40 and 80 Hz, of their extrapolation, and what their difference says."""
    scene = rj.gallery.cart_pendulum(**numbers)
    full = rj.assemble(scene)
    truth = run(full, TS, solver=RODAS5P)
    runs = [run(rj.assemble(rj.cap(scene, cap)), TS, solver=RODAS5P) for cap in (40.0, 80.0)]
    better, difference = rj.extrapolate(full, *runs)
    coarse, fine, extrapolated = (rj.compare(truth, made).error for made in (*runs, better))
    return coarse, fine, extrapolated, difference.error, better


@eqx.filter_jit
def constraint_rate(system):
    """Ċ at the start of a system whose joints do not move."""
    return jax.jvp(lambda q: system.constraint(0.0, q), (system.q0,), (system.v0,))[1]


def test_capped_modes_start_as_their_loads_ask_for():
    """Along the joints, and the less the nearer to the cap a mode is."""
    scene, rates = rj.gallery.cart_pendulum(), []
    plain = rj.assemble(scene)
    frequency = float(scene.bodies[-1].natural_frequencies()[-1]) / (2 * np.pi)
    for share in (0.04, 0.5, 0.999):
        system = rj.assemble(rj.cap(scene, share * frequency))
        assert_close(system.q0, plain.q0, IDENTITY)
        assert_close(constraint_rate(system), 0.0, IDENTITY)
        rates.append(np.max(np.abs(np.subtract(system.v0, plain.v0))))
    assert rates[0] > rates[1] > 100 * rates[2] > 0


@pytest.mark.slow
def test_two_caps():
    """Errors fall with the square of the cap; their difference is three quarters of the larger."""
    rng = np.random.default_rng(2)
    for _ in range(2):
        numbers = {
            "force": float(rng.uniform(5.0, 15.0)),
            "frequency": float(rng.uniform(8.0, 12.0)),
            "f1": float(rng.uniform(14.0, 18.0)),
        }
        coarse, fine, extrapolated, difference, better = errors(**numbers)
        assert 3.5 <= coarse / fine <= 4.5, numbers
        assert EFFECTIVITY[0] <= difference / coarse <= EFFECTIVITY[1], numbers
        assert GAIN * extrapolated <= fine, numbers
        # Of the joints, what the extrapolation leaves is of second order in the difference.
        assert np.max(better.violation) < float(difference)


def moved(f1, f2, cap=None, rtol=1e-7):
    """The chapter's example, below a cap if one is given."""
    scene = rj.gallery.cart_pendulum(f1=f1, f2=f2)
    system = rj.assemble(scene if cap is None else rj.cap(scene, cap))
    return run(system, TS, rtol=rtol, solver=RODAS5P)


@pytest.mark.slow
def test_the_time_of_a_run_does_not_depend_on_stiff_modes():
    steps = [int(moved(16.0, f2, 40.0).stats.num_steps) for f2 in (1e4, 1e5)]
    assert abs(steps[1] - steps[0]) <= 0.05 * steps[0]


@pytest.mark.exhaustive
def test_the_gradient_by_a_slow_mode_is_that_of_the_full_model():
    with rj.forward_mode():
        full, capped = (
            jax.jit(jax.jacfwd(lambda f1, cap=cap: moved(f1, 1e4, cap, TIGHT).q[-1]))(16.0)
            for cap in (None, 40.0)
        )
    assert_close(capped, full, GRADIENT, scale=np.max(np.abs(full)))


def test_what_is_refused():
    scene = cantilever()
    with pytest.raises(rj.InputError, match="no body of the scene deforms"):
        rj.cap(rj.gallery.chain(2), 40.0)
    with pytest.raises(rj.SceneError, match="body 'beam': cap is 0.0, but it must be positive"):
        rj.cap(scene, 0.0)
    with pytest.raises(rj.InputError, match="body 'beam' is capped already"):
        rj.cap(rj.cap(scene, 40.0), 20.0)
    made = through(rj.assemble(scene), TS[:3])
    with pytest.raises(rj.InputError, match="ratio = 1 must be above 1"):
        rj.extrapolate(rj.assemble(scene), made, made, ratio=1.0)
