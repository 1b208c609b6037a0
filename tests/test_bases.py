"""Bases of one's own: given modes, and decompositions that the package does not have."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from programs import compilations
from tolerances import DIFFERENCED, IDENTITY

import romjax as rj
from romjax import plot
from romjax.basis.basis import Directions, RankCriterion, ValueLabel
from romjax.basis.subspace import leading, singular_values
from romjax.common import precision

# Of a run of the five-bar linkage with eight modes for its twelve coordinates.
REDUCED = 1e-3


def gram(basis):
    modes = np.asarray(basis.modes)
    return modes.T @ np.asarray(basis.snapshots.metric) @ modes


def random(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape)


def positive(n, seed=1):
    root = random(n, n, seed=seed)
    return root @ root.T + n * np.eye(n)


def projector(modes):
    """Onto the span of the columns, which does not depend on how they are scaled or mixed."""
    modes = np.asarray(modes)
    return modes @ np.linalg.pinv(modes)


@pytest.fixture(scope="module")
def truth():
    return zoo.motion(zoo.cart_pendulum)


# Given modes.


def test_given_modes_are_made_orthonormal():
    """Of columns twice and three times as long as units, the Gram matrix was diag(4, 9)."""
    basis = rj.Basis.from_modes(np.array([[2.0, 0.0], [0.0, 3.0], [0.0, 0.0]]), np.zeros(3))
    np.testing.assert_allclose(gram(basis), np.eye(2), atol=IDENTITY)


@pytest.mark.parametrize("metric", [None, positive(6)], ids=["identity", "metric"])
def test_given_modes_keep_their_span_and_directions(metric):
    modes, offset = random(6, 3), random(6)
    basis = rj.Basis.from_modes(modes, offset, metric)
    np.testing.assert_allclose(gram(basis), np.eye(3), atol=IDENTITY)
    np.testing.assert_allclose(projector(basis.modes), projector(modes), atol=IDENTITY)
    np.testing.assert_allclose(
        projector(np.asarray(basis.modes)[:, :2]), projector(modes[:, :2]), atol=IDENTITY
    )
    again = rj.Basis.from_modes(basis.modes, offset, metric)
    np.testing.assert_allclose(again.modes, basis.modes, atol=IDENTITY)


def test_another_metric(truth):
    """The system's own, of modes that were given without one: span and snapshots stay."""
    basis = rj.pod(truth, rank=3)
    metric = positive(8)
    other = basis.orthonormalised(metric)
    np.testing.assert_allclose(gram(other), np.eye(3), atol=IDENTITY)
    np.testing.assert_allclose(projector(other.modes), projector(basis.modes), atol=IDENTITY)
    np.testing.assert_array_equal(other.snapshots.q, basis.snapshots.q)
    # The coordinates are the nearest ones in the new metric.
    root = np.linalg.cholesky(metric).T
    displacements = np.subtract(truth.q, basis.offset) @ root.T
    wanted = np.linalg.lstsq(root @ np.asarray(other.modes), displacements.T, rcond=None)[0].T
    np.testing.assert_allclose(other.coordinates, wanted, atol=IDENTITY)


def test_given_modes_differentiate():
    """Under jit, against central differences."""
    modes, change, metric = random(5, 2), random(5, 2, seed=2), positive(5)
    x = random(5, seed=3)

    @jax.jit
    @jax.value_and_grad
    def held(s):
        basis = rj.Basis.from_modes(modes + s * change, jnp.zeros(5), (1 + s) * metric)
        return jnp.sum((basis.modes.T @ x) ** 2) + basis.modes[0, 1]

    step = 1e-5
    (below, _), (_, found), (above, _) = (held(0.1 + by) for by in (-step, 0.0, step))
    wanted = (float(above) - float(below)) / (2 * step)
    np.testing.assert_allclose(found, wanted, atol=DIFFERENCED / 100)


WRONG = {
    "dependent columns": (
        {"modes": [[1.0, 2.0], [1.0, 2.0], [0.0, 0.0]]},
        "mode 2 of 2 lies in the span of those before it.*independent columns",
    ),
    "a column of zeros": ({"modes": [[0.0], [0.0], [0.0]]}, "mode 1 of 1 is zero"),
    "a column that is not finite": (
        {"modes": [[1.0, 0.0], [0.0, float("nan")], [0.0, 0.0]]},
        "mode 2 of 2 is not finite",
    ),
    "a metric of another size": ({"metric": np.eye(2)}, r"metric has shape \(2, 2\).*\(3, 3\)"),
    "a metric that is not positive": (
        {"metric": np.diag([1.0, 0.0, -1.0])},
        "metric is not positive definite; give a mass matrix",
    ),
}


@pytest.mark.parametrize(("changes", "words"), WRONG.values(), ids=WRONG)
def test_modes_that_make_no_basis(changes, words):
    given = {"modes": [[1.0], [1.0], [0.0]], "offset": np.zeros(3)} | changes
    with pytest.raises(rj.InputError, match=words):
        rj.Basis.from_modes(**given)


def test_units_do_not_make_columns_dependent():
    """A column of micrometres is as good as one of kilometres."""
    modes = np.array([[1e3, 1.0], [0.0, 1e-6], [0.0, 0.0]])
    basis = rj.Basis.from_modes(modes, np.zeros(3))
    np.testing.assert_allclose(np.abs(basis.modes), np.eye(3, 2), atol=IDENTITY)


# Decompositions.


@pytest.mark.parametrize(
    ("make", "function"), [(rj.POD, rj.pod), (rj.SOD, rj.sod)], ids=["POD", "SOD"]
)
def test_a_decomposition_is_an_object(truth, make, function):
    """Which the functions are one line of, and which a basis holds."""
    for settings in ({}, {"rank": 3}, {"tol": 1e-3}):
        one, other = make(**settings)(truth), function(truth, **settings)
        np.testing.assert_array_equal(one.modes, other.modes)
        assert one.summary == other.summary
        assert one.decomposition.rank == settings.get("rank")
        assert one.name == make.name == function.__name__.upper()
    again = one.decomposition.with_rank(2, truth.q[0])(truth)
    np.testing.assert_array_equal(again.modes, function(truth, rank=2).modes)


class VelocityPOD(rj.AbstractDecomposition):
    """Proper orthogonal directions of the velocities; its values are energies."""

    rank: int | None = eqx.field(static=True, default=None)
    tol: Any = None
    offset: Any = None

    name: ClassVar[str] = "velocity POD"
    value_label: ClassVar[ValueLabel] = ValueLabel("Kinetic energies", "E", "J s")

    def criterion(self, snapshots):
        values = singular_values(snapshots.velocities)
        return RankCriterion(
            values, precision.of(values.dtype).singular_values, snapshots.noise.velocities
        )

    def directions(self, snapshots, rank):
        vectors, values = leading(snapshots.velocities, rank)
        return Directions(vectors, 0.5 * values**2, values)


def test_coordinates_are_described_in_words():
    """A plate's mode is no bending mode; motions from elsewhere have labels, or nothing."""
    beam = rj.Beam("beam", mass=1.0, length=1.0, frequencies=[5.0, 20.0], amplitudes=(0.0, 0.1))
    plate = rj.ModalBody(
        "plate", rj.Inertia(1.0, 0.1), [4.0], [[0.0, 0.0]], np.zeros((1, 3, 1)), amplitudes=[1e-6]
    )
    system = rj.assemble(rj.Scene([beam, plate]))
    t = np.linspace(0.0, 0.1, 21)
    # The second mode of the beam swings, and so does that of the plate, hardly.
    q, v = (np.tile(x, (len(t), 1)) for x in (system.q0, system.v0))
    for i, omega, size in ((4, 40 * np.pi, 0.1), (8, 8 * np.pi, 1e-6)):
        q[:, i], v[:, i] = size * np.cos(omega * t), -size * omega * np.sin(omega * t)
    words = tuple(x.description or x.label for x in system.structure.coordinates)
    run = Measured(t, q, v, np.diag(np.arange(1.0, 10.0)), system.structure.labels)
    run.descriptions = words
    words = rj.describe(rj.pod(run, rank=1))
    assert "of bending mode 2 of beam all but" in words
    assert "Dropped: mode 1 of plate, because" in words
    assert "At rest: position x of beam, " in words
    assert words.endswith("angle of plate.")
    del run.descriptions
    assert "Dropped: plate.q1, because" in rj.describe(rj.pod(run, rank=1))
    run.labels = ()
    assert "Dropped: coordinate 9, because" in rj.describe(rj.pod(run, rank=1))


def test_names_of_coordinates_compile_nothing(truth):
    """Snapshots in another coordinates' names are weighted by the program that there is."""
    rj.pod(truth, rank=5)
    names = tuple(f"u{i}" for i in range(truth.q.shape[1]))
    renamed = Measured(truth.t, truth.q, truth.v, truth.metric, names, truth.noise)
    assert compilations(lambda: rj.pod(renamed, rank=5)) == 0


class Measured:
    """What every motion has, and names."""

    def __init__(self, t, q, v, metric, labels, noise=lambda: (0.0, 0.0)):
        self.t, self.q, self.v, self.metric = t, q, v, metric
        self.labels = labels
        self.noise = noise


def test_a_new_decomposition_is_described_and_drawn(truth):
    basis = VelocityPOD(rank=5)(truth)
    np.testing.assert_allclose(gram(basis), np.eye(5), atol=IDENTITY)
    words = rj.describe(basis)
    assert words.startswith("velocity POD, rank 5: as asked")
    assert "of bending mode 2 of pendulum all but" in words
    figure = plot.values(rj.pod(truth, rank=5), basis, rj.sod(truth, rank=5), VelocityPOD(3)(truth))
    titles = ["Singular values", "Kinetic energies", "Smooth orthogonal values"]
    assert [axes.get_title() for axes in figure.axes] == titles
    names = [[t.get_text() for t in axes.get_legend().get_texts()] for axes in figure.axes]
    assert names[1:] == [["velocity POD 1", "velocity POD 2"], ["SOD"]]
    assert figure.axes[1].get_ylabel() == "$E_i$ [J s]"
    figure = plot.modes(rj.gallery.cart_pendulum(), basis)
    assert figure.get_suptitle() == "velocity POD modes"
    energy = f"{float(basis.values[0]):.2g}"
    assert figure.axes[0].get_title() == f"mode 1\n$E$ = {energy} J s"


@pytest.mark.slow
def test_a_new_decomposition_reduces():
    """And nothing speaks against the run but what eight modes leave out."""
    motion = zoo.motion(zoo.five_bar)
    rom = rj.reduce(motion.system, VelocityPOD(8)(motion))
    run = zoo.run(rom, motion.t)
    error = float(rj.compare(motion, run).error)
    assert error <= REDUCED, f"error {error:.2e}"
    assert run.flags == rj.Flag.LEFT_OUT
    words = run.warnings()
    limits = "more than 100 rtol, and 1e-4, or by a tenth of how one body moves or bends"
    assert f"{limits}, on the motions that it was made of" in words


def test_the_rank_that_snapshots_do_not_allow_has_an_error_of_its_own(truth):
    for decomposition in (rj.POD(9), rj.SOD(9), VelocityPOD(9)):
        with pytest.raises(rj.RankError, match=f"{decomposition.name}: rank=9, but .* allow 1 to"):
            decomposition(truth)
    with pytest.raises(rj.InputError) as refusal:
        rj.pod(truth, rank="best")
    assert not isinstance(refusal.value, rj.RankError)


# Names of the release before.
