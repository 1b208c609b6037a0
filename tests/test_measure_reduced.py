"""What is measured along runs of reduced models, against the full one."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from groups import in_groups
from mechanics import marker_place
from tolerances import DIFFERENCED, IDENTITY

import romjax as rj
from romjax.measure.states import accelerations

# Required: a reduced model's quantities differ from the full ones by no more than its coordinates
# let them, to first order, times this for the rest; which is at most this share of them.
AMPLIFIED, NOTICED = 1.2, 0.05


# The share of the second bending mode, which reduced models drop, in accelerations and forces.
DROPPED = 2e-3


KINEMATIC = (
    "position",
    "velocity",
    "acceleration",
    "angle",
    "angular_velocity",
    "angular_acceleration",
)


@pytest.fixture(
    scope="module", params=in_groups(["galerkin", "minimal"], fast=["minimal"], slow=["galerkin"])
)
def reduced(request, cart_pendulum, truth):
    rank = 6 if request.param == "galerkin" else 3
    rom = rj.reduce(cart_pendulum, rj.pod(truth, rank=rank), request.param)
    # As tight as the truth: at 1e-9, rounding decides which steps follow the second bending mode.
    return rom, rj.simulate(rom, truth.t, rtol=1e-10)


def relative_difference(found, wanted):
    return np.max(np.abs(found - wanted), axis=0) / np.max(np.abs(wanted), axis=0)


def errors(system, truth, rom, run):
    """Of the reduced model's own coordinates, velocities and accelerations, (3, n)."""
    a, wanted = accelerations(rom, run), accelerations(system, truth)
    pairs = (run.q, truth.q), (run.v, truth.v), (a, wanted)
    return np.array([np.max(np.abs(x - exact), axis=0) for x, exact in pairs])


def pose(marker, q):
    """Position and angle of a marker on the pendulum, by functions of the tests."""
    scene = rj.gallery.cart_pendulum()
    turn = q[5] + scene.bodies[1].mode_shapes(marker.point)[2] @ q[6:]
    return jnp.concatenate([marker_place(scene, marker, q), turn[None]])


pose_slopes = jax.jit(jax.vmap(jax.jacfwd(pose, argnums=1), in_axes=(None, 0)))


@pytest.mark.parametrize("place", [(0.0, -0.4), (0.0, 0.1)])
def test_reduced_models_agree(cart_pendulum, truth, reduced, place):
    """In every measured quantity, by no more than the errors of the model's own coordinates, their
    rates and second rates, as far as the marker moves with them.
    """
    rom, run = reduced
    marker = rj.gallery.cart_pendulum().bodies[1].at(place)
    full, approx = rj.measure(cart_pendulum, truth, marker), rj.measure(rom, run, marker)
    slopes = np.max(np.abs(pose_slopes(marker, truth.q)), axis=0)
    limits = AMPLIFIED * errors(cart_pendulum, truth, rom, run) @ slopes.T
    for names, at in ((KINEMATIC[:3], np.s_[:2]), (KINEMATIC[3:], np.s_[2:])):
        for name, limit in zip(names, limits, strict=True):
            found, wanted = getattr(approx, name), getattr(full, name)
            shape = (len(found), -1)
            assert_close(found.reshape(shape), wanted.reshape(shape), 1, limit[at])
            assert np.max(limit[at]) < NOTICED * np.max(np.abs(wanted)), name


def test_forces_of_reduced_models_agree(cart_pendulum, truth, reduced):
    rom, run = reduced
    limit = DROPPED
    for forces in (rj.joint_forces, rj.effect_forces):
        full, approx = forces(cart_pendulum, truth), forces(rom, run)
        for key in set(full) - {"cart angle"}:  # which carries nothing
            assert np.max(relative_difference(approx[key].force, full[key].force)) < limit, key
    cuts = [-0.2, 0.0, 0.3]
    full = rj.resultants(cart_pendulum, truth, "pendulum", cuts)
    for x, wanted in zip(rj.resultants(rom, run, "pendulum", cuts), full, strict=True):
        assert np.max(relative_difference(x, wanted)) < limit


@pytest.mark.slow
def test_forces_of_reduced_models_differentiate(reduced):
    """By the mass of the cart, at given states."""
    rom, run = reduced

    @jax.jit
    def force(mass):
        full = eqx.tree_at(lambda s: s.bodies[0].bodies.mass, rom.full, mass[None])
        return rj.joint_forces(rom.with_full(full), run.every(100))["hinge"].force[-1, 0]

    mass, h = jnp.asarray(1.0), 1e-4
    wanted = (force(mass + h) - force(mass - h)) / (2 * h)
    assert_close(jax.grad(force)(mass), wanted, DIFFERENCED, abs(wanted))


def test_quantities_of_reduced_models(cart_pendulum, truth, reduced):
    """By coordinates of the reduced model, the number of the physical state they stand for."""
    rom, _ = reduced
    pendulum = rj.gallery.cart_pendulum().bodies[1]
    quantity = rj.quantity.Rate(rj.quantity.Gap(pendulum.at((0.0, -0.4)), rj.ground.at((0.3, 0.1))))
    state = rom.reconstruct(0.0, rom.q0, rom.v0 + 0.1)
    wanted = quantity(cart_pendulum, 0.0, *state)
    assert_close(quantity(rom, 0.0, rom.q0, rom.v0 + 0.1), wanted, IDENTITY)
    slope = jax.jit(jax.grad(lambda z: quantity(rom, 0.0, z, rom.v0 + 0.1)))(rom.q0)
    assert math.isfinite(float(jnp.sum(slope)))
