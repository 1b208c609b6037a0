"""A lift that the package does not know: a quadratic manifold, of one class and one formulation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from quadratic import Quadratic, QuadraticLift
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import GRAVITY, TIGHT, four_bar, run

import romjax as rj
from romjax.system import dynamics

# Required of one mode, against the affine subspace of one mode: so many times less error. It is 173
# for a four-bar that falls by 4°.
BETTER = 100
END = 0.3  # s
SNAPSHOTS = 40


@pytest.fixture(scope="module")
def motion():
    system = rj.assemble(four_bar())
    return system, run(system, np.linspace(0.0, END, SNAPSHOTS))


@pytest.fixture(scope="module")
def basis(motion):
    return rj.pod(motion[1], rank=1)


@pytest.fixture(scope="module")
def rom(motion, basis):
    return rj.reduce(motion[0], basis, Quadratic())


@pytest.fixture(scope="module")
def approx(motion, rom):
    return run(rom, motion[1].t)


def test_it_is_a_reduced_system_like_any_other(motion, basis, rom):
    """By the object and by its name; nothing was registered."""
    system, _ = motion
    assert isinstance(rom, rj.ReducedSystem)
    assert isinstance(rom.lift, QuadraticLift)
    assert (rom.n, rom.m, rom.degrees_of_freedom) == (1, 0, 1)
    assert rom.summary == "quadratic in 1 modes"
    named = rj.reduce(system, basis, "quadratic")
    np.testing.assert_array_equal(named.lift.curvature, rom.lift.curvature)


def test_it_is_more_accurate_than_a_subspace(motion, basis, approx):
    system, truth = motion
    affine = run(rj.reduce(system, basis), truth.t)
    errors = [float(rj.compare(truth, made).error) for made in (affine, approx)]
    words = f"affine {errors[0]:.1e}, quadratic {errors[1]:.1e}, {errors[0] / errors[1]:.0f} times"
    assert errors[1] * BETTER <= errors[0], words


def test_the_start_is_the_nearest_point(motion, rom):
    """Of points on the manifold, coordinates and velocities come back."""
    system, _ = motion
    z, w = np.asarray(rom.q0) - 0.01, np.asarray(rom.v0) + 0.7

    @jax.jit
    def both(z, w):
        return rom.restrict(*rom.reconstruct(0.0, z, w)), rom.reconstruct(0.0, rom.q0, w)[0]

    back, start = both(z, w)
    for name, found, wanted in zip("zw", back, (z, w), strict=True):
        error = np.max(np.abs(found - wanted))
        assert error <= IDENTITY, f"{name}: off by {error:.1e}"
    missed = np.abs(np.subtract(start, system.q0))
    assert np.max(missed) <= 1e-4, f"start off by {missed}"


def test_tangent_and_bias(motion, rom):
    """G = ∂L/∂z by central differences of the position, and q̈ = G z̈ + β by the derivative of the
    velocity along z(t) = z + w t + ½ a t².
    """
    system, _ = motion
    z, w, a = np.asarray(rom.q0) - 0.02, np.array([0.4]), np.array([-0.8])
    step = 1e-4

    @jax.jit
    def position(z):
        return rom.lift.position(system, 0.0, z)

    slope = np.subtract(position(z + step), position(z - step)) / (2 * step)

    def along(s):
        return rom.reconstruct(s, z + w * s + 0.5 * a * s**2, w + a * s)

    @jax.jit
    def both():
        state = rom.state(0.0, z, w)
        found = state.motion.tangent[:, 0], state.motion.bias, state.physical_acceleration(a)
        return found, jax.jvp(along, (0.0,), (1.0,))

    (tangent, bias, found), ((_, v), (rate, wanted)) = both()
    error = np.max(np.abs(tangent - slope))
    assert error <= DIFFERENCED, f"tangent off by {error:.1e}"
    assert np.max(np.abs(np.subtract(rate, v))) <= IDENTITY
    error = np.max(np.abs(np.subtract(found, wanted)))
    assert error <= IDENTITY * np.max(np.abs(wanted)), f"acceleration off by {error:.1e}"
    assert np.max(np.abs(bias)) >= 1e-2  # else nothing was tested


def test_energy_is_conserved(motion, rom):
    """Virtual displacements stay on the manifold, so no force of it does work.

    The tolerance is that tight for the outputs between steps: at TIGHT they drift by 2e-8, the ends
    of steps by 2e-11.
    """
    system, truth = motion
    approx = run(rom, truth.t, rtol=1e-13)
    kinetic = jax.jit(jax.vmap(lambda q, v: dynamics.kinetic_energy(system, q, v)))
    kinetic = np.asarray(kinetic(approx.q, approx.v))
    total = kinetic + GRAVITY * np.sum(np.asarray(approx.q)[:, 1::3], axis=1)
    drift = np.max(np.abs(total - total[0])) / np.ptp(kinetic)
    assert drift <= SOLVED, f"drift {drift:.1e} of the kinetic range"


@pytest.mark.slow
def test_gradient_of_the_same_reduction_elsewhere(motion, rom):
    """By the mass of the coupler; the lift is that of 1 kg."""
    _, truth = motion

    def fallen(mass):
        other = rom.with_full(rj.assemble(four_bar(coupler=mass)))
        return jnp.sum(rj.simulate(other, truth.t[::13], rtol=TIGHT, audit=False).q[-1, 1::3])

    check = rj.check_gradient(fallen, 1.2)
    assert check.error <= DIFFERENCED, f"\n{check}"
    assert abs(float(check.reverse)) >= 1e-3  # else nothing was tested
