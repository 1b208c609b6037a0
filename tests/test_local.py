"""Local bases: d'Alembert's principle on each body's own modes, and motions never trained on."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from mechanisms import turned_about_the_origin
from random_scenes import random_scene
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import TIGHT, falling_beams

import romjax as rj
from romjax.assembly.disassemble import disassemble
from romjax.local.bases import BodyBases

TS = jnp.linspace(0.0, 1.0, 101)
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


@pytest.mark.parametrize("kind", ["stiffened", "modal", "capped", "own"])
def test_the_principle_of_dalembert_on_the_lift(kind):
    """T of full size, on the full equations at random states: Tᵀ(M T ẇ + C_qᵀλ − Q) = 0."""
    system, lot = hinged(kind), np.random.default_rng(1)
    metric = system.mass(system.q0.at[3:].set(0))
    basis = rj.Basis.from_modes(lot.normal(size=(6, 2)), jnp.zeros(6), jnp.eye(6))
    basis = basis.orthonormalised(metric)
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
        error = jnp.max(jnp.abs(own - wanted)) / size
        assert error <= IDENTITY, f"{what}: {error:.1e}"


@pytest.mark.parametrize("seed", range(3))
def test_a_system_is_its_scene(seed):
    """Taken apart and assembled again, it is the same to the last digit, with all names."""
    system = rj.assemble(disassemble(rj.assemble(random_scene(seed))))
    again = rj.assemble(disassemble(system))
    assert again.structure == system.structure
    assert again.pattern == system.pattern
    assert eqx.tree_equal(again, system)


@pytest.fixture(scope="module")
def beams():
    """Three beams that fall from the level: the system and its motion."""
    system = rj.assemble(falling_beams(3))
    return system, rj.simulate(system, TS[:31], rtol=TIGHT)


def test_all_modes_are_the_full_model(beams):
    system, motion = beams
    rom = rj.reduce(system, rj.pod(motion), rj.Local(ranks=(3, 3, 3)))
    run = rj.simulate(rom, motion.t, rtol=TIGHT)
    assert rj.compare(motion, run).error <= SOLVED
    assert run.is_valid


def test_one_tolerance_for_all_bodies(beams):
    """The modes with the largest values of all; none of a body that hardly bends."""
    system, motion = beams
    basis = rj.pod(motion, rank=4)
    roots = [motion.q[:, own] for own in np.arange(18).reshape(3, 6)[:, 3:]]
    weights = basis.snapshots.weights[:, None]
    values = [np.linalg.svd(weights * x, compute_uv=False) for x in roots]
    every = np.sort(np.concatenate(values))[::-1]
    for count in (1, 4, 6):
        ranks = rj.reduce(system, rj.pod(motion, rank=count), "local").ranks
        assert ranks == tuple(int(np.sum(x >= every[count - 1])) for x in values)
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
    assert not jnp.allclose(smooth.bases.modes[0], proper.bases.modes[0], atol=1e-3)


def test_other_starts_and_other_numbers(beams):
    """The same bases, and a start on all constraints."""
    system, motion = beams
    rom = rj.reduce(system, rj.pod(motion, rank=3), "local")
    later = rom.starting_at(motion.q[20], motion.v[20], motion.t[20])
    q, _ = later.reconstruct(later.time, later.q0, later.v0)
    assert jnp.max(jnp.abs(q - motion.q[20])) <= 1e-3
    assert jnp.max(jnp.abs(later.constraint(0.0, later.q0))) <= IDENTITY
    assert float(later.time) == motion.t[20]
    heavier = rj.assemble(falling_beams(3, mass=1.3))
    other = rom.with_full(heavier)
    assert jax.tree.structure(other) == jax.tree.structure(rom)
    wanted = jnp.diag(heavier.mass(heavier.q0))[:3]
    assert_close(jnp.diag(other.mass(other.q0))[:3], wanted, IDENTITY)
    with pytest.raises(rj.ReductionError, match="cannot take the place"):
        rom.with_full(rj.assemble(falling_beams(2)))


def test_deflections_beyond_the_training_are_flagged(beams):
    system, motion = beams
    rom = rj.reduce(system, rj.pod(motion, rank=3), "local")
    bent = rom.q0.at[3].set(11 * rom.validity.largest[3])
    ts = TS[:3]
    assert "leaves" in rj.simulate(rom, ts, q0=bent, v0=rom.v0, throw=False).warnings()
    assert rj.simulate(rom, ts).is_valid


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
        return jnp.sum(rj.simulate(other, TS[:4], dt=0.005, throw=False).q[-1] ** 2)

    check = rj.check_gradient(tip, 1.1)
    assert check.error <= DIFFERENCED, f"\n{check}"


def test_what_has_no_local_bases(beams):
    system, motion = beams
    basis = rj.pod(motion, rank=3)
    with pytest.raises(rj.ReductionError, match=r"ranks=\(1, 4, 1\), but .* have \(3, 3, 3\)"):
        rj.reduce(system, basis, rj.Local(ranks=(1, 4, 1)))
    with pytest.raises(rj.InputError, match=r"tol=2\.0, but it must lie between 0 and 1"):
        rj.Local(tol=2.0)
    with pytest.raises(rj.InputError, match="not both"):
        rj.Local(tol=0.1, ranks=(1, 1, 1))
    rigid = rj.assemble(rj.gallery.chain(2))
    run = rj.simulate(rigid, TS[:11])
    with pytest.raises(rj.ReductionError, match="has no body that deforms"):
        rj.reduce(rigid, rj.pod(run), "local")
    with pytest.raises(rj.ReductionError, match="is reduced already"):
        rj.reduce(rj.reduce(system, basis, rj.Local(ranks=(3, 3, 3))), basis, "local")

    def traced(q):
        return rj.reduce(system, rj.pod(dataclasses.replace(motion, q=q), rank=3), "local").q0

    with pytest.raises(ValueError, match=r"romjax\.Local\(ranks=rom\.ranks\)"):
        jax.jit(traced)(motion.q)


@pytest.mark.slow
def test_what_was_never_trained_is_predicted():
    """Eight beams with one mode each, on ten starts that no snapshot is from."""
    system = rj.assemble(falling_beams(8))
    truth = rj.simulate(system, TS, rtol=TIGHT)
    rom = rj.reduce(system, rj.pod(truth, rank=8), "local")
    assert rom.ranks == (1,) * 8
    settings = {"rtol": 1e-8}
    errors = [rj.compare(truth, rj.simulate(rom, TS, **settings)).error]
    for spin, tilt in HELD_OUT:
        q, v = turned_about_the_origin(system, spin, tilt)
        other = rj.simulate(system, TS, q0=q, v0=v, rtol=TIGHT)
        run = rj.simulate(rom.starting_at(q, v), TS, **settings)
        assert run.is_valid
        errors.append(rj.compare(other, run).error)
    assert errors[0] <= TRAINED, f"{errors[0]:.1e}"
    assert max(errors) <= PREDICTED * errors[0], f"{[f'{x:.1e}' for x in errors]}"


def test_counters_of_angles_beside_rigid_bodies():
    """Neither has modes, but they have different numbers of coordinates."""
    none, beam = jnp.zeros((0, 0)), jnp.array([[0.6], [0.8]])
    columns = [tuple(range(7)), (7,), tuple(range(8, 17)), tuple(range(17, 24))]
    bases = BodyBases.of([none, none, beam, none], [none, none, jnp.eye(2), none], columns)
    z = jnp.arange(1.0, 24.0)
    q = bases.expand(z)
    wanted = jnp.concatenate([z[:15], beam[:, 0] * z[15], z[16:]])
    assert_close(q, wanted, IDENTITY, z[-1])
    assert_close(bases.project(q), z, IDENTITY, z[-1])
