"""Blades and shafts that rotate, against closed forms."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from comparison import assert_close
from programs import kept
from spatial_beams import (
    CONVERGED,
    EI,
    LENGTH,
    MASS,
    beam,
    clamped,
    marker,
    rates,
    small_motion,
    turning,
)
from tolerances import DIFFERENCED, SOLVED
from verification_problems.turning import stiffened

import romjax as rj
from romjax import spatial
from romjax.system import dynamics


@kept
def blade(spin):
    """A stiffened blade that turns about z, clamped to the axis."""
    body = beam(stiffening=True)

    def lagrangian(bent, rate):
        q, v = jax.jvp(functools.partial(clamped, body), (bent,), (rate,))
        v = turning(q, v, jnp.zeros(3).at[2].set(spin))
        return 0.5 * v @ body.mass_matrix(q) @ v - body.elastic_energy(q)

    return small_motion(lagrangian, body.modes)


@pytest.mark.parametrize("speed", [0.0, 1.0, 2.0, 6.0])
def test_rotating_cantilever(speed):
    """Flap of a stiffened blade, in units of √(EI / m L³); lead-lag is √(flap² − Ω²)."""
    unit = np.sqrt(EI / (MASS * LENGTH**3))
    found = rates(*blade(np.asarray(speed * unit)))[:2] / unit
    lag = stiffened(0.0, speed)
    flap = np.sqrt(lag**2 + speed**2)
    assert_close(found, [lag, flap], CONVERGED, flap)
    published = {0.0: 3.5160, 1.0: 3.6816, 2.0: 4.1373}
    if speed in published:
        assert_close(found[1], published[speed], CONVERGED)


@functools.partial(jax.jit, static_argnums=1)
def shaft(spin, polar):
    """A Rayleigh shaft that turns about its axis, by axes that turn with it."""
    across = MASS * LENGTH**2 / 12 + polar / 2
    body = beam(inertia=(polar, across, across), bending=9, rotary=True)
    count = 4 + body.modes

    def place(x):
        turn = jnp.concatenate([jnp.ones(1), jnp.zeros(1), 0.5 * x[2:4]])
        return jnp.concatenate([jnp.zeros(1), x[:2], turn, x[4:]])

    def lagrangian(x, rate):
        q, v = jax.jvp(place, (x,), (rate,))
        v = turning(q, v, jnp.zeros(3).at[0].set(spin))
        return 0.5 * v @ body.mass_matrix(q) @ v - body.elastic_energy(q)

    def off(x):
        ends = jnp.array([[-LENGTH / 2, 0.0, 0.0], [LENGTH / 2, 0.0, 0.0]])
        return jnp.concatenate([marker(body, place(x), end)[0][1:] for end in ends])

    return small_motion(lagrangian, count), jax.jacfwd(off)(jnp.zeros(count))


@pytest.mark.parametrize("spin", [0.0, 40.0])
def test_whirl_of_a_spinning_shaft(spin):
    """On bearings: (m/L + i β²) ω² − 2 i β² Ω ω − E I β⁴ = 0 of sections with a moment i about
    their diameters, β = kπ / L, by axes that do not turn.
    """
    polar = 0.02
    matrices, off = shaft(spin, polar)
    free = scipy.linalg.null_space(off)
    found = rates(*(free.T @ x @ free for x in matrices))[:3]
    wanted = []
    for k in range(1, 5):
        beta = k * np.pi / LENGTH
        tilted = polar / 2 / LENGTH * beta**2
        inertia = MASS / LENGTH + tilted
        wanted += list(np.roots([inertia, -2 * tilted * spin, -EI * beta**4]) - spin)
    wanted = np.sort(np.abs(wanted))[:3]
    assert_close(found, wanted, DIFFERENCED, wanted)


@pytest.mark.slow
def test_critical_speeds_of_an_overhung_disc():
    """A disc welded to a light shaft, the shaft to a hub, the hub in a bearing:
    det(K − Ω² diag(m, J − J_p)) = 0.

    In steady rotation q̇ = Ω G q, and what a small displacement brings back vanishes at the critical
    speed: ∂q̈/∂q + Ω ∂q̈/∂v G − Ω² G² is singular on displacements that the joints allow.
    """
    light, x = 1e-8, (1.0, 0.0, 0.0)
    hub = spatial.RigidBody("hub", 1.0, (0.01, 0.01, 0.01))
    across = (light * LENGTH**2 / 12,) * 3
    shaft = spatial.Beam("shaft", light, LENGTH, across, EI=EI, bending=2)
    shaft = shaft.placed("start", hub.pose())
    disc = spatial.RigidBody("disc", 2.0, (0.02, 0.012, 0.012))
    disc = disc.placed((0.0, 0.0, 0.0), shaft.pose("end"))
    joints = [
        spatial.Revolute(hub.at(axis=x), rj.ground.at((0.0, 0.0, 0.0), axis=x)),
        spatial.Weld(shaft.at("start"), hub.at()),
        spatial.Weld(disc.at(), shaft.at("end")),
    ]
    system = rj.assemble(rj.Scene([hub, shaft, disc], joints))
    about = np.zeros((system.n, system.n))  # G
    scales = []  # of quaternions, which change nothing
    for first in np.flatnonzero([label.endswith(".x") for label in system.structure.labels]):
        about[first + 1 : first + 3, first + 1 : first + 3] = [[0, -1], [1, 0]]
        quaternion = slice(first + 3, first + 7)
        about[quaternion, quaternion] = np.kron(np.eye(2), [[0, -0.5], [0.5, 0]])
        scales.append(np.zeros(system.n))
        scales[-1][quaternion] = system.q0[quaternion]

    @jax.jit
    def rest(q):
        return system.mass(q), dynamics.jacobian(system, 0.0, q)

    @jax.jit
    def slopes(q, v):
        return jax.jacfwd(lambda q, v: system.acceleration(0.0, q, v)[0], (0, 1))(q, v)

    mass, rows = rest(system.q0)
    mass, allowed = np.asarray(mass), scipy.linalg.null_space(rows)
    aside = np.stack([*scales, about @ np.asarray(system.q0)]) @ mass @ allowed
    bent = allowed @ scipy.linalg.null_space(aside)

    def least_stiffness(speed):
        by_q, by_v = map(np.asarray, slopes(system.q0, speed * about @ np.asarray(system.q0)))
        stiffness = -mass @ (by_q + speed * by_v @ about - speed**2 * about @ about)
        return np.linalg.eigvalsh(bent.T @ stiffness @ bent)[0]

    stiffness = EI / LENGTH**3 * np.array([[12, -6 * LENGTH], [-6 * LENGTH, 4 * LENGTH**2]])
    squares = scipy.linalg.eigvals(stiffness, np.diag([2.0, 0.012 - 0.02])).real
    critical = np.sqrt(np.max(squares))
    found = scipy.optimize.brentq(least_stiffness, 0.5 * critical, 1.5 * critical, rtol=SOLVED)
    assert_close(found, critical, DIFFERENCED, critical)
