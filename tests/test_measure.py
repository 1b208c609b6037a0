"""Motion of markers along runs: against closed forms, differences in time, and other models."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import mechanics
import numpy as np
import pytest
from comparison import assert_close
from mechanics import marker_place
from programs import primitives
from tolerances import DIFFERENCED, IDENTITY

import romjax as rj

SMOOTH = {"dt": 1e-3, "solver": diffrax.Dopri8()}  # fixed steps: errors without jumps
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


@pytest.fixture(scope="module", params=[False, True], ids=["linear", "stiffened"])
def swinging(request):
    """The arm in motion, finely sampled."""
    scene = arm(request.param)
    system = rj.assemble(scene)
    return scene, system, rj.simulate(system, jnp.arange(0.0, 0.04, 1e-3), **SMOOTH)


def differenced(values, weights, step):
    """A derivative in time at the inner outputs, from seven around each."""
    windows = np.lib.stride_tricks.sliding_window_view(np.asarray(values), 7, axis=0)
    return np.einsum("k...i,i->k...", windows, weights) / step


@pytest.mark.parametrize("relative", [False, True], ids=["inertial", "relative"])
def test_rates_are_differences_of_positions(swinging, relative):
    """Of a point and a direction of a flexible beam, and as seen from a body that moves."""
    scene, system, run = swinging
    beam, bar = scene.bodies
    against = bar.at((0.1, 0.2), 0.4) if relative else None
    found = rj.measure(system, run, beam.at((0.45, 0.0), 0.2), against)
    h = float(run.t[1] - run.t[0])
    assert np.max(np.abs(found.velocity)) > 0.1
    for value, first, second in (
        (found.position, found.velocity, found.acceleration),
        (found.angle, found.angular_velocity, found.angular_acceleration),
        (found.distance, found.distance_rate, None),
    ):
        assert_close(first[3:-3], differenced(value, FIRST, h), DIFFERENCED)
        if second is not None:
            scale = np.max(np.abs(second))
            assert_close(second[3:-3], differenced(value, SECOND, h**2), DIFFERENCED, scale)


def test_a_point_by_hand(swinging):
    """Position and velocity from the shapes of the beam, by functions of the tests."""
    scene, system, run = swinging
    if scene.bodies[0].stiffening:
        pytest.skip("the functions of the tests know no foreshortening")
    marker = scene.bodies[0].at((0.31, 0.0))
    found = rj.measure(system, run, marker)

    @jax.jit
    @jax.vmap
    def by_hand(q, v):
        return jax.jvp(lambda q: marker_place(scene, marker, q), (q,), (v,))

    place, rate = by_hand(run.q, run.v)
    assert_close(found.position, place, IDENTITY)
    assert_close(found.velocity, rate, IDENTITY)


def test_relative_motion_by_hand(swinging):
    scene, system, run = swinging
    a, b = scene.bodies[0].at((0.6, 0.0)), scene.bodies[1].at((0.1, 0.0), 0.3)
    both, one, other = (rj.measure(system, run, *m) for m in ((a, b), (a,), (b,)))
    apart = one.position - other.position
    c, s = np.cos(other.angle), np.sin(other.angle)
    wanted = np.stack([c * apart[:, 0] + s * apart[:, 1], c * apart[:, 1] - s * apart[:, 0]], 1)
    assert_close(both.position, wanted, IDENTITY)
    assert_close(both.angle, one.angle - other.angle, IDENTITY)
    assert_close(both.distance, np.hypot(*np.asarray(apart).T), IDENTITY)
    # Seen from b, which turns with ω: ṙ' = A_bᵀ (Δv − ω × Δr).
    turned = other.angular_velocity[:, None] * np.stack([-apart[:, 1], apart[:, 0]], 1)
    seen = one.velocity - other.velocity - turned
    wanted = np.stack([c * seen[:, 0] + s * seen[:, 1], c * seen[:, 1] - s * seen[:, 0]], 1)
    assert_close(both.velocity, wanted, IDENTITY)


def test_points_in_one_place():
    """Their distance has no direction: its rate is zero, not NaN, and so is a derivative."""
    scene = rj.gallery.chain(2)
    system = rj.assemble(scene)
    run = rj.simulate(system, jnp.linspace(0.0, 0.1, 3))
    marker = scene.bodies[0].at((0.5, 0.0))
    found = rj.measure(system, run, marker, marker)
    assert_close(found.distance, 0, IDENTITY)
    assert_close(found.distance_rate, 0, IDENTITY)


# Coordinates by label.


def test_coordinates_by_label(cart_pendulum, truth):
    for i, label in enumerate(cart_pendulum.structure.labels):
        assert_close(truth[label], truth.q[:, i], 0)
        assert_close(truth[label + "'"], truth.v[:, i], 0)
    with pytest.raises(rj.InputError, match=r"no coordinate 'cart\.z'.*mean 'cart\.[xy]'"):
        truth["cart.z"]
    with pytest.raises(rj.InputError, match="no coordinate"):
        truth["z'"]


# Transformations.


def shaken(mass):
    """What is measured at the end of a short run of a beam with a mass, in one number."""
    scene = eqx.tree_at(lambda s: s.bodies[0].mass, arm(), mass)
    system = rj.assemble(scene)
    run = rj.simulate(system, jnp.linspace(0.0, 0.02, 3), dt=2e-3, solver=diffrax.Tsit5())
    beam, bar = scene.bodies
    found = rj.measure(system, run, beam.at((0.6, 0.0)), bar.at((0.1, 0.0)))
    return jnp.sum(found.acceleration[-1]) + found.distance_rate[-1]


@pytest.mark.slow
def test_transformations():
    """The same number alone, under jit, in a batch; and its derivative."""
    alone = shaken(1.5)
    batch = jax.jit(jax.vmap(shaken))(jnp.array([1.5, 1.7]))
    assert_close(batch[0], alone, IDENTITY, 10)
    assert abs(batch[1] - alone) > DIFFERENCED
    slope, h = jax.jit(jax.grad(shaken))(1.5), 1e-4
    wanted = (shaken(1.5 + h) - shaken(1.5 - h)) / (2 * h)
    assert_close(slope, wanted, DIFFERENCED, abs(wanted))


def test_measurements_pass_through_transformations():
    """A batch of runs with different starts, measured outside of the simulation."""
    scene = rj.gallery.chain(2)
    system, ts = rj.assemble(scene), jnp.linspace(0.0, 0.1, 4)
    v0 = jnp.stack([system.v0, jnp.array([0.0, 0.5, 1.0, 0.0, 1.0, 0.0])])
    runs = jax.vmap(lambda v: rj.simulate(system, ts, v0=v, **SMOOTH))(v0)
    tip = scene.bodies[1].at((0.5, 0.0))

    @jax.jit
    @jax.vmap
    def measured(run):
        found = rj.measure(system, run, tip)
        return found, found.acceleration

    found, acceleration = measured(runs)
    one = rj.measure(system, rj.simulate(system, ts, v0=v0[1], **SMOOTH), tip)
    assert_close(acceleration[1], one.acceleration, IDENTITY, 100)
    assert_close(jax.vmap(lambda m: m.position)(found)[1], one.position, IDENTITY)
    with pytest.raises(rj.InputError, match=r"batch of shape \(2,\).*jax\.vmap"):
        rj.measure(system, runs, tip)


# The cost of a question.


def test_a_position_costs_nothing_but_itself():
    """The program of a position is the same for any number of bodies, and solves nothing."""

    def names(links, quantity):
        scene = rj.gallery.chain(links)
        system = rj.assemble(scene)
        run = rj.simulate(system, jnp.linspace(0.0, 0.01, 3))
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
    state = system, run.t[7], run.q[7], run.v[7]
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
    values = jax.jit(lambda *state: [of(system, *state) for of, _ in pairs])(*state[1:])
    for value, (_, wanted) in zip(values, pairs, strict=True):
        assert_close(value, wanted[7], IDENTITY)
    assert_close(q.Travel(a, b)(*state), found.position[7, 0], IDENTITY)  # call by call, too


# Wrong input.


def free() -> rj.CustomSystem:
    zero = jnp.zeros(2)
    return rj.CustomSystem(lambda q: jnp.eye(2), lambda t, q, v: -q, q0=zero, v0=zero)


def test_wrong_input(cart_pendulum, truth):
    cart = rj.gallery.cart_pendulum().bodies[0]
    own, chain = free(), rj.assemble(rj.gallery.chain(2))
    run = rj.simulate(own, jnp.linspace(0.0, 0.1, 3))
    with pytest.raises(rj.InputError, match="CustomSystem has coordinates, but no bodies"):
        rj.measure(own, run, cart.at())
    with pytest.raises(rj.InputError, match="run has the coordinates cart.x.*system bar1.x"):
        rj.measure(chain, truth, cart.at())
    with pytest.raises(rj.InputError, match="no body 'cat'. Did you mean 'cart'"):
        rj.measure(cart_pendulum, truth, rj.RigidBody("cat", 1.0, 1.0).at())
    with pytest.raises(rj.InputError, match="every number must be finite"):
        rj.measure(cart_pendulum, truth, cart.at((jnp.nan, 0.0)))
    projected = rj.reduce(cart_pendulum, rj.pod(truth, rank=6), rj.Projected())
    with pytest.raises(rj.InputError, match="ProjectedSystem follows no equations"):
        rj.joint_forces(projected, truth)
    with pytest.raises(rj.InputError, match="is a rate itself"):
        rj.quantity.Rate(rj.quantity.Coordinate("cart.x'"))
    with pytest.raises(rj.InputError, match="no coordinate 'cart.u'"):
        rj.quantity.Coordinate("cart.u")(cart_pendulum, 0.0, truth.q[0], truth.v[0])


@pytest.mark.slow
def test_energies_by_part():
    """The parts add up to the whole, in energy and in power; of one body they are its own."""
    scene = mechanics.mixed_scene()
    system = rj.assemble(scene)
    q0, v0 = rj.consistent(system)
    run = rj.simulate(system, jnp.linspace(0.0, 0.2, 5), q0=q0, v0=v0)
    parts, whole = rj.part_energies(system, run), rj.energy(system, run)
    for named, total in (
        (parts.kinetic, whole.kinetic),
        (parts.elastic, whole.elastic),
        (parts.potential, whole.potential),
    ):
        assert_close(sum(named.values()), total, IDENTITY, scale=1 + jnp.abs(total))
    power = jax.jit(jax.vmap(lambda *state: system.state(*state).power().total))
    power = power(run.t, run.q, run.v)
    assert_close(sum(parts.power.values()), power, IDENTITY, scale=1 + jnp.abs(power))
    assert set(parts.kinetic) == {"slider", "arm", "tip"}
    assert set(parts.elastic) == {"arm", "tip"}
    slider = scene.bodies[0]
    v = run.v[:, :3]
    wanted = 0.5 * (slider.mass * (v[:, 0] ** 2 + v[:, 1] ** 2) + slider.inertia * v[:, 2] ** 2)
    assert_close(parts.kinetic["slider"], wanted, IDENTITY, scale=1 + wanted)
