"""Controllers with a clock, against recursions by hand."""

import pickle

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from zoo import run

import romjax as rj
from romjax.integrate.ticks import ticked

MASS, PERIOD = 2.0, 0.1
GAINS = 3.0, 4.0
CART = rj.RigidBody("cart", MASS, 0.1, position=(1.0, 0.0))
RAIL = rj.Prismatic(CART.at(), rj.ground.at())
PUSH = rj.Force(CART.at(), (1.0, 0.0), rj.Held("push"))
TIMES = np.linspace(0.0, 2.0, 21)
# A double integrator over a period at a constant force.
STEP = np.array([[1.0, PERIOD], [0.0, 1.0]])
PUSHED = np.array([PERIOD**2 / 2, PERIOD]) / MASS


class Feedback(eqx.Module):
    """u = −K y, at once or a tick late."""

    gains: jax.Array

    def __call__(self, t, state, measured):
        command = -self.gains @ measured
        return (state[0], command[None]) if state.size else (command, state)


def scene(gains=GAINS, late=False, *others) -> rj.Scene:
    memory = [0.0] if late else []
    law = Feedback(gains if isinstance(gains, jax.Array) else np.asarray(gains))
    clock = rj.Sampled(PERIOD, law, ["cart.x", "cart.x'"], ["push"], memory, name="clock")
    return rj.Scene([CART], [RAIL], [clock, PUSH, *others])


def recursion(late: bool) -> tuple[np.ndarray, np.ndarray]:
    """Place and speed at the ticks, and the forces from each on."""
    x, before = np.array([1.0, 0.0]), 0.0
    places, forces = [], []
    for _ in TIMES:
        command = -np.array(GAINS) @ x
        force, before = (before, command) if late else (command, before)
        places.append(x)
        forces.append(force)
        x = STEP @ x + PUSHED * force
    return np.array(places), np.array(forces)


@pytest.mark.parametrize(
    "late",
    [pytest.param(False, marks=pytest.mark.exhaustive), True],
    ids=["at once", "a tick late"],
)
def test_feedback_of_a_double_integrator_is_a_recursion(late):
    moved = run(rj.assemble(scene(late=late)), TIMES, audit=True)
    places, forces = recursion(late)
    assert np.max(np.abs(moved["cart.x"] - places[:, 0])) <= 1e-12
    assert np.max(np.abs(moved["cart.x'"] - places[:, 1])) <= 1e-12
    # At a tick as it was before.
    assert np.max(np.abs(moved["clock.push"][1:] - forces[:-1])) <= 1e-12
    assert moved.is_valid
    known = rj.effect_forces(moved.system, moved)["Force(cart)"].force[1:, 0]
    assert np.max(np.abs(known - forces[:-1])) <= 1e-12


def test_a_copy_of_a_scene_has_its_law():
    clock = pickle.loads(pickle.dumps(scene())).effects[0]
    command, _ = clock.function(0.0, np.zeros(0), np.array([2.0, 1.0]))
    assert float(command) == -(2 * GAINS[0] + GAINS[1])


@pytest.mark.slow
def test_fixed_steps_end_at_ticks():
    moved = run(rj.assemble(scene()), TIMES, dt=0.03)
    assert np.max(np.abs(moved["cart.x"] - recursion(False)[0][:, 0])) <= 1e-12


def counting(period=PERIOD) -> rj.AbstractSystem:
    """A cart at 1 m/s, and a controller that counts its ticks and does nothing."""
    cart = rj.RigidBody("cart", MASS, 0.1, velocity=(1.0, 0.0))
    clock = rj.Sampled(period, _one_more, [], ["push"], [0.0], name="clock")
    push = rj.Force(cart.at(), (1.0, 0.0), rj.Held("push"))
    return rj.assemble(rj.Scene([cart], [], [clock, push]))


def _one_more(t, state, measured):
    return 0.0 * state, state + 1


def _place(system, t, q, v):
    return q[0]


def counted(ts, level, rtol=1e-6) -> rj.Trajectory:
    """Its run past a place."""
    passed = rj.Crossing(_place, level)
    return rj.simulate(counting(), np.asarray(ts), events=[passed], rtol=rtol, audit=False)


@pytest.mark.parametrize("rtol", [1e-6, 1e-3])
def test_no_tick_counts_twice_beside_an_event(rtol):
    """That of 0.5 s, of which a step that ends there is carried back to the event before."""
    for before in (0.0, 2e-8, 1e-7, 3e-6, 1e-4, -1e-7, -3e-6):
        moved = counted([0.0, 1.05], 0.5 - before, rtol)
        assert (moved["clock.state1"][-1], moved.events.count) == (11, 1)


def test_no_tick_is_missed_at_late_times():
    """Of a billion ticks, whose times have some seven digits after those of the period left."""
    moved = counted([1e8, 1e8 + 10.05], -1.0)
    assert moved["clock.state1"][-1] == 101


@pytest.mark.slow
def test_pid_at_a_kilohertz():
    """Of a mass in oil, whose motion over a tick is known, and an implicit method."""
    period, drag, gains = 1e-3, 3.0, (400.0, 900.0, 40.0)

    def law(t, state, measured):
        error = 0.2 - measured[0]
        integral = state[0] + period * error
        command = gains[0] * error + gains[1] * integral + gains[2] * (error - state[1]) / period
        return command, jnp.stack([integral, error])

    # The first difference is none.
    clock = rj.Sampled(period, law, ["cart.x"], ["push"], [0.0, -0.8])
    oil = rj.Damper(CART.at(), rj.ground.at(), drag)
    system = rj.assemble(rj.Scene([CART], [RAIL], [clock, PUSH, oil]))
    times = np.linspace(0.0, 1.0, 11)
    x, v, integral, last, found = 1.0, 0.0, 0.0, -0.8, []
    for k in range(1001):
        if k % 100 == 0:
            found.append(x)
        error = 0.2 - x
        integral += period * error
        force = gains[0] * error + gains[1] * integral + gains[2] * (error - last) / period
        last, rate, limit = error, drag / MASS, force / drag
        fade = np.exp(-rate * period)
        x += limit * period + (v - limit) * (1 - fade) / rate
        v = limit + (v - limit) * fade
    for solver in (rj.Rodas5P(), None):
        moved = run(system, times, **({"solver": solver} if solver else {}))
        assert np.max(np.abs(moved["cart.x"] - np.array(found))) <= 1e-9


@pytest.mark.slow
def test_gradients_by_what_a_function_holds():
    def late(gains):
        return run(rj.assemble(scene(gains)), TIMES, max_steps=200)["cart.x"][-1]

    gains = jnp.asarray(GAINS)
    checked = rj.check_gradient(late, gains)
    assert checked.error <= 1e-6, checked
    many = jax.vmap(late)(jnp.stack([gains, 1.1 * gains]))
    assert np.allclose(many, [late(gains), late(1.1 * gains)], rtol=1e-12)


@pytest.mark.slow
def test_derivatives_by_the_period():
    """The ticks move with it, and the jumps of the force with them."""

    def place(period):
        clock = eqx.tree_at(lambda e: e.period, scene().effects[0], period)
        system = rj.assemble(rj.Scene([CART], [RAIL], [clock, PUSH]))
        return run(system, TIMES[[0, 5]] - [0.0, 0.03])["cart.x"][-1]

    def stepped(period):
        x = jnp.array([1.0, 0.0])
        for length in (*[period] * 4, 0.47 - 4 * period):
            force = -jnp.array(GAINS) @ x / MASS
            x = jnp.array([x[0] + length * x[1] + 0.5 * length**2 * force, x[1] + length * force])
        return x[0]

    with rj.forward_mode():
        found = jax.jit(jax.jacfwd(place))(PERIOD)
    np.testing.assert_allclose(found, jax.jit(jax.grad(stepped))(PERIOD), rtol=1e-9)


@pytest.mark.slow
def test_second_derivatives_by_the_period():
    """Of a cart in oil after a tick, whose motions are known, in reverse mode too."""
    drag, now, end = 3.0, 4 * PERIOD, 0.55
    rate = drag / MASS

    def moved(x, v, force, time):
        limit, fade = force / drag, jnp.exp(-rate * time)
        return x + limit * time + (v - limit) * (1 - fade) / rate, limit + (v - limit) * fade

    def stepped(period):
        x, v = moved(0.7, -0.4, 1.5, 4 * period - now)
        return moved(x, v, -GAINS[0] * x - GAINS[1] * v, end - 4 * period)[0]

    def found(period):
        clock = eqx.tree_at(lambda e: e.period, scene().effects[0], period)
        oil = rj.Damper(CART.at(), rj.ground.at(), drag)
        system = rj.assemble(rj.Scene([CART], [RAIL], [clock, PUSH, oil]))
        q, v = system.q0.at[0].set(0.7), system.v0.at[0].set(-0.4).at[-1].set(1.5)
        q, v = ticked(system, jnp.asarray(now), q, v)
        return moved(q[0], v[0], v[-1], end - now)[0]

    def both(function):
        return jax.jit(lambda x: jax.jvp(jax.grad(function), (x,), (1.0,)))(PERIOD)

    np.testing.assert_allclose(both(found), both(stepped), rtol=1e-12)


def test_a_model_with_fewer_modes_ticks():
    """What it measures and sets has other places among its coordinates than in the full system."""
    beam = rj.Beam("beam", 1.0, 1.0, EI=20.0, modes=3, position=(0.5, 0.0))
    load = rj.RigidBody("load", MASS, 0.1, position=(1.0, 0.0))
    clock = rj.Sampled(PERIOD, _doubled, ["load.x"], ["push"], name="clock")
    joints = [rj.Revolute(beam.at("start"), rj.ground.at()), rj.Weld(load.at(), beam.at("end"))]
    force = rj.Force(load.at(), (0.0, 1.0), rj.Held("push"))
    system = rj.assemble(rj.Scene([beam, load], joints, [clock, force]))
    bent = np.zeros((system.n, 1))
    bent[3] = 1.0
    local = rj.reduce(system, rj.Basis.from_modes(bent, system.q0), "local")
    assert local.n == system.n - 2
    _, after = ticked(local, jnp.zeros(()), local.q0, local.v0)
    np.testing.assert_array_equal(after, [*local.v0[:-1], 2.0])


def _doubled(t, state, measured):
    return 2 * measured, state


@pytest.mark.instant
def test_what_cannot_be_says_so(tmp_path):
    clock = scene().effects[0]
    with pytest.raises(rj.SceneError, match="0 controllers set the signal 'push'; .*: none"):
        rj.assemble(rj.Scene([CART], [RAIL], [PUSH]))
    with pytest.raises(rj.SceneError, match="2 controllers set the signal"):
        rj.assemble(rj.Scene([CART], [RAIL], [clock, clock, PUSH]))
    driven = rj.PrescribedTravel(CART.at(), rj.ground.at(), rj.Held("push"))
    with pytest.raises(rj.SceneError, match="a joint cannot follow Held"):
        rj.assemble(rj.Scene([CART], [driven], [clock]))
    lost = rj.Sampled(1.0, clock.function, ["cart.z"], ["push"])
    with pytest.raises(rj.SceneError, match=r"measures 'cart.z', which is no coordinate; .*cart.x"):
        rj.assemble(rj.Scene([CART], [RAIL], [lost, PUSH]))
    with pytest.raises(rj.SceneError, match="period is 0"):
        rj.Sampled(0.0, clock.function, [], ["push"])
    with pytest.raises(rj.SceneError, match=r"sets is \('a', 'a'\)"):
        rj.Sampled(1.0, clock.function, [], ["a", "a"])
    with pytest.raises(rj.SceneError, match="a Sampled cannot be written to a file"):
        scene().save(tmp_path / "clock.toml")
    for ask in (rj.equilibrium, rj.modes, lambda system: rj.linearize(system, {}, {})):
        with pytest.raises(rj.InputError, match="the controller 'clock' acts at its ticks"):
            ask(rj.assemble(scene()))
    with pytest.raises(rj.InputError, match="sampled controllers act between the steps"):
        rj.export.c(rj.assemble(scene()), tmp_path / "clock")
