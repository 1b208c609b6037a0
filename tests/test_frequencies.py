"""Smooth orthogonal values are natural frequencies (Chelidze and Zhou 2006): λ = 1/ω²."""

import numpy as np
import pytest
import scipy.linalg
from verification_problems.reduced import building, of_a_building, vibration

import romjax as rj

# Required of natural frequencies; reached with light damping; and how much of a natural mode is in
# a smooth one, where proper orthogonal modes of equal energy mix.
FREQUENCY, DAMPED = 1e-6, 1e-4
ALIKE, MIXED = 0.999, 0.95
COUNT = 20_001  # times of the motions of three masses


def three(frequencies):
    """Unequal masses with given frequencies, and mass-normalised modes."""
    mass = np.diag([1.0, 2.0, 0.5])
    turned, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    return mass, np.asarray(frequencies, float), np.linalg.solve(np.sqrt(mass), turned)


def hertz(basis):
    return 1 / np.sqrt(np.asarray(basis.values))


def test_over_a_common_period():
    mass, w, modes = three([1, 2, 5])
    t = np.linspace(0, 2 * np.pi, COUNT)
    free = vibration(t, mass, w, modes, 0.0, np.array([1.0, 0.6, 0.2]), np.array([0.3, -0.5, 0.4]))
    basis = rj.sod(free, rank=3, offset=np.zeros(3))
    assert np.max(np.abs(hertz(basis) / w - 1)) <= FREQUENCY


def test_a_building_from_starts_of_equal_energy():
    """24 storeys, frequencies that share no period. Starts of unit energy in each storey's spring
    and mass make Σ_xx = K⁻¹ and Σ_vv = M⁻¹ at every time, so a second is enough.
    """
    mass, stiffness = building()
    w = np.sqrt(scipy.linalg.eigvalsh(stiffness, mass))
    basis = of_a_building()
    assert np.max(np.abs(hertz(basis) / w - 1)) <= FREQUENCY
    modes = np.asarray(basis.modes)
    assert np.max(np.abs(modes.T @ mass @ modes - np.eye(24))) <= FREQUENCY


@pytest.mark.parametrize("damping", [0.01, 0.03])
def test_of_a_damped_system(damping):
    """Struck so that all modes move equally far: the proper orthogonal values come together, and
    their modes are any mixture. The smooth ones are told apart by their frequencies.
    """
    mass, w, modes = three([1, 2, 5])
    t = np.linspace(0, 80 * np.pi, COUNT)
    speed = w * np.sqrt(w)  # equal ∫x², as each mode lasts 1/ω
    struck = vibration(t, mass, w, modes, damping, np.zeros(3), speed)
    smooth, proper = (f(struck, rank=3, offset=np.zeros(3)) for f in (rj.sod, rj.pod))
    assert np.max(np.abs(hertz(smooth) / w - 1)) <= DAMPED
    overlap = [
        np.max(np.abs(np.asarray(b.modes).T @ mass @ modes), axis=1) for b in (smooth, proper)
    ]
    assert np.min(overlap[0]) >= ALIKE
    assert np.min(overlap[1]) <= MIXED
