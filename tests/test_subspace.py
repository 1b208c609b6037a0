"""Leading singular subspaces of difficult matrices, and their derivatives."""

import functools
import itertools
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax.basis.subspace import leading, singular_values

# Singular values: repeated, clustered, zero, and all of these.
SPECTRA = {
    "distinct": [3, 2, 1, 0.5, 0.2],
    "repeated": [2, 2, 2, 1, 1],
    "clustered": [2, 2 * (1 + 1e-12), 1, 1e-3, 1e-3 * (1 + 1e-9)],
    "zero": [2, 1, 0.5, 0, 0],
    "repeated and zero": [2, 2, 1, 0, 0],
}
# A relation between the derivative and what a gap of 0.5 of the values divides by.
REPEATED = {jnp.float64: 1e-8, jnp.float32: 1e-3}
SHAPES = [(5, 40), (5, 5), (12, 5)]


def matrix(shape, spectrum, seed=0):
    rng = np.random.default_rng(seed)
    rows, columns = shape
    size = len(spectrum)
    left, _ = np.linalg.qr(rng.normal(size=(rows, size)))
    right, _ = np.linalg.qr(rng.normal(size=(columns, size)))
    return left * np.sort(spectrum)[::-1] @ right.T


def share(a, rank, method="svd"):
    """A function of the subspace only: what it holds of two fixed vectors."""
    vectors, _ = leading(a, rank, method)
    x, y = held(a.shape[0])
    return (vectors.T @ x.astype(a.dtype)) @ (vectors.T @ y.astype(a.dtype))


def held(size):
    return np.cos(np.arange(size)), np.sin(1.0 + np.arange(size) ** 2)


@functools.partial(jax.jit, static_argnums=(2, 3))
def derivatives(a, change, rank=3, method="svd"):
    """The share, its gradient, and its change in forward mode."""
    _, forward = jax.jvp(lambda a: share(a, rank, method), (a,), (change,))
    return *jax.value_and_grad(share)(a, rank, method), forward


@pytest.mark.parametrize("method", ["svd", "gram"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("spectrum", SPECTRA)
def test_orthonormal_and_optimal(shape, spectrum, method):
    """Eckart and Young: what a subspace of r columns misses is the root of the sum of the squares
    of the singular values that follow.
    """
    a = matrix(shape, SPECTRA[spectrum])
    for rank in (1, 2, 3):
        vectors = np.asarray(leading(jax.device_put(a), rank, method)[0])
        assert np.max(np.abs(vectors.T @ vectors - np.eye(rank))) <= IDENTITY
        missed = np.linalg.norm(a - vectors @ (vectors.T @ a))
        least = np.linalg.norm(np.sort(SPECTRA[spectrum])[::-1][rank:])
        assert abs(missed - least) <= IDENTITY * np.linalg.norm(a)


def test_many_snapshots_need_no_square_of_their_number():
    """Memory is that of some copies of the snapshots; their number squared would be 80 GB."""
    many = np.zeros((3, 100_000))
    memory = singular_values.compiled(many).memory_analysis()
    assert memory.temp_size_in_bytes < 10 * many.nbytes


@pytest.mark.parametrize("method", ["svd", "gram"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("spectrum", ["distinct", "repeated", "zero"])
def test_derivatives_of_subspaces(shape, spectrum, method):
    """Against central differences: with repeated values among the kept and among the
    dropped ones, and with fewer columns than rows.
    """
    a, change = matrix(shape, SPECTRA[spectrum]), matrix(shape, [1] * 5, seed=1)
    step = 1e-5
    above, below = (float(derivatives(a + x * change, change)[0]) for x in (step, -step))
    wanted = (above - below) / (2 * step)
    _, gradient, forward = derivatives(a, change, 3, method)
    found = np.vdot(gradient, change)
    assert abs(found - wanted) <= DIFFERENCED / 100
    assert abs(found - forward) <= IDENTITY


@pytest.mark.parametrize("kind", REPEATED)
@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-6])
def test_kept_values_that_repeat(kind, gap):
    """`jnp.linalg.svd` gives NaN, or a derivative that is wrong by 6 % in silence. Against the
    projector's derivative in closed form, which knows no kept gaps.
    """
    a = matrix((6, 6), [2 * (1 + gap), 2, 1, 0.8, 0.3, 0.1])
    change = matrix((6, 6), [1] * 6, seed=1)
    u, s, vt = np.linalg.svd(a)
    inside = u.T @ change @ vt.T
    turned = inside[2:, :2] * s[:2] + s[2:, None] * inside[:2, 2:].T
    lift = u[:, 2:] @ (turned / (s[:2] ** 2 - s[2:, None] ** 2)) @ u[:, :2].T
    x, y = held(6)
    wanted = x @ (lift + lift.T) @ y
    *_, found = derivatives(a.astype(kind), change.astype(kind), 2)
    assert abs(found - wanted) <= REPEATED[kind]


@pytest.mark.slow
@given(
    st.sampled_from([2, 7]),
    st.sampled_from([3, 9]),
    st.lists(st.sampled_from([0, 0, 1, 1, 2, 5]), min_size=63, max_size=63),
    st.sampled_from([np.int64, np.float32, np.float64]),
)
@settings(max_examples=15, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
def test_bases_of_any_snapshots(rows, columns, numbers, kind):
    """Integers with zero rows, duplicate columns and few snapshots: modes are orthonormal, miss
    what they must, and have finite derivatives.
    """
    q = np.array(numbers[: rows * columns], kind).reshape(columns, rows)
    motion = Recorded(q)
    moved = (q - q[:1]) * np.sqrt(motion.weights)[:, None]
    spectrum = np.linalg.svd(moved, compute_uv=False)
    if not spectrum[0] > 0:
        with pytest.raises(ValueError, match="do not move"):
            rj.pod(motion)
        return
    single = kind == np.float32
    exact = 1e-5 if single else IDENTITY
    for rank in range(1, 1 + int(np.sum(spectrum > 1e-5 * spectrum[0]))):
        basis = rj.pod(motion, rank=rank)
        assert np.max(np.abs(basis.modes.T @ basis.modes - np.eye(rank))) <= exact
        least = np.linalg.norm(spectrum[rank:]) / np.linalg.norm(spectrum)
        # The projection error is a root of a sum of squares: rounding of 1 is 1e-8 of it.
        assert abs(basis.projection_error - least) <= (1e-3 if single else 1e-7)

        def missed(x, rank=rank):
            return rj.pod(Recorded(x), rank=rank).projection_error ** 2

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            assert np.all(np.isfinite(jax.grad(missed)(jnp.asarray(q, float))))
            jax.effects_barrier()


class Recorded:
    """Snapshots at whole seconds in coordinates of unit mass."""

    def __init__(self, q):
        self.q, self.v = q, q
        self.t = np.arange(len(q)).astype(float)
        self.metric = np.eye(q.shape[1])
        self.labels = ("x",) * q.shape[1]
        step = np.diff(self.t)
        self.weights = 0.5 * (np.append(step, 0) + np.append(0, step))


def test_a_close_pair_is_warned_of():
    """The derivative grows without bound as the first dropped value nears the last kept one."""

    def size(ratio):
        a = matrix((5, 5), [4, 2, 1, ratio, 0.1])
        found = np.linalg.norm(derivatives(a, a)[1])
        jax.effects_barrier()
        return found

    sizes = [size(0.5), size(0.8)]
    with pytest.warns(UserWarning, match="ill-determined"):
        sizes.append(size(0.99))
    assert all(less < more for less, more in itertools.pairwise(sizes))


@pytest.mark.parametrize("decompose", [rj.pod, rj.sod, functools.partial(rj.sod, compress="rank")])
def test_derivatives_of_bases(decompose):
    """Through weights, metric and decomposition, to what a basis holds of a vector, with fewer
    snapshots than coordinates (five, eight).
    """
    rng = np.random.default_rng(5)
    q, change = rng.normal(size=(5, 8)), rng.normal(size=(5, 8))

    @jax.jit
    @jax.value_and_grad
    def held(s):
        motion = Recorded(q)
        motion.q = jnp.asarray(q + s * change)
        motion.v = jnp.asarray(np.roll(q, 1, axis=1)) + s * jnp.asarray(change)
        motion.metric = (1 + s**2) * jnp.diag(jnp.arange(1.0, 9.0))
        basis = decompose(motion, rank=3)
        x = motion.metric @ jnp.cos(jnp.arange(8.0))
        return jnp.sum((basis.modes.T @ x) ** 2) + jnp.sum(basis.values[:3])

    step = 1e-5
    (below, _), (_, found), (above, _) = (held(0.3 + x) for x in (-step, 0.0, step))
    wanted = (float(above) - float(below)) / (2 * step)
    assert abs(found - wanted) <= SOLVED * 10 * abs(wanted)
