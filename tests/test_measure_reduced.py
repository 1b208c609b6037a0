"""What is measured along runs of reduced models, against the full one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from mechanics import marker_place
from tolerances import DIFFERENCED, IDENTITY, SOLVED

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


@pytest.fixture(scope="module")
def truth():
    return zoo.motion(zoo.cart_pendulum)


@pytest.fixture(scope="module", params=in_groups(["galerkin", "minimal"], fast=["minimal"]))
def reduced(request, truth):
    """As tight as the truth: at 1e-9, rounding decides which steps follow the second bending mode,
    which three minimal coordinates lack.
    """
    rank, solver = {"galerkin": (6, zoo.RODAS5P), "minimal": (3, zoo.DOPRI8)}[request.param]
    rom = rj.reduce(truth.system, rj.pod(truth, rank=rank), request.param)
    return rom, zoo.run(rom, truth.t, solver=solver)


# For slow tests of the runs that fast tests look at; those of six coordinates are exhaustive.
LONGER = pytest.mark.parametrize(
    "reduced", in_groups(["galerkin", "minimal"], slow=["minimal"]), indirect=True
)


def relative_difference(found, wanted):
    found, wanted = np.asarray(found), np.asarray(wanted)
    return np.max(np.abs(found - wanted), axis=0) / np.max(np.abs(wanted), axis=0)


def errors(system, truth, rom, run):
    """Of the reduced model's own coordinates, velocities and accelerations, (3, n)."""
    a, wanted = accelerations(rom, run), accelerations(system, truth)
    pairs = (run.q, truth.q), (run.v, truth.v), (a, wanted)
    return np.array([np.max(np.abs(np.subtract(x, exact)), axis=0) for x, exact in pairs])


def pose(marker, q):
    """Position and angle of a marker on the pendulum, by functions of the tests."""
    scene = rj.gallery.cart_pendulum()
    turn = q[5] + scene.bodies[1].mode_shapes(marker.point)[2] @ q[6:]
    return jnp.concatenate([marker_place(scene, marker, q), turn[None]])


pose_slopes = jax.jit(jax.vmap(jax.jacfwd(pose, argnums=1), in_axes=(None, 0)))


@LONGER
def test_reduced_models_agree(truth, reduced):
    """In every measured quantity of two points, by no more than the errors of the model's own
    coordinates, their rates and second rates, as far as the marker moves with them.
    """
    rom, run = reduced
    own = errors(truth.system, truth, rom, run)
    for place in ((0.0, -0.4), (0.0, 0.1)):
        marker = rj.gallery.cart_pendulum().bodies[1].at(place)
        full, approx = rj.measure(truth.system, truth, marker), rj.measure(rom, run, marker)
        limits = AMPLIFIED * own @ np.max(np.abs(pose_slopes(marker, truth.q)), axis=0).T
        for names, at in ((KINEMATIC[:3], np.s_[:2]), (KINEMATIC[3:], np.s_[2:])):
            for name, limit in zip(names, limits, strict=True):
                found, wanted = (np.asarray(getattr(x, name)) for x in (approx, full))
                shape = (len(found), -1)
                assert_close(found.reshape(shape), wanted.reshape(shape), 1, limit[at])
                assert np.max(limit[at]) < NOTICED * np.max(np.abs(wanted)), name


def test_joint_forces_of_rigid_bodies_agree():
    """Of two bars by their two angles, which leave nothing out."""
    motion = zoo.motion(zoo.bars)
    rom = rj.reduce(motion.system, rj.pod(motion, rank=2), "minimal")
    full = rj.joint_forces(motion.system, motion)
    approx = rj.joint_forces(rom, zoo.run(rom, motion.t))
    for key in full:
        assert np.max(relative_difference(approx[key].force, full[key].force)) < 10 * SOLVED, key


@LONGER
def test_joint_forces_of_reduced_models_agree(truth, reduced):
    full, approx = (rj.joint_forces(*x)["hinge"].force for x in ((truth.system, truth), reduced))
    assert np.max(relative_difference(approx, full)) < DROPPED


@LONGER
def test_other_forces_of_reduced_models_agree(truth, reduced):
    """In all joints, of effects, and in cuts of the pendulum."""
    rom, run = reduced
    for forces in (rj.joint_forces, rj.effect_forces):
        full, approx = forces(truth.system, truth), forces(rom, run)
        for key in set(full) - {"cart angle"}:  # which carries nothing
            assert np.max(relative_difference(approx[key].force, full[key].force)) < DROPPED, key
    cuts = [-0.2, 0.0, 0.3]
    full = rj.resultants(truth.system, truth, "pendulum", cuts)
    for x, wanted in zip(rj.resultants(rom, run, "pendulum", cuts), full, strict=True):
        assert np.max(relative_difference(x, wanted)) < DROPPED


@LONGER
def test_forces_of_reduced_models_differentiate(reduced):
    """By the mass of the cart, at given states."""
    rom, run = reduced

    @jax.jit
    @jax.value_and_grad
    def force(mass):
        full = eqx.tree_at(lambda s: s.bodies[0].bodies.mass, rom.full, mass[None])
        return rj.joint_forces(rom.with_full(full), run.every(100))["hinge"].force[-1, 0]

    h = 1e-4
    (below, _), (_, slope), (above, _) = (force(jnp.asarray(1.0 + x)) for x in (-h, 0.0, h))
    wanted = (float(above) - float(below)) / (2 * h)
    assert_close(slope, wanted, DIFFERENCED, abs(wanted))


def test_quantities_of_reduced_models(truth, reduced):
    """By coordinates of the reduced model, the number of the physical state they stand for."""
    rom, _ = reduced
    pendulum = rj.gallery.cart_pendulum().bodies[1]
    quantity = rj.quantity.Rate(rj.quantity.Gap(pendulum.at((0.0, -0.4)), rj.ground.at((0.3, 0.1))))

    @jax.jit
    def both(rom, w):
        own, slope = jax.value_and_grad(lambda z: quantity(rom, 0.0, z, w))(rom.q0)
        return own, quantity(rom.full, 0.0, *rom.reconstruct(0.0, rom.q0, w)), slope

    own, wanted, slope = both(rom, np.asarray(rom.v0) + 0.1)
    assert_close(own, wanted, IDENTITY)
    assert np.all(np.isfinite(slope))
