"""Local bases: d'Alembert's principle on each body's own modes, and motions never trained on."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from groups import in_groups
from mechanisms import turned_about_the_origin
from motions import motion as made_up
from random_scenes import random_scene
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import TIGHT, bars, falling_beams, motion, run, system

import romjax as rj
from romjax.assembly.disassemble import disassemble
from romjax.reduction.local.bases import BodyBases

TS = np.linspace(0.0, 1.0, 101)
# Required of eight beams with eight modes: the error on the training, and how many times that on
# starts that no snapshot is from.
TRAINED, PREDICTED = 5e-5, 2.0
# Spins [rad/s] and tilts [rad] of these starts.
HELD_OUT = (
    *((1.0, 0.0), (-1.0, 0.0), (0.0, 0.52), (0.0, -0.52), (0.05, 0.0)),
    *((0.5, 0.3), (-0.5, 0.3), (0.5, -0.3), (-0.5, -0.3), (1.0, 0.52)),
)


class Turned(rj.Beam):
    """A beam that does not say what its mass matrix is made of."""

    def invariants(self):
        return None

    def mass_matrix(self, q):
        return super().invariants().matrix(q)


@eqx.filter_jit
def matrices(system, t, z, w):
    """Q and v, the constraints and the mass matrix at a state."""
    return system.reconstruct(t, z, w), system.constraint(t, z), system.mass(z)


@eqx.filter_jit
def mass_of(system, q):
    return system.mass(q)


def bodies(kind):
    """A body of each kind, bent and turning, with three modes or more."""
    start = {"velocity": (0.3, -0.2), "angular_velocity": 1.5, "angle": 0.4}
    bent = {"amplitudes": [0.02, -0.01, 0.015], "rates": [0.1, 0.2, -0.1]}
    if kind == "modal":
        lot = np.random.default_rng(3)
        skew = lot.normal(size=(3, 3))
        inertia = rj.Inertia(
            2.0,
            0.8,
            modal=np.eye(3) + 0.2,
            first_moment=(0.1, -0.05),
            shift=0.1 * lot.normal(size=(2, 3)),
            swing=0.1 * lot.normal(size=3),
            stretch=0.1 * lot.normal(size=3),
            gyration=0.1 * (skew - skew.T),
        )
        shapes = lot.normal(size=(2, 3, 3))
        points = [(-0.5, 0.0), (0.5, 0.0)]
        return rj.ModalBody("body", inertia, [30.0, 80.0, 200.0], points, shapes, **start, **bent)
    if kind == "capped":
        return rj.CappedBody(rj.Beam("body", 1.0, 1.0, EI=5.0, modes=3, **start, **bent), 8.0)
    settings = {"EI": 5.0, "modes": 3, "damping": 0.02, "shapes": "clamped-free"}
    kind_of_beam = Turned if kind == "own" else rj.Beam
    stiffening = kind == "stiffened"
    return kind_of_beam("body", 1.0, 1.0, stiffening=stiffening, **settings, **start, **bent)


def hinged(kind):
    """The body on a hinge, with a load at its other end, under gravity."""
    body = bodies(kind)
    hinge = rj.Revolute(body.at((-0.5, 0.0)), rj.ground.at())
    spring = rj.Spring(body.at((0.5, 0.0)), rj.ground.at((1.0, 1.0)), 30.0)
    return rj.assemble(rj.Scene([body], [hinge], [rj.Gravity(), spring]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    in_groups(
        ("modal", "stiffened", "capped", "own"), fast=("modal", "stiffened"), slow=("capped", "own")
    ),
)
def test_the_principle_of_dalembert_on_the_lift(kind):
    """T of full size, on the full equations at random states: Tᵀ(M T ẇ + C_qᵀλ − Q) = 0."""
    system, lot = hinged(kind), np.random.default_rng(1)
    straight = np.where(np.arange(6) < 3, system.q0, 0.0)
    metric = mass_of(system, straight)
    basis = rj.Basis.from_modes(lot.normal(size=(6, 2)), np.zeros(6), metric)
    rom = rj.reduce(system, basis, rj.Local())
    assert (rom.n, rom.m, rom.ranks) == (5, 2, (2,))

    @jax.jit
    def both(t, z, w):
        """Of the model and of the full equations on the lift, with the size of each."""
        expansion = jax.jacfwd(lambda z: rom.reconstruct(t, z, z)[0])(z)
        q, v = expansion @ z, expansion @ w
        state, full = rom.state(t, z, w), system.state(t, q, v)
        modal, down, size = expansion[3:, 3:], expansion.T, jnp.max(jnp.abs(full.force()))
        a, multipliers = rom.acceleration(t, z, w)
        pushed = system.mass(q) @ state.physical_acceleration(a) + full.jacobian().T @ multipliers
        return {
            "modes": (modal.T @ metric[3:, 3:] @ modal, jnp.eye(2), 1.0),
            "mass": (rom.mass(z), down @ system.mass(q) @ expansion, 1.0),
            "force": (rom.force(t, z, w), down @ full.force(), size),
            "constraint": (rom.constraint(t, z), system.constraint(t, q), 1.0),
            "jacobian": (state.jacobian(), full.jacobian() @ expansion, 1.0),
            "state": (jnp.stack([state.q, state.v]), jnp.stack([q, v]), 1.0),
            "energy": (state.energy().total, full.energy().total, size),
            "balance": (down @ pushed, down @ full.force(), size),
        }

    for what, (own, wanted, size) in both(0.2, *(0.3 * lot.normal(size=(2, 5)))).items():
        error = np.max(np.abs(np.subtract(own, wanted))) / size
        assert error <= IDENTITY, f"{what}: {error:.1e}"


@pytest.mark.parametrize("seed", range(3))
def test_a_system_is_its_scene(seed):
    """Taken apart and assembled again, it is the same to the last digit, with all names."""
    system = rj.assemble(disassemble(rj.assemble(random_scene(seed))))
    again = rj.assemble(disassemble(system))
    assert again.structure == system.structure
    assert again.pattern == system.pattern
    leaves, others = jax.tree.leaves(again), jax.tree.leaves(system)
    assert jax.tree.structure(again) == jax.tree.structure(system)
    assert all(np.array_equal(*pair) for pair in zip(leaves, others, strict=True))


@pytest.fixture(scope="module")
def beams():
    """Three beams that fall from the level: the system and its motion."""
    return system(falling_beams), motion(falling_beams, 0.3, 31)


def moved(rom, ts=TS[:31], **settings):
    return run(rom, ts, **settings)


@pytest.fixture(scope="module")
def every(beams):
    """With all modes of all bodies."""
    full, motion = beams
    return rj.reduce(full, rj.pod(motion), rj.Local(ranks=(3, 3, 3)))


def test_all_modes_are_the_full_model(beams, every):
    _, motion = beams
    made = moved(every)
    assert rj.compare(motion, made).error <= SOLVED
    assert made.is_valid


def test_one_tolerance_for_all_bodies(beams):
    """The modes with the largest values of all; none of a body that hardly bends."""
    system, motion = beams
    basis = rj.pod(motion, rank=4)
    roots = [np.asarray(motion.q)[:, own] for own in np.arange(18).reshape(3, 6)[:, 3:]]
    weights = np.asarray(basis.snapshots.weights)[:, None]
    values = [np.linalg.svd(weights * x, compute_uv=False) for x in roots]
    every = np.sort(np.concatenate(values))[::-1]
    ranks = rj.reduce(system, rj.pod(motion, rank=6), "local").ranks
    assert ranks == tuple(int(np.sum(x >= every[5])) for x in values)
    tol = float(0.5 * (every[2] + every[3]) / basis.spectrum[0])
    assert sum(rj.reduce(system, basis, rj.Local(tol)).ranks) == 3
    rigid = rj.reduce(system, basis, rj.Local(tol=0.1))
    assert (rigid.n, rigid.ranks) == (9, (0, 0, 0))
    assert "0 of 9 modes of 3 flexible bodies" in rigid.summary


def test_smooth_modes_of_each_body(beams):
    """The decomposition of the basis is the one of the bodies."""
    system, motion = beams
    smooth, proper = (
        rj.reduce(system, make(motion, rank=3), rj.Local(ranks=(2, 2, 2)))
        for make in (rj.sod, rj.pod)
    )
    assert smooth.n == proper.n == 15
    assert not np.allclose(smooth.bases.modes[0], proper.bases.modes[0], atol=1e-3)


def test_other_starts_and_other_numbers(beams):
    """The same bases, and a start on all constraints."""
    system, motion = beams
    rom = rj.reduce(system, rj.pod(motion, rank=3), "local")
    t, q, v = (np.asarray(x)[20] for x in (motion.t, motion.q, motion.v))
    later = rom.starting_at(q, v, t)
    (met, _), violation, _ = matrices(later, later.time, later.q0, later.v0)
    assert np.max(np.abs(met - q)) <= 1e-3
    assert np.max(np.abs(violation)) <= IDENTITY
    assert float(later.time) == t
    heavier = rj.assemble(falling_beams(3, mass=1.3))
    other = rom.with_full(heavier)
    assert jax.tree.structure(other) == jax.tree.structure(rom)
    wanted = np.diag(mass_of(heavier, heavier.q0))[:3]
    *_, mass = matrices(other, other.time, other.q0, other.v0)
    assert_close(np.diag(mass)[:3], wanted, IDENTITY)
    with pytest.raises(rj.ReductionError, match="cannot take the place"):
        rom.with_full(rj.assemble(falling_beams(2)))


@pytest.mark.parametrize("sign", [1, -1])
def test_deflections_beyond_the_training_are_flagged(every, sign):
    bent = np.array(every.q0)
    bent[3] = sign * 11 * every.validity.largest[3]
    assert "leaves" in moved(every, TS[:3], q0=bent, throw=False).warnings()
    assert moved(every, TS[:3]).is_valid


@pytest.mark.slow
def test_a_gradient_through_bodies_and_bases(beams):
    """Three ways, of the acceleration: by the mass of the beams, which is in the metric of the
    snapshots too, and by the snapshots themselves.
    """
    _, motion = beams
    basis = rj.pod(motion, rank=3)
    change = 1e-6 * np.random.default_rng(2).normal(size=motion.q.shape)

    def tips(x):
        system = rj.assemble(falling_beams(3, mass=1.0 + x))
        snapshots = dataclasses.replace(basis.snapshots, q=motion.q + x * change)
        other = dataclasses.replace(basis, snapshots=snapshots)
        rom = rj.reduce(system, other, rj.Local(ranks=(1, 1, 1)))
        q, v = rom.restrict(motion.q[20], motion.v[20])
        state = rom.state(0.0, q, v)
        return jnp.sum(state.physical_acceleration(rom.acceleration(0.0, q, v)[0]))

    check = rj.check_gradient(tips, 0.1)
    assert check.error <= DIFFERENCED, f"\n{check}"


@pytest.mark.slow
def test_a_gradient_through_a_run(beams):
    """By the mass of the beams."""
    system, motion = beams
    rom = rj.reduce(system, rj.pod(motion, rank=3), "local")

    def tip(mass):
        other = rom.with_full(rj.assemble(falling_beams(3, mass=mass)))
        return jnp.sum(rj.simulate(other, TS[:4], dt=0.005, audit=False, throw=False).q[-1] ** 2)

    check = rj.check_gradient(tip, 1.1)
    assert check.error <= DIFFERENCED, f"\n{check}"


def test_what_has_no_local_bases(beams, every):
    system, motion = beams
    basis = rj.pod(motion, rank=3)
    with pytest.raises(rj.ReductionError, match=r"ranks=\(1, 4, 1\), but .* have \(3, 3, 3\)"):
        rj.reduce(system, basis, rj.Local(ranks=(1, 4, 1)))
    # Numbers of rigid bodies belong to them too, those of the states of effects do not.
    one = rj.Beam("beam", 1.0, 1.0, frequencies=[30.0, 80.0, 150.0])
    two = [rj.RigidBody(name, 1.0, 1.0) for name in ("bar", "block")]
    pid = rj.PID(one.at(), two[0].at(), rj.Constant(0.0), 1.0)
    mixed = rj.Scene([one, *two], effects=[pid])
    with pytest.raises(rj.ReductionError, match=r"ranks=\(2,\), but .* have \(3, 0, 0\) modes"):
        rj.reduce(rj.assemble(mixed), rj.pod(made_up(mixed), rank=2), rj.Local(ranks=(2,)))
    with pytest.raises(rj.InputError, match=r"tol=2\.0, but it must lie between 0 and 1"):
        rj.Local(tol=2.0)
    with pytest.raises(rj.InputError, match="not both"):
        rj.Local(tol=0.1, ranks=(1, 1, 1))
    rigid = rj.assemble(bars())
    with pytest.raises(rj.ReductionError, match="has no body that deforms"):
        rj.reduce(rigid, rj.Basis.from_modes(np.eye(6)[:, :1], rigid.q0), "local")
    with pytest.raises(rj.ReductionError, match="is reduced already"):
        rj.reduce(every, basis, "local")

    def traced(q):
        return rj.reduce(system, rj.pod(dataclasses.replace(motion, q=q), rank=3), "local").q0

    with pytest.raises(ValueError, match=r"romjax\.Local\(ranks=rom\.ranks\)"):
        jax.jit(traced)(motion.q)


@pytest.mark.slow
def test_what_was_never_trained_is_predicted():
    """Eight beams with one mode each, on ten starts that no snapshot is from."""
    system = rj.assemble(falling_beams(8))
    truth = rj.simulate(system, TS, rtol=TIGHT, audit=False)
    rom = rj.reduce(system, rj.pod(truth, rank=8), "local")
    assert rom.ranks == (1,) * 8
    settings = {"rtol": 1e-8}
    errors = [rj.compare(truth, rj.simulate(rom, TS, **settings)).error]
    for spin, tilt in HELD_OUT:
        q, v = turned_about_the_origin(system, spin, tilt)
        other = rj.simulate(system, TS, q0=q, v0=v, rtol=TIGHT, audit=False)
        run = rj.simulate(rom.starting_at(q, v), TS, **settings)
        # The last beam hardly bends beside how far all move, and by one mode a quarter wrong.
        assert run.flags == rj.Flag.LEFT_OUT, run.warnings()
        assert "and deflection of beam7 is wrong by" in run.warnings()
        errors.append(rj.compare(other, run).error)
    assert errors[0] <= TRAINED, f"{errors[0]:.1e}"
    assert max(errors) <= PREDICTED * errors[0], f"{[f'{x:.1e}' for x in errors]}"


def test_counters_of_angles_beside_rigid_bodies():
    """Neither has modes, but they have different numbers of coordinates."""
    none, beam = np.zeros((0, 0)), np.array([[0.6], [0.8]])
    columns = [tuple(range(7)), (7,), tuple(range(8, 17)), tuple(range(17, 24))]
    bases = BodyBases.of([none, none, beam, none], [none, none, np.eye(2), none], columns)
    z = np.arange(1.0, 24.0)
    q, again = eqx.filter_jit(lambda bases, z: (bases.expand(z), bases.project(bases.expand(z))))(
        bases, z
    )
    wanted = np.concatenate([z[:15], np.array([0.6, 0.8]) * z[15], z[16:]])
    assert_close(q, wanted, IDENTITY, z[-1])
    assert_close(again, z, IDENTITY, z[-1])
