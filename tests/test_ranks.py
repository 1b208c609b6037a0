"""Ranks that do not move: with the sample rate, the solver's noise, the precision."""

import functools

import jax
import numpy as np
import pytest
import zoo
from groups import in_groups
from tolerances import IDENTITY, SOLVED

import romjax as rj

# Sample rates 3 kHz and 100 Hz, as every so many-th of the finest.
STRIDES = (1, 30)
# In fast tests 500 Hz, with the program of other runs, and 100 Hz.
QUICK, QUICK_STRIDES = 500, (1, 5)
TOLERANCES = (1e-3, 1e-5, 1e-6, 1e-8)
# Of the smooth orthogonal decomposition of exact snapshots.
EXACT = [3, 4, 5, 6]
# What the tolerance of the simulation leaves of them: the rest is below its errors.
CERTAIN = {1e-5: [3, 4, 4, 4], 1e-8: EXACT, 1e-12: EXACT}
# How far the values at 100 Hz may be from those at 3 kHz.
SAMPLED = 2e-3


@functools.cache
def second(rtol, hertz=3_000) -> rj.Trajectory:
    """The chapter's second at a sample rate."""
    ts = np.linspace(0.0, 1.0, hertz + 1)
    return zoo.run(zoo.system(zoo.cart_pendulum), ts, rtol=rtol, solver=zoo.RODAS5P)


def ranks(decompose, motion) -> list[int]:
    return [decompose(motion, tol=tol).rank for tol in TOLERANCES]


@pytest.mark.slow
@pytest.mark.parametrize("rtol", CERTAIN)
@pytest.mark.parametrize("decompose", [rj.pod, rj.sod])
def test_no_rank_moves_with_the_sample_rate(decompose, rtol):
    """The chapter's rank depends on the sample rate; here none does, whatever the accuracy of the
    snapshots.
    """
    found = [ranks(decompose, second(rtol).every(stride)) for stride in STRIDES]
    assert all(rank == found[0] for rank in found)


@pytest.mark.parametrize("rtol", in_groups(CERTAIN, fast=(1e-8,), slow=(1e-5, 1e-12)))
def test_what_the_integration_hides_does_not_count(rtol):
    assert ranks(rj.sod, second(rtol, QUICK)) == CERTAIN[rtol]


@pytest.mark.slow
def test_the_reason_names_what_decided():
    assert "tolerance 0.001" in rj.sod(second(1e-8), tol=1e-3).summary
    assert "integration errors" in rj.sod(second(1e-8), tol=1e-8).summary
    assert "1 of them below integration errors" in rj.sod(second(2e-8), rank=6).summary
    assert "drop point" in rj.pod(second(1e-12)).summary


def test_the_values_do_not_move_either():
    """The largest value of the velocities, and the frequencies of the smooth modes. At 100 Hz the
    trapezoidal rule is 0.15 % off, but at rtol = 1e-8 the third frequency by 2 %.
    """
    found = [rj.sod(second(1e-10, QUICK).every(stride), rank=3) for stride in QUICK_STRIDES]
    assert np.ptp([basis.spectrum[0] for basis in found]) <= SAMPLED * found[0].spectrum[0]
    hertz = [1 / (2 * np.pi * np.sqrt(basis.values[2])) for basis in found]
    assert np.ptp(hertz) <= SAMPLED * hertz[0]


def test_the_naive_rank_is_decided_by_rounding():
    """The chapter's generalised SVD counts, or does not, a mode that moves by less than 2e-15 m in
    both of these mechanisms. R-SOD does not.
    """
    found = {}
    for f2 in (4e6, 1e8):
        system = rj.assemble(rj.gallery.cart_pendulum(f2=f2))
        motion = zoo.run(system, np.linspace(0.0, 1.0, 101), rtol=1e-8, solver=zoo.RODAS5P)
        assert np.max(np.abs(np.asarray(motion.q)[:, 7])) <= 2e-15
        naive = rj.naive_sod(motion)
        assert np.all(np.diff(naive.values) <= 0)
        shares, *_ = np.linalg.lstsq(naive.modes, motion.q.T, rcond=1e-14)  # the modes span it
        assert np.max(np.abs(naive.modes @ shares - motion.q.T)) <= IDENTITY
        found[f2] = naive.rank, ranks(rj.sod, motion)[:3]
    assert [naive for naive, _ in found.values()] == [6, 5]
    assert all(robust == [3, 4, 5] for _, robust in found.values())


@pytest.mark.slow
def test_single_precision_keeps_the_ranks():
    """As in double precision down to its floor, 1e-6, at every sample rate."""
    with jax.enable_x64(False):
        system = rj.assemble(rj.gallery.cart_pendulum())
        with pytest.warns(UserWarning, match="single precision"):
            motion = rj.simulate(
                system,
                np.linspace(0, 1, 3_001),
                dt=2e-4,
                solver=zoo.RODAS5P,
                audit=False,
            )
        for stride in STRIDES:
            assert ranks(rj.sod, motion.every(stride))[:3] == EXACT[:3]
            assert "rounding of 1.0e-06" in rj.sod(motion.every(stride), tol=1e-8).summary


def test_the_gram_matrix_gives_the_same():
    """Chapter equations 39.9 and 39.10, with more snapshots than coordinates and with fewer."""
    few = second(1e-8, QUICK).every(83)
    for motion, rank in ((second(1e-8, QUICK).every(5), 4), (few, 4)):
        direct, squared = (rj.pod(motion, rank=rank, method=m) for m in ("svd", "gram"))
        values, others = (np.asarray(x.values)[:rank] for x in (direct, squared))
        assert np.max(np.abs(values - others)) <= SOLVED / 10 * values[0]
        assert angle(motion, direct, squared) <= SOLVED / 10
    assert len(few.t) < few.q.shape[1]


@pytest.mark.slow
def test_a_stream_gives_the_same():
    """In one pass over blocks, with all directions kept and with seven of eight."""
    motion = second(1e-12).every(3)
    direct = rj.pod(motion, rank=4)
    for most in (None, 7):
        stream = rj.PodStream.start(motion.metric, motion.q[0], most)
        for block in range(0, len(motion.t), 143):  # seven of them
            part = slice(block, block + 143)
            stream = stream.add(*(np.asarray(x)[part] for x in (motion.t, motion.q, motion.v)))
        basis = stream.basis(rank=4)
        assert stream.factor.shape == (8, most or 8)
        assert len(basis.snapshots.t) <= 400
        values, others = (np.asarray(x.values)[:4] for x in (direct, basis))
        assert np.max(np.abs(values - others)) <= SOLVED / 10 * values[0]
        assert angle(motion, direct, basis) <= SOLVED / 10
        assert abs(basis.projection_error - direct.projection_error) <= SOLVED / 10


def angle(motion, one, other) -> float:
    """Sine of the largest angle between two subspaces, in the energy norm."""
    a, b, metric = (np.asarray(x) for x in (one.modes, other.modes, motion.metric))
    missed = b - a @ (a.T @ metric @ b)
    return float(np.linalg.norm(np.linalg.cholesky(metric).T @ missed, 2))
