"""Minimal coordinates: which subspace the modes span, and how modes are made for it."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import IDENTITY
from zoo import run

import romjax as rj

RANK = 3
# Of the cart-pendulum in one second: what POD's modes err at most, and what random ones at least
# (they err by 4 % and more).
ERROR, WORSE = 1e-6, 1e-2
# What modes of the independent coordinates err at most of what modes of all coordinates do.
SHARE = 0.5


def error_of(rom, motion) -> float:
    return float(rj.compare(motion, run(rom, motion.t, rtol=1e-8, throw=False)).error)


@pytest.fixture(scope="module")
def bases(cart_pendulum, truth):
    """Modes of all coordinates, of the independent ones, and at random."""
    every = rj.pod(truth, rank=RANK)
    random = np.random.default_rng(7).normal(size=every.modes.shape)
    return {
        "every": every,
        "independent": rj.Minimal().basis(cart_pendulum, truth, rj.POD(RANK)),
        "random": eqx.tree_at(lambda basis: basis.modes, every, jnp.asarray(random)),
    }


def projector(columns) -> np.ndarray:
    q, _ = np.linalg.qr(np.asarray(columns))
    return q @ q.T


def largest(x) -> float:
    return float(np.max(np.abs(x)))


@eqx.filter_jit
def tangent_of(rom):
    """G at the start."""
    return rom.state(0.0, rom.q0, rom.v0).motion.tangent


@eqx.filter_jit
def rows_of(system, q):
    return system.state(0.0, q, 0 * q).jacobian()


@pytest.mark.parametrize("name", ["every", "independent", "random"])
def test_minimal_coordinates_span_what_the_modes_span(cart_pendulum, bases, name):
    """Read in the independent coordinates, the tangent and the modes are one subspace."""
    modes = np.asarray(bases[name].modes)
    rom = rj.reduce(cart_pendulum, bases[name], "minimal")
    read = np.asarray(rom.lift.chart.read)
    assert rom.n == np.linalg.matrix_rank(read @ modes) == RANK
    tangent = np.asarray(tangent_of(rom))
    apart = largest(projector(read @ tangent) - projector(read @ modes))
    assert apart <= IDENTITY * np.linalg.cond(read @ modes), f"subspaces part: {apart}"


def test_random_modes_make_a_worse_model(cart_pendulum, bases, truth):
    """Modes decide the minimal model, not the snapshots that came with them."""
    errors = {
        name: error_of(rj.reduce(cart_pendulum, basis, "minimal"), truth)
        for name, basis in bases.items()
    }
    assert errors["every"] <= ERROR, errors
    assert errors["independent"] <= ERROR, errors
    assert errors["random"] >= WORSE, errors


def test_modes_of_independent_coordinates(cart_pendulum, bases, truth):
    """They are tangent to the constraints, orthonormal by mass, and read in the independent
    coordinates those of a singular value decomposition there, by NumPy.
    """
    basis = bases["independent"]
    modes, metric, q = (np.asarray(x) for x in (basis.modes, truth.metric, truth.q))
    read = np.asarray(rj.reduce(cart_pendulum, basis, "minimal").lift.chart.read)
    rows = np.asarray(rows_of(cart_pendulum, q[0]))
    assert largest(rows @ modes) <= IDENTITY * largest(rows) * largest(modes)
    assert largest(modes.T @ metric @ modes - np.eye(RANK)) <= IDENTITY * np.linalg.cond(metric)
    assert largest(np.asarray(basis.snapshots.q) - q) == 0
    tangent = np.linalg.svd(rows)[2][len(rows) :].T
    tangent = tangent @ np.linalg.inv(read @ tangent)  # ∂q/∂s
    root = np.linalg.cholesky(tangent.T @ metric @ tangent).T
    s = (q - q[0]) @ read.T
    weights = np.full(len(s), 1.0)
    weights[[0, -1]] = 0.5  # the trapezoidal rule
    _, sizes, right = np.linalg.svd(np.sqrt(weights)[:, None] * s @ root.T)
    exact = np.linalg.solve(root, right[:RANK].T)
    bound = IDENTITY * sizes[0] / (sizes[RANK - 1] - sizes[RANK])
    apart = largest(projector(root @ read @ modes) - projector(root @ exact))
    assert apart <= bound, f"{apart:.1e}, {bound:.1e}"


@pytest.mark.slow
def test_no_mode_is_spent_on_curvature():
    """A pendulum that bends, as bars hinged by springs: it swings far, and bends little."""
    count = 8
    size = 1 / count
    bars = [
        rj.RigidBody(f"bar{i}", size, size**3 / 12, ((i + 0.5) * size, 0.0)) for i in range(count)
    ]
    ends = [rj.ground.at(), *(bar.at((size / 2, 0.0)) for bar in bars)]
    heads = [bar.at((-size / 2, 0.0)) for bar in bars]
    pairs = list(zip(heads, ends, strict=False))
    bending = [rj.TorsionSpring(*pair, stiffness=count) for pair in pairs[1:]]
    scene = rj.Scene(bars, [rj.Revolute(*pair) for pair in pairs], [rj.Gravity(), *bending])
    system = rj.assemble(scene)
    motion = run(system, np.linspace(0.0, 1.0, 101))
    minimal = rj.Minimal()
    every = error_of(rj.reduce(system, rj.pod(motion, rank=3), minimal), motion)
    basis = minimal.basis(system, motion, rj.POD(3))
    independent = error_of(rj.reduce(system, basis, minimal), motion)
    assert independent <= SHARE * every, f"{independent:.1e}, {every:.1e}"
