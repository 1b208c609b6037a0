"""The chapter's reduction of the cart-pendulum: ranks, kept constraints, errors."""

import itertools

import diffrax
import jax
import jax.numpy as jnp
import mechanics
import numpy as np
import pytest
from comparison import assert_close
from tolerances import IDENTITY, SOLVED
from zoo import TIGHT

import romjax as rj
from romjax.basis.rank import choose_rank

# Required of the reduced models, against a full run at the same tight tolerance.
ERROR_SIX = 1e-8
ERROR_FIVE = 2e-6
# Required of the drop point: how far the sixth value stands above the seventh.
DROP = 1e4
# The chapter's formulation at five modes is worse by more than this.
WORSE = 10
# Required of the energy of a reduced model, relative to the kinetic range; and the chapter's way.
REDUCED_ENERGY, LOST = 1e-8, 0.1
# Singular values are those of an integral over time, here by the trapezoidal rule at 100 and at
# 300 Hz: the motion has 10 Hz, so its error is (2π 10/100)²/12 = 3 % of what does not average out.
SAMPLED = 0.03


@pytest.fixture(scope="module")
def coarse(truth):
    """The snapshots at the chapter's 100 Hz."""
    return truth.every(3)


@pytest.fixture(scope="module")
def error(truth, cart_pendulum, coarse):
    """Errors of reduced models by rank and formulation, each simulated once."""
    known = {}

    def of(rank, formulation):
        if (rank, formulation) not in known:
            rom = rj.reduce(cart_pendulum, rj.pod(coarse, rank=rank), formulation)
            # The balance of energy tells of projected models, and has nothing to say of others.
            audit = formulation == "projected"
            approx = rj.simulate(rom, truth.t, rtol=TIGHT, audit=audit)
            known[rank, formulation] = rom, rj.compare(truth, approx)
        return known[rank, formulation]

    return of


def test_size(cart_pendulum):
    assert (cart_pendulum.n, cart_pendulum.m) == (8, 4)


def test_drop_point(coarse):
    """Six directions stand out, as in the chapter; what follows is rounding."""
    basis = rj.pod(coarse)
    assert basis.rank == 6
    assert "drop point" in basis.summary
    assert basis.values[5] / basis.values[6] >= DROP


def test_values_fall(coarse):
    for basis in (rj.pod(coarse), rj.sod(coarse)):
        assert jnp.all(basis.values >= 0)
        assert jnp.all(jnp.diff(basis.values) <= 0)
        assert jnp.all(jnp.isfinite(basis.values))


@pytest.mark.parametrize("decompose", [rj.pod, rj.sod])
def test_modes_are_orthonormal_in_the_mass_metric(coarse, decompose):
    """ΦᵀM₀Φ = I; the light pendulum's modes are large, so relative to the size of the terms."""
    basis = decompose(coarse, rank=5)
    gram = basis.modes.T @ coarse.metric @ basis.modes
    assert_close(gram, jnp.eye(5), IDENTITY)


@pytest.mark.parametrize("tol", [1e-3, 1e-5])
@pytest.mark.parametrize("decompose", [rj.pod, rj.sod])
def test_rank_does_not_depend_on_the_sample_rate(truth, coarse, decompose, tol):
    """The chapter's rank of the SOD flips between 100 and 300 Hz; here it stays."""
    assert decompose(coarse, tol=tol).rank == decompose(truth, tol=tol).rank


def test_values_do_not_depend_on_the_sample_rate(truth, coarse):
    """They approximate an integral over time. Unweighted ones would grow by √3."""
    for fine, rough in zip(rj.pod(truth).values[:3], rj.pod(coarse).values[:3], strict=True):
        assert_close(rough, fine, SAMPLED, fine)


def test_all_smooth_modes_span_the_velocities(coarse):
    """span(SOM) = span(POD of the velocities), with the rank that the velocities have."""
    smooth = rj.sod(coarse, rank=6)
    root = np.linalg.cholesky(coarse.metric).T
    step = np.diff(coarse.t)
    weights = 0.5 * (np.append(step, 0) + np.append(0, step))
    vectors, *_ = np.linalg.svd(root @ (coarse.v * np.sqrt(weights)[:, None]).T)
    modes = root @ smooth.modes
    missed = modes - vectors[:, :6] @ (vectors[:, :6].T @ modes)
    assert_close(missed, 0.0, SOLVED)


def test_coordinates_that_rest(coarse):
    """The cart's angle never moves: no rank comes from it, no mode contains it, and the errors
    (equation 39.17 divides by its largest motion) stay finite.
    """
    for decompose in (rj.pod, rj.sod):
        assert_close(decompose(coarse, rank=5).modes[2], 0.0, IDENTITY)
    report = rj.compare(coarse, coarse)
    assert jnp.all(jnp.isfinite(report.per_coordinate))
    assert not report.moving[2]
    assert report.moving[0]


def test_more_modes_miss_less(coarse):
    errors = [rj.pod(coarse, rank=rank).projection_error for rank in (2, 3, 4, 5)]
    assert all(less < more for more, less in itertools.pairwise(errors))


@pytest.mark.slow
def test_smooth_modes_after_two_compressions(truth, cart_pendulum, coarse):
    """The smoothest five of all serve better than POD's; those of five directions of the
    velocities alone, the chapter's, worse.
    """
    errors = {}
    for name, basis in {
        "POD": rj.pod(coarse, rank=5),
        "noise": rj.sod(coarse, rank=5),
        "rank": rj.sod(coarse, rank=5, compress="rank"),
    }.items():
        run = rj.simulate(rj.reduce(cart_pendulum, basis), truth.t, rtol=TIGHT, audit=False)
        errors[name] = rj.compare(truth, run).error
    assert errors["noise"] < errors["POD"] < ERROR_FIVE < errors["rank"]


@pytest.mark.slow
def test_six_modes(error):
    """Two of the four constraints are kept: the other two hold in the whole subspace."""
    rom, report = error(6, "galerkin")
    assert (rom.n, rom.m) == (6, 2)
    assert rom.degrees_of_freedom == 4
    assert report.error <= ERROR_SIX
    assert report.drift <= ERROR_SIX


def test_five_modes(error):
    rom, report = error(5, "galerkin")
    assert (rom.n, rom.m) == (5, 2)
    assert report.error <= ERROR_FIVE


@pytest.mark.slow
def test_the_chapters_formulation_is_worse(error):
    """Equation 39.6 to the letter projects the solution, not the equations: 2.6e-5 at five modes,
    against 4.3e-7 by d'Alembert's principle.
    """
    with pytest.warns(UserWarning, match="its energy changes by more than the work of the forces"):
        _, projected = error(5, "projected")
    _, galerkin = error(5, "galerkin")
    assert projected.error >= WORSE * galerkin.error
    assert projected.drift >= WORSE * galerkin.drift


@pytest.mark.slow
def test_a_full_basis_reproduces_the_full_run(truth, cart_pendulum):
    """Eight mass-orthonormal columns: the same mechanism in other coordinates."""
    factor = jnp.linalg.cholesky(truth.metric)
    rng = np.random.default_rng(8)
    turned, _ = np.linalg.qr(rng.normal(size=(8, 8)))
    basis = rj.Basis.from_modes(jnp.linalg.solve(factor.T, turned), cart_pendulum.q0)
    rom = rj.reduce(cart_pendulum, basis)
    assert rom.m == cart_pendulum.m
    approx = rj.simulate(rom, truth.t, rtol=TIGHT, audit=False)
    assert rj.compare(truth, approx).error <= SOLVED


def test_a_locked_basis_is_refused(cart_pendulum, coarse):
    """Four modes with two constraints leave two freedoms, where the motion uses three."""
    words = r"locks the mechanism. 2 constraints on its 4 modes.*constraints=1"
    with pytest.raises(rj.ReductionError, match=words):
        rj.reduce(cart_pendulum, rj.pod(coarse, rank=4), rj.Galerkin(constraints=2))


def test_zero_rows_change_nothing(coarse):
    """Coordinates that rest may be left out: the same modes, and zeros where they were."""
    keep = np.array([0, 1, 3, 4, 5, 6, 7])
    without = _Recorded(coarse, keep)
    for decompose in (rj.pod, rj.sod):
        whole, part = decompose(coarse, rank=5), decompose(without, rank=5)
        modes, others = np.asarray(whole.modes), np.asarray(part.modes)
        overlap = modes[keep].T @ without.metric @ others
        assert_close(overlap @ overlap.T, np.eye(5), SOLVED)


class _Recorded:
    """Some coordinates of a motion."""

    def __init__(self, motion, keep):
        q, v, metric = (np.asarray(x) for x in (motion.q, motion.v, motion.metric))
        self.t, self.q, self.v = motion.t, q[:, keep], v[:, keep]
        self.metric = metric[np.ix_(keep, keep)]
        self.labels = tuple(motion.labels[i] for i in keep)


def test_values_without_a_drop_keep_every_direction():
    """Values that fall evenly to the last have no drop point, wherever rounding would begin."""
    evenly = jnp.logspace(0, -7, 8)
    assert choose_rank("pod", evenly, "drop", None, 1e-12, jnp.zeros(())).rank == 8
    assert "no drop point" in choose_rank("pod", evenly, "drop", None, 1e-12, jnp.zeros(())).reason
    cliff = evenly.at[5:].multiply(1e-4)
    assert choose_rank("pod", cliff, "drop", None, 1e-12, jnp.zeros(())).rank == 5


@pytest.mark.exhaustive
def test_energy_of_a_reduced_model():
    """The free pendulum on the sprung cart, 20 s, five modes: Galerkin keeps the energy to
    1e-8 of the kinetic range. The chapter's projection of the solution does not.
    """
    forced = rj.gallery.cart_pendulum(stiffness=1000.0)
    scene = rj.Scene(forced.bodies, forced.joints, [forced.effects[0], rj.Gravity()])
    system = rj.assemble(scene)
    arm, angle = 0.4, 0.3
    hanging = jnp.array([arm * np.sin(angle), -arm * np.cos(angle), angle])
    q0, v0 = rj.consistent(system, system.q0.at[3:6].set(hanging), system.v0)
    training = rj.simulate(
        system, jnp.linspace(0.0, 2.0, 401), q0=q0, v0=v0, rtol=1e-9, solver=rj.Rodas5P()
    )
    basis = rj.pod(training, rank=5)
    ts = jnp.linspace(0.0, 20.0, 2001)

    def drift(formulation, **settings):
        rom = rj.reduce(system, basis, formulation=formulation)
        rest = jnp.zeros(rom.n)
        run = rj.simulate(rom, ts, q0=rest, v0=rest, solver=diffrax.Dopri8(), **settings)
        energies = jax.vmap(
            lambda q, v: (
                mechanics.kinetic_energy(scene, q, v),
                mechanics.potential_energy(scene, q),
            )
        )
        kinetic, potential = map(np.asarray, energies(run.q, run.v))
        total = kinetic + potential
        return np.max(np.abs(total - total[0])) / np.ptp(kinetic)

    assert drift(rj.Galerkin(), rtol=1e-12, stabilization=rj.Projection()) <= REDUCED_ENERGY
    with pytest.warns(UserWarning, match="its energy changes by more than the work of the forces"):
        assert drift(rj.Projected(rj.Baumgarte(20.0, 100.0)), rtol=1e-8) > LOST
