"""Motion of markers along runs: against closed forms, differences in time, and other models."""

import equinox as eqx
import jax
import jax.numpy as jnp
import mechanics
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from mechanics import marker_place
from motions import through
from programs import primitives
from tolerances import DIFFERENCED, IDENTITY

import romjax as rj
from romjax import spatial
from romjax.events.check import check_quantities

SMOOTH = {"dt": 1e-3, "rtol": None}  # fixed steps: errors without jumps
# Central differences of order six, on seven points.
FIRST = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
SECOND = np.array([2, -27, 270, -490, 270, -27, 2]) / 180


def arm(stiffening: bool = False) -> rj.Scene:
    """A soft beam on a motor, and a bar on a spring beside it."""
    beam = rj.Beam(
        "beam",
        mass=1.5,
        length=1.2,
        EI=3.0,
        modes=2,
        shapes="clamped-free",
        position=(0.6, 0.0),
        amplitudes=(0.02, -0.003),
        angular_velocity=0.5,
        velocity=(0.0, 0.3),
        damping=0.02,
        stiffening=stiffening,
    )
    bar = rj.RigidBody("bar", 2.0, 0.3, position=(0.2, 0.9), velocity=(0.1, -0.2))
    return rj.Scene(
        [beam, bar],
        [rj.Revolute(beam.at((-0.6, 0.0)), rj.ground.at(), name="pin")],
        [rj.Gravity((0.3, -2.0)), rj.Spring(beam.at((0.6, 0.0)), bar.at((0.1, 0.0)), 3.0)],
    )


@pytest.fixture(scope="module", params=in_groups(["linear", "stiffened"], fast=["stiffened"]))
def swinging(request):
    """The arm in motion, finely sampled."""
    scene = arm(request.param == "stiffened")
    system = rj.assemble(scene)
    return scene, system, zoo.run(system, np.arange(0.0, 0.04, 1e-3), **SMOOTH)


def differenced(values, weights, step):
    """A derivative in time at the inner outputs, from seven around each."""
    windows = np.lib.stride_tricks.sliding_window_view(np.asarray(values), 7, axis=0)
    return np.einsum("k...i,i->k...", windows, weights) / step


def test_rates_are_differences_of_positions(swinging):
    """Of a point and a direction of a flexible beam, and as seen from a body that moves."""
    scene, system, run = swinging
    beam, bar = scene.bodies
    h = 1e-3
    for against in (None, bar.at((0.1, 0.2), 0.4)):
        found = rj.measure(system, run, beam.at((0.45, 0.0), 0.2), against)
        assert np.max(np.abs(found.velocity)) > 0.1
        for value, first, second in (
            (found.position, found.velocity, found.acceleration),
            (found.angle, found.angular_velocity, found.angular_acceleration),
            (found.distance, found.distance_rate, None),
        ):
            inner = np.asarray(first)[3:-3]
            assert_close(inner, differenced(value, FIRST, h), DIFFERENCED)
            if second is not None:
                second = np.asarray(second)
                scale = np.max(np.abs(second))
                assert_close(second[3:-3], differenced(value, SECOND, h**2), DIFFERENCED, scale)


def test_a_point_by_hand():
    """Position and velocity from the shapes of the beam, by functions of the tests."""
    scene = arm()
    marker, system = scene.bodies[0].at((0.31, 0.0)), rj.assemble(scene)
    q, v = np.random.default_rng(8).normal(size=(2, 5, system.n))
    found = rj.measure(system, through(system, np.arange(5.0), q, v), marker)

    @jax.jit
    @jax.vmap
    def by_hand(q, v):
        return jax.jvp(lambda q: marker_place(scene, marker, q), (q,), (v,))

    place, rate = by_hand(q, v)
    assert_close(found.position, place, IDENTITY, np.max(np.abs(place)))
    assert_close(found.velocity, rate, IDENTITY, np.max(np.abs(rate)))


def test_relative_motion_by_hand(swinging):
    scene, system, run = swinging
    a, b = scene.bodies[0].at((0.6, 0.0)), scene.bodies[1].at((0.1, 0.0), 0.3)
    both, one, other = (
        jax.tree.map(np.asarray, rj.measure(system, run, *m)) for m in ((a, b), (a,), (b,))
    )
    apart = one.position - other.position
    c, s = np.cos(other.angle), np.sin(other.angle)
    wanted = np.stack([c * apart[:, 0] + s * apart[:, 1], c * apart[:, 1] - s * apart[:, 0]], 1)
    assert_close(both.position, wanted, IDENTITY)
    assert_close(both.angle, one.angle - other.angle, IDENTITY)
    assert_close(both.distance, np.hypot(*apart.T), IDENTITY)
    # Seen from b, which turns with ω: ṙ' = A_bᵀ (Δv − ω × Δr).
    turned = other.angular_velocity[:, None] * np.stack([-apart[:, 1], apart[:, 0]], 1)
    seen = one.velocity - other.velocity - turned
    wanted = np.stack([c * seen[:, 0] + s * seen[:, 1], c * seen[:, 1] - s * seen[:, 0]], 1)
    assert_close(both.velocity, wanted, IDENTITY)


def test_points_in_one_place():
    """Their distance has no direction: its rate is zero, not NaN, and so is a derivative."""
    run = zoo.motion(zoo.bars)
    marker = zoo.bars().bodies[0].at((0.5, 0.0))
    found = rj.measure(run.system, run, marker, marker)
    assert_close(found.distance, 0, IDENTITY)
    assert_close(found.distance_rate, 0, IDENTITY)


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_point_at_rest(dimension):
    """Of an equilibrium, by its coordinates: single values, and no acceleration."""
    parts = rj if dimension == 2 else spatial
    inertia = 0.1 if dimension == 2 else (0.1, 0.1, 0.1)
    origin, down = np.zeros(dimension), -np.eye(dimension)[dimension - 1]
    body = parts.RigidBody("bob", 2.0, inertia)
    effects = [rj.Gravity(9.81 * down), rj.Spring(body.at(), rj.ground.at(origin), 50.0)]
    system = rj.assemble(rj.Scene([body], [], effects))
    q = rj.equilibrium(system)
    found = rj.measure(system, q, body.at(0.3 * down), rj.ground.at(origin))
    assert_close(found.position, (0.3 + 2.0 * 9.81 / 50.0) * down, IDENTITY)
    assert_close(found.distance, 0.3 + 2.0 * 9.81 / 50.0, IDENTITY)
    assert_close(found.velocity, origin, IDENTITY)
    assert_close(found.acceleration, origin, IDENTITY, scale=9.81)
    with pytest.raises(rj.InputError, match=r"measure: q has shape \(2,\)"):
        rj.measure(system, q[:2], body.at())


# Coordinates by label.


def test_coordinates_by_label(cart_pendulum):
    run = through(cart_pendulum, np.arange(3.0), *np.random.default_rng(1).normal(size=(2, 3, 8)))
    q, v = np.asarray(run.q), np.asarray(run.v)
    for i, label in enumerate(cart_pendulum.structure.labels):
        assert_close(run[label], q[:, i], 0)
        assert_close(run[label + "'"], v[:, i], 0)
    with pytest.raises(rj.InputError, match=r"no coordinate 'cart\.z'.*mean 'cart\.[xy]'"):
        run["cart.z"]
    with pytest.raises(rj.InputError, match="no coordinate"):
        run["z'"]


# Transformations.


def shaken(mass):
    """A number of what is measured after a short run of two bars, the first of a mass."""
    scene = zoo.bars(masses=(mass, 1.0), spins=(1.0, -2.0))
    system = rj.assemble(scene)
    run = zoo.run(system, np.linspace(0.0, 0.02, 3), dt=2e-3, rtol=None)
    first, second = scene.bodies
    found = rj.measure(system, run, second.at((0.5, 0.0)), first.at((0.1, 0.0)))
    return jnp.sum(found.acceleration[-1]) + found.distance_rate[-1]


@pytest.mark.slow
def test_transformations():
    """The same number alone, under jit, in a batch; and its derivative."""
    alone, h = shaken(1.5), 1e-4
    masses = np.array([1.5, 1.5 + h, 1.5 - h, 1.7])
    values, slopes = map(np.asarray, jax.jit(jax.vmap(jax.value_and_grad(shaken)))(masses))
    assert_close(values[0], alone, IDENTITY, 10)
    assert abs(values[3] - alone) > DIFFERENCED
    wanted = (values[1] - values[2]) / (2 * h)
    assert_close(slopes[0], wanted, DIFFERENCED, abs(wanted))


@jax.jit
@jax.vmap
def tip_of_bars(run):
    tip = zoo.bars().bodies[1].at((0.5, 0.0))
    found = rj.measure(zoo.system(zoo.bars), run, tip)
    return found, found.acceleration


def test_measurements_pass_through_transformations():
    """A batch of runs with different starts, measured outside of the simulation."""
    system, tip = zoo.system(zoo.bars), zoo.bars().bodies[1].at((0.5, 0.0))
    turned = zoo.system(zoo.bars, spins=(1.0, 0.0))
    one, other = (zoo.run(x, np.linspace(0.0, 1.0, 101)) for x in (system, turned))
    runs = jax.tree.map(lambda *x: np.stack(x), one, other)
    found, acceleration = jax.tree.map(np.asarray, tip_of_bars(runs))
    alone = rj.measure(system, other, tip)
    assert_close(acceleration[1], alone.acceleration, IDENTITY, 100)
    assert_close(jax.jit(jax.vmap(lambda m: m.position))(found)[1], alone.position, IDENTITY)
    with pytest.raises(rj.InputError, match=r"batch of shape \(2,\).*jax\.vmap"):
        rj.measure(system, runs, tip)


# The cost of a question.


def test_a_position_costs_nothing_but_itself():
    """The program of a position is the same for any number of bodies, and solves nothing."""

    def names(links, quantity):
        scene = rj.gallery.chain(links)
        system = rj.assemble(scene)
        run = through(system, np.arange(3.0))
        tip = scene.bodies[-1].at((0.5, 0.0))

        def of(q, v):
            moved = eqx.tree_at(lambda run: (run.q, run.v), run, (q, v))
            return getattr(rj.measure(system, moved, tip), quantity)

        return primitives(of, run.q, run.v)

    assert len(names(3, "position")) == len(names(12, "position"))
    assert len(names(3, "position")) < len(names(3, "velocity"))
    assert 10 * len(names(3, "velocity")) < len(names(3, "acceleration"))


# Quantities of a state.


def test_quantities(swinging):
    """The same numbers as those measured along the run."""
    scene, system, run = swinging
    a, b = scene.bodies[0].at((0.6, 0.0)), scene.bodies[1].at((0.1, 0.0), 0.3)
    found, q = rj.measure(system, run, a, b), rj.quantity
    state = (np.asarray(x)[7] for x in (run.t, run.q, run.v))
    pairs = (
        (q.Coordinate("bar.phi"), run["bar.phi"]),
        (q.Coordinate("beam.q2'"), run["beam.q2'"]),
        (q.Rate(q.Coordinate("bar.x")), run["bar.x'"]),
        (q.Gap(a, b), found.distance),
        (q.Gap(a, b, clearance=0.25), found.distance - 0.25),
        (q.Travel(a, b), found.position[:, 0]),
        (q.Turn(a, b), found.angle),
        (q.Rate(q.Gap(a, b)), found.distance_rate),
        (q.Rate(q.Travel(a, b)), found.velocity[:, 0]),
        (q.Rate(q.Turn(a, b)), found.angular_velocity),
    )
    values = jax.jit(lambda *state: [of(system, *state) for of, _ in pairs])(*state)
    for value, (_, wanted) in zip(values, pairs, strict=True):
        assert_close(value, np.asarray(wanted)[7], IDENTITY)


@pytest.mark.parametrize("angle", [0.4, np.pi])
def test_turn_in_space(angle):
    """About the z axis of the second marker; at a half turn the rate is as anywhere."""
    axis, spin = np.array([1.0, 2.0, 2.0]) / 3, 0.7
    turn = spatial.rotation(axis, angle)
    body = spatial.RigidBody(
        "body", 2.0, (0.3, 0.2, 0.1), orientation=turn, angular_velocity=spin * axis
    )
    ends = body.at((0.0, 0.0, 0.0), axis=axis), rj.ground.at((0.0, 0.0, 0.0), axis=axis)
    system, quantity = rj.assemble(rj.Scene([body])), rj.quantity.Turn(*ends)
    values = jax.jit(
        lambda q, v: [of(system, 0.0, q, v) for of in (quantity, rj.quantity.Rate(quantity))]
    )(system.q0, system.v0)
    # Of minus a half turn it is the same.
    assert_close(np.cos(values[0]), np.cos(angle), IDENTITY)
    assert_close(np.sin(values[0]), np.sin(angle), IDENTITY, scale=1.0)
    assert_close(values[1], spin, IDENTITY)
    with pytest.raises(rj.InputError, match=r"events\[0\] watches a Turn.*the sine"):
        check_quantities(system, [rj.Crossing(quantity)])


# Wrong input.


def test_wrong_input(cart_pendulum):
    cart = rj.gallery.cart_pendulum().bodies[0]
    own, bars = zoo.oscillator(), zoo.system(zoo.bars)
    run = through(cart_pendulum)
    with pytest.raises(rj.InputError, match="CustomSystem has coordinates, but no bodies"):
        rj.measure(own, through(own), cart.at())
    with pytest.raises(rj.InputError, match="run has the coordinates cart.x.*system bar1.x"):
        rj.measure(bars, run, cart.at())
    with pytest.raises(rj.InputError, match="no body 'cat'. Did you mean 'cart'"):
        rj.measure(cart_pendulum, run, rj.RigidBody("cat", 1.0, 1.0).at())
    with pytest.raises(rj.InputError, match="every number must be finite"):
        rj.measure(cart_pendulum, run, cart.at((np.nan, 0.0)))
    basis = rj.Basis.from_modes(np.eye(6)[:, :2], bars.q0)
    projected = rj.reduce(bars, basis, rj.Projected())
    with pytest.raises(rj.InputError, match="ProjectedSystem follows no equations"):
        rj.joint_forces(projected, zoo.motion(zoo.bars))
    with pytest.raises(rj.InputError, match="is a rate itself"):
        rj.quantity.Rate(rj.quantity.Coordinate("cart.x'"))
    with pytest.raises(rj.InputError, match="no coordinate 'cart.u'"):
        rj.quantity.Coordinate("cart.u")(cart_pendulum, 0.0, cart_pendulum.q0, cart_pendulum.v0)


@pytest.mark.slow
def test_energies_by_part():
    """The parts add up to the whole, in energy and in power; of one body they are its own."""
    scene = mechanics.mixed_scene()
    system = rj.assemble(scene)
    t = np.linspace(0.0, 0.2, 5)
    q, v = np.random.default_rng(6).normal(size=(2, len(t), system.n))
    run = through(system, t, np.asarray(system.q0) + 0.1 * q, v)
    parts = jax.tree.map(np.asarray, rj.part_energies(system, run))

    @jax.jit
    @jax.vmap
    def of_all(t, q, v):
        state = system.state(t, q, v)
        return state.energy(), state.power().total

    whole, power = jax.tree.map(np.asarray, of_all(run.t, run.q, run.v))
    for named, total in (
        (parts.kinetic, whole.kinetic),
        (parts.elastic, whole.elastic),
        (parts.potential, whole.potential),
        (parts.power, power),
    ):
        assert_close(sum(named.values()), total, IDENTITY, scale=1 + np.abs(total))
    assert set(parts.kinetic) == {"slider", "arm", "tip"}
    assert set(parts.elastic) == {"arm", "tip"}
    slider = scene.bodies[0]
    wanted = 0.5 * (slider.mass * (v[:, 0] ** 2 + v[:, 1] ** 2) + slider.inertia * v[:, 2] ** 2)
    assert_close(parts.kinetic["slider"], wanted, IDENTITY, scale=1 + np.asarray(wanted))
