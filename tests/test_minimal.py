"""Reduction in minimal coordinates: open chains, closed loops, moving supports."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from mechanisms import linkage
from programs import kept
from test_hard_cases import slider_crank
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax import spatial as r
from romjax.system import dynamics

# Required of three modes on the cart-pendulum; and of the constraints.
ERROR_THREE = 5e-5
EXACT = 1e-12

# The formulation with the decisions of a model that was made before.
DECIDED = {
    "galerkin": lambda rom: rj.Galerkin(constraints=rom.m),
    "minimal": lambda rom: rj.Minimal(chart=rom.lift.chart),
}


MECHANISMS = {
    "bars": (zoo.bars(), 1.0),
    # In 2 s it goes all the way round: none of its coordinates, and no mean of them, grows all the
    # way, so charts change.
    "four-bar": (zoo.four_bar(), 2.0),
    "redundant four-bar": (zoo.four_bar(doubled=True), 0.7),
    "slider crank": (slider_crank(np.pi / 4), 1.0),
}


# Fast tests change charts with one four-bar that goes round; the charts of these never change. Of
# the two the one with rows that repeat others shows a closed loop, too.
FAST, SLOW = ("bars", "four-bar"), ("redundant four-bar",)


@pytest.fixture(scope="module", params=in_groups(MECHANISMS, fast=FAST, slow=SLOW))
def mechanism(request):
    """A mechanism, its full run, and its model in as many minimal coordinates as it has."""
    scene, end = MECHANISMS[request.param]
    system = rj.assemble(scene)
    motion = zoo.run(system, np.linspace(0.0, end, 101))
    return system, motion, rj.reduce(system, rj.pod(motion), "minimal")


@kept
def accelerations(system, rom, t, q, v):
    """Of a model in the chart of a configuration, and of the full system there."""
    z, w = rom.restrict(q, v)
    state = rom.state(t, z, w)
    wanted, _ = system.acceleration(t, state.q, state.v)
    return state.physical_acceleration(rom.acceleration(t, z, w)[0]), wanted


@kept
def jacobian(system, q):
    return dynamics.jacobian(system, 0.0, q)


def test_minimal_coordinates_are_the_same_mechanism(mechanism):
    system, motion, rom = mechanism
    assert rom.m == 0
    rank = np.linalg.matrix_rank(jacobian(system, system.q0), tol=1e-9)
    assert rom.degrees_of_freedom == system.n - rank
    approx = zoo.run(rom, motion.t)
    assert rj.compare(motion, approx).error <= 10 * SOLVED
    assert_close(approx.violation, 0.0, EXACT)


@pytest.mark.parametrize(
    "mechanism",
    in_groups(MECHANISMS, fast=FAST[:1], slow=[*FAST[1:], *SLOW]),
    indirect=True,
)
def test_accelerations_are_those_of_the_full_system(mechanism):
    """G z̈ + β against the extended system's q̈, which knows nothing of charts."""
    system, motion, rom = mechanism

    for place in (0, 50, 100):
        t, q, v = (np.asarray(x)[place] for x in (motion.t, motion.q, motion.v))
        found, wanted = accelerations(system, rom.in_chart_of(motion.q[place]), t, q, v)
        assert_close(found, wanted, IDENTITY * 100, np.max(np.abs(wanted)))


@pytest.mark.parametrize("mechanism", in_groups(MECHANISMS, slow=[*FAST, *SLOW]), indirect=True)
def test_the_derivatives_of_the_acceleration(mechanism):
    """`linearize` against forward mode through the acceleration, Newton's method included."""
    _, motion, rom = mechanism
    t, rom = motion.t[30], rom.in_chart_of(motion.q[30])
    z, w = rom.restrict(motion.q[30], motion.v[30])

    @jax.jit
    def both(*x):
        slopes = jax.jacfwd(lambda *x: rom.acceleration(*x)[0], argnums=(0, 1, 2))(*x)
        return dynamics.linearize(rom, *x), slopes

    found, slopes = both(t, z, w)
    pairs = zip((found.by_time, found.by_position, found.by_velocity), slopes, strict=True)
    for by, wanted in pairs:
        scale = jnp.maximum(1, jnp.max(jnp.abs(wanted)))
        assert_close(by, wanted, SOLVED, scale)


@pytest.mark.parametrize("decompose", [rj.pod, rj.sod])
def test_three_modes(cart_pendulum, truth, decompose):
    """One mode for each direction of the motion; the stiff one is left out."""
    rom = rj.reduce(cart_pendulum, decompose(truth, rank=3), "minimal")
    approx = zoo.run(rom, truth.t)
    assert rj.compare(truth, approx).error <= ERROR_THREE
    assert_close(approx.violation, 0.0, EXACT)
    assert approx.stats.num_steps < truth.stats.num_steps / 10


def test_more_modes_than_freedoms(cart_pendulum, truth):
    rom = rj.reduce(cart_pendulum, rj.pod(truth, rank=6), "minimal")
    assert rom.n == 4
    assert "6 modes were asked for" in rom.summary


def test_modes_of_ones_own(cart_pendulum):
    """Rail and swing, by hand: no snapshots are needed."""
    modes = np.zeros((8, 2))
    modes[[0, 1, 3, 4], 0], modes[[3, 5], 1] = 1.0, (0.4, 1.0)
    rom = rj.reduce(cart_pendulum, rj.Basis.from_modes(modes, cart_pendulum.q0), "minimal")
    assert rom.n == 2
    assert_close(zoo.run(rom, [0.0, 0.1]).violation, 0.0, EXACT)


@pytest.mark.slow
def test_mechanisms_of_any_size():
    """The last step of Newton's method is held against the coordinates, of which amplitudes of a
    beam of a kilometre are millions.
    """
    length, mass, time = 1e3, 1e9, np.sqrt(1e3)
    base = rj.RigidBody("base", 2 * mass, 0.1 * mass * length**2)
    stiffness = 3.0 * mass * length**3 / time**2
    start = {"position": (0.0, 0.4 * length), "angle": np.pi / 2}
    beam = rj.Beam("beam", 0.5 * mass, 0.8 * length, EI=stiffness, modes=3, damping=0.01, **start)
    middle, ground = base.at(), rj.ground.at()
    drive = rj.PrescribedTravel(middle, ground, rj.Step(0.3 * length, 0.1 * time, 0.5 * time))
    foot = rj.Weld(beam.at("start"), base.at(angle=np.pi / 2))
    system = rj.assemble(rj.Scene([base, beam], [rj.Prismatic(middle, ground), drive, foot]))
    ts = np.linspace(0.0, 1.5 * time, 76)
    motion = zoo.run(system, ts)
    model = rj.reduce(system, rj.pod(motion, tol=1e-6), "minimal")
    assert rj.compare(motion, zoo.run(model, ts)).error <= 10 * SOLVED


@pytest.mark.slow
def test_a_singular_position_is_refused():
    """Crank and rod of one length: at 90° the slider may stay, and no coordinate says whether."""
    system = rj.assemble(slider_crank(np.pi / 2))
    motion = zoo.run(system, np.linspace(0.0, 0.1, 101), rtol=1e-8)
    with pytest.raises(rj.ReductionError, match=r"singular position.*at t = 0 s"):
        rj.reduce(system, rj.pod(motion), "minimal")


def test_a_mechanism_without_freedom():
    """A drive prescribes all of its motion: it has no modes."""
    found = rj.modes(zoo.system(zoo.driven_four_bar))
    assert found.frequencies.shape == (0,)
    assert found.is_stable


@pytest.mark.exhaustive
def test_a_subspace_does_not_change_charts():
    """One mode of two four-bars that go all the way round would be another in each chart."""
    first = {"A": (0, 0), "b": (0.3, 0.9), "c": (1.8, 1.3), "D": (2.0, 0)}
    second = {"E": (0, 0), "f": (-0.1, 0.9), "g": (1.7, 1.2), "H": (2.0, 0)}
    bars = [tuple(names) for names in ("Ab", "bc", "Dc", "Ef", "fg", "Hg")]
    system = rj.assemble(linkage(first | second, bars, {}, gravity=True))
    motion = rj.simulate(system, np.linspace(0.0, 2.0, 201), rtol=zoo.TIGHT)
    with pytest.raises(rj.ReductionError, match=r"several only all 2 of them carry over, not 1"):
        rj.reduce(system, rj.pod(motion, rank=1), "minimal")
    rom = rj.reduce(system, rj.pod(motion, rank=2), "minimal")
    approx = rj.simulate(rom, motion.t, rtol=zoo.TIGHT)
    assert rj.compare(motion, approx).error <= 10 * SOLVED


@pytest.mark.slow
def test_a_moving_support():
    """A pendulum on a support that oscillates: constraints that depend on time."""

    def constraint(t, q):
        return (q[0] - 0.1 * jnp.sin(5 * t)) ** 2 + q[1:] ** 2 - 1

    system = rj.CustomSystem(
        lambda q: jnp.diag(jnp.array([1.0, 2.0])),
        lambda t, q, v: jnp.array([0.0, -19.62]),
        constraint,
        q0=[0.6, -0.8],
        v0=[0.5, 0.0],
    )
    settings = {"rtol": zoo.TIGHT, "audit": False}
    motion = rj.simulate(system, jnp.linspace(0.0, 1.0, 101), **settings)
    rom = rj.reduce(system, rj.pod(motion, rank=1), "minimal")
    for solver in (None, rj.Rodas5P()):
        approx = rj.simulate(rom, motion.t, solver=solver, **settings)
        assert rj.compare(motion, approx).error <= 10 * SOLVED


def clamped(angle) -> rj.AbstractSystem:
    """A bar on a hinge at the end of one that is clamped at an angle."""
    half = 0.5 * np.array([np.cos(angle), np.sin(angle)])
    base = rj.RigidBody("base", 1.0, 0.1, position=half, angle=angle)
    bar = rj.RigidBody("bar", 0.5, 0.05, position=2 * half + [0.4, 0.0])
    clamp = rj.Weld(base.at((-0.5, 0.0)), rj.ground.at((0.0, 0.0), angle))
    hinge = rj.Revolute(bar.at((-0.4, 0.0)), base.at((0.5, 0.0)))
    return rj.assemble(rj.Scene([base, bar], [clamp, hinge], [rj.Gravity()]))


@pytest.mark.parametrize("angle", [1.2, 3.1])
def test_another_clamp(angle):
    """Where another system holds a body elsewhere, by more than a radian too, what hangs on it
    follows.
    """
    first, other = clamped(0.2), clamped(angle)
    rom = rj.reduce(first, rj.Basis.from_modes(np.eye(first.n)[:, -1:], first.q0), "minimal")
    assert rom.n == 1
    follows_clamp(rom.with_full(other), other, rom.q0)


def clamped_in_space(turn) -> rj.AbstractSystem:
    """A bar on an oblique hinge at the end of one that is clamped at a turn [rad]."""
    axis = (0.0, 0.6, 0.8)
    size = np.linalg.norm(turn)
    x, y, z = np.asarray(turn) / size
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = np.eye(3) + np.sin(size) * cross + (1 - np.cos(size)) * cross @ cross
    base, bar = (
        r.RigidBody(
            name,
            1.0,
            (0.02, 0.1, 0.1),
            position=turned @ [place, 0.0, 0.0],
            orientation=turned,
            velocity=turned @ speed,
            angular_velocity=turned @ spin,
        )
        for name, place, speed, spin in (
            ("base", 0.5, np.zeros(3), np.zeros(3)),
            ("bar", 1.4, np.cross(axis, [0.4, 0.0, 0.0]), np.array(axis)),
        )
    )
    clamp = r.Weld(base.at((-0.5, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0), rotation=turned))
    hinge = r.Revolute(bar.at((-0.4, 0.0, 0.0), axis=axis), base.at((0.5, 0.0, 0.0), axis=axis))
    return rj.assemble(rj.Scene([base, bar], [clamp, hinge], [rj.Gravity((0.0, 0.0, -9.81))]))


@pytest.mark.slow
@pytest.mark.parametrize("turn", [(0.3, 0.4, 0.9), (0.5, -1.0, 1.2), (0.0, 0.0, 3.1)])
def test_another_clamp_in_space(turn):
    """Beyond a radian no Newton's method leads there from where the first system is."""
    first, other = clamped_in_space((0.1, 0.0, 0.2)), clamped_in_space(turn)
    rom = rj.reduce(first, rj.Basis.from_modes(first.v0[:, None], first.q0), "minimal")
    assert rom.n == 1
    follows_clamp(rom.with_full(other), other, rom.q0)
    # From where the other system starts, which is far from all snapshots.
    ts = np.linspace(0.0, 0.5, 11)
    error = float(rj.compare(zoo.run(other, ts), zoo.run(rom.with_full(other), ts)).error)
    assert error <= 1e-7, f"{error:.1e}"


def follows_clamp(moved, other, start):
    """Whether a model holds the first body as the other system does, and all joints, near the start
    of the model that it was made of.
    """
    q, violation, rate = placed(moved, start + 0.1)
    assert_close(q[:2], other.q0[:2], SOLVED)
    assert_close(violation, np.zeros(other.m), SOLVED)
    assert_close(rate, np.zeros(other.m), SOLVED)


@eqx.filter_jit
def placed(rom, z):
    """The physical coordinates of a model, the constraints there, and their rates."""
    q, v = rom.reconstruct(0.0, z, jnp.ones_like(z))
    return q, *jax.jvp(lambda q: rom.full.constraint(0.0, q), (q,), (v,))


@pytest.mark.exhaustive
def test_reactions(cart_pendulum, truth):
    """All four multipliers from models that have two and none; the dropped mode's share is 4e-4."""
    for rank, formulation in ((5, "galerkin"), (3, "minimal")):
        rom = rj.reduce(cart_pendulum, rj.pod(truth, rank=rank), formulation)
        found = rj.reactions(rom, rj.simulate(rom, truth.t, rtol=zoo.TIGHT))
        wanted = truth.multipliers
        assert_close(found, wanted, 1e-3, jnp.max(jnp.abs(wanted)))


@pytest.mark.exhaustive
def test_the_gradient_passes_through_full_run_basis_and_reduced_run():
    """d/dp of a reduced run whose basis comes from the full run of the same scene, by forward mode
    and central differences; the chart is chosen once, outside. Subspaces: test_every_parameter.py.
    """
    ts = jnp.linspace(0.0, 0.3, 31)

    def result(f1, formulation):
        system = rj.assemble(rj.gallery.cart_pendulum(f1=f1))
        settings = {"rtol": 1e-10, "adjoint": diffrax.ForwardMode(), "throw": False}
        full = rj.simulate(system, ts, solver=rj.Rodas5P(), **settings)
        rom = rj.reduce(system, rj.pod(full, rank=3), formulation)
        run = rj.simulate(rom, ts, solver=diffrax.Dopri8(), **settings)
        return rom, run.q[-1, 5] + run.q[-1, 0]

    rom, _ = result(16.0, "minimal")
    decided = DECIDED["minimal"](rom)
    value = jax.jit(lambda f1: result(f1, decided)[1])
    found = jax.jit(jax.jacfwd(lambda f1: result(f1, decided)[1]))(16.0)
    step = 1e-3
    wanted = (value(16.0 + step) - value(16.0 - step)) / (2 * step)
    assert_close(found, wanted, 10 * DIFFERENCED, abs(wanted))
