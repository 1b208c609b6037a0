"""Compiled models within programs of JAX: their runs, batches, derivatives, and what takes them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY, SOLVED
from zoo import DOPRI8, RODAS5P

import romjax as rj

TS = np.linspace(0.0, 0.5, 26)
HELD = rj.Baumgarte(alpha=12.0, beta=36.0)
NOMINAL = {"mass": 1.0, "length": 1.0}
# Derivatives of two runs whose steps may differ: some hundred of their tolerances.
DERIVED = 1e-8
SETTINGS = {"stabilization": HELD, "audit": False}


def pendulum(mass, length):
    """A bar with a spring, whose start follows its length."""
    bar = rj.RigidBody("bar", mass, mass * length**2 / 12, position=(length / 2, 0.0))
    hinge = rj.Revolute(bar.at((-length / 2, 0.0)), rj.ground.at(), name="hinge")
    kick = rj.Torque(bar.at(), rj.Table([0.0, 0.1, 0.2, 0.3], [0.0, 0.0, 4.0, 0.0]))
    return rj.assemble(rj.Scene([bar], [hinge], [rj.Gravity((0.0, -9.81)), kick]))


@pytest.fixture(scope="module")
def model():
    return rj.compile(pendulum, NOMINAL)


def moved(model, p, **settings):
    given = {"solver": DOPRI8, "stabilization": HELD, **settings}
    return model.simulate(TS, parameters=dict(zip(NOMINAL, p, strict=True)), **given)


def cart(stiffness, damping):
    return rj.assemble(rj.gallery.cart_pendulum(stiffness=stiffness, damping=damping))


@pytest.fixture(scope="module")
def compiled_cart():
    return rj.compile(cart, {"stiffness": 100.0, "damping": 0.1})


def sensors(run):
    return run.q[:, np.array([0, 5, 6])]


@pytest.mark.slow
def test_programs_and_batches_have_the_same_runs(model):
    """As outside, whatever is batched."""
    usual = model.simulate(TS, solver=DOPRI8, stabilization=HELD)
    inside = jax.jit(lambda p: moved(model, p).q)
    np.testing.assert_array_equal(inside(jnp.array([1.0, 1.0])), usual.q)
    lanes = jnp.array([[1.0, 1.0], [1.4, 0.7], [0.8, 1.2]])
    each = np.stack([inside(p) for p in lanes])
    np.testing.assert_array_equal(jax.jit(jax.vmap(lambda p: moved(model, p).q))(lanes), each)
    speeds = jnp.array([0.0, 0.3])

    def spinning(p, speed):
        v = speed * jnp.array([0.0, 0.5 * p[1], 1.0])
        return moved(model, p, q0=jnp.array([0.5 * p[1], 0.0, 0.0]), v0=v).q

    both = jax.jit(jax.vmap(jax.vmap(spinning, (None, 0)), (0, None)))(lanes, speeds)
    assert both.shape == (3, 2, len(TS), 3)
    np.testing.assert_array_equal(both[:, 0], each)
    new = zoo.run(pendulum(1.4, 0.7), TS)
    assert_close(moved(model, (1.4, 0.7), rtol=zoo.TIGHT).q, np.asarray(new.q), SOLVED)


@pytest.mark.slow
@pytest.mark.parametrize("stiff", [False, True])
def test_derivatives_are_those_of_simulate(model, compiled_cart, stiff):
    """By parameters, on which the start depends, and by the start; in batches as alone."""
    which, make, p = (
        (compiled_cart, cart, jnp.array([90.0, 0.2]))
        if stiff
        else (model, pendulum, jnp.array([1.3, 0.8]))
    )
    settings = {"solver": RODAS5P if stiff else DOPRI8, "stabilization": HELD, "throw": False}
    settings["rtol"] = zoo.TIGHT

    def native(p, speed):
        given = dict(zip(which.parameters, p, strict=True))
        system = make(**given)
        q0, v0 = system.q0, system.v0 + speed * jnp.eye(system.n)[0] * stiff
        run = which.simulate(TS, q0=q0, v0=v0, parameters=given, **settings)
        return jnp.concatenate([run.q, run.v], axis=1)

    def usual(p, speed):
        system = make(*p)
        v0 = system.v0 + speed * jnp.eye(system.n)[0] * stiff
        run = rj.simulate(system, TS, v0=v0, audit=False, **settings)
        return jnp.concatenate([run.q, run.v], axis=1)

    with rj.forward_mode():
        wanted = rj.jit(jax.jacfwd(usual, (0, 1)))(p, 0.1)
    derived = jax.jit(jax.jacfwd(native, (0, 1)))
    for one, other in zip(derived(p, 0.1), wanted, strict=True):
        size = np.max(np.abs(other), axis=(0, 1))
        assert_close(np.asarray(one), np.asarray(other), DERIVED, scale=size)
    lanes = jnp.stack([p, 1.1 * p])
    batch = jax.jit(jax.vmap(jax.jacfwd(native), (0, None)))(lanes, 0.1)
    other = jax.jit(jax.jacfwd(jax.vmap(native, (0, None))))(lanes, 0.1)
    alone = derived(p, 0.1)[0]
    size = np.max(np.abs(alone))
    assert_close(np.asarray(batch[0]), np.asarray(alone), IDENTITY, scale=size)
    assert_close(np.asarray(other[0][..., 0, :]), np.asarray(alone), IDENTITY, scale=size)


@pytest.mark.slow
def test_the_start_follows_in_derivatives(model):
    """Nobody gives it, and it is the half of a length."""
    along = jax.jacfwd(lambda p: moved(model, p).q[0])(jnp.array([1.0, 1.2]))
    np.testing.assert_array_equal(along, [[0.0, 0.5], [0.0, 0.0], [0.0, 0.0]])


@pytest.mark.slow
def test_fits_sweeps_and_likelihoods_take_it(model):
    def native(p):
        return moved(model, (p["mass"], p["length"]), throw=False).q

    def usual(p):
        system = pendulum(p["mass"], p["length"])
        run = rj.simulate(system, TS, solver=DOPRI8, throw=False, **SETTINGS)
        return run.q

    true, start = {"mass": 1.3, "length": 0.9}, {"mass": 1.0, "length": 1.0}
    measured = np.asarray(native(true)) + 1e-3 * np.random.default_rng(0).normal(size=(26, 3))
    found, other = (rj.fit(each, start, measured, noise=1e-3) for each in (native, usual))
    assert found.success
    for name in true:
        # The search ends within some of these of the least residual.
        assert abs(found.parameters[name] - other.parameters[name]) <= 1e-6
        assert_close(found.standard_errors[name], other.standard_errors[name], 1e-4)
    values = [float(rj.log_likelihood(each, true, measured, 1e-3)) for each in (native, usual)]
    assert abs(values[0] - values[1]) <= 1e-5 * abs(values[1])
    lanes = {"mass": np.linspace(0.5, 2.0, 5), "length": np.linspace(0.8, 1.2, 5)}
    swept = rj.sweep(lambda p: moved(model, (p["mass"], p["length"]), throw=False), lanes)
    assert np.all(swept.is_valid)
    assert_close(swept.values.q[3], native({key: x[3] for key, x in lanes.items()}), IDENTITY)


@pytest.mark.slow
def test_failures_are_told(model):
    def failed(p):
        run = moved(model, p, max_steps=3, throw=False)
        return run.q, run.status

    point = jnp.array([1.0, 1.0])
    (q, status), (slope, _) = jax.jit(lambda p: jax.jvp(failed, (p,), (p,)))(point)
    assert int(status) == rj.Status.MAX_STEPS
    assert np.all(np.isnan([q[-1], slope[-1]]))
    with pytest.raises(rj.SimulationError, match="took 3 steps"):
        moved(model, (1.0, 1.0), max_steps=3)
    with pytest.raises(ValueError, match="the start violates"):
        moved(model, (1.0, 1.0), q0=np.array([0.5, 0.3, 0.0]))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"parameters": {"mas": 1.0}}, "Did you mean 'mass'"),
        ({"parameters": {"mass": np.ones(2)}}, "parameter mass"),
    ],
)
def test_wrong_parameters_are_named(model, settings, words):
    with pytest.raises(rj.InputError, match=words):
        model.simulate(TS, solver=DOPRI8, stabilization=HELD, **settings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "words"),
    [
        (
            lambda m: jax.grad(lambda p: jnp.sum(moved(m, p).q))(jnp.ones(2)),
            "in forward mode alone",
        ),
        (lambda m: jax.jit(lambda ts: m.simulate(ts).q)(TS), "traces the output times"),
        (lambda m: jax.jit(lambda r: moved(m, np.ones(2), rtol=r).q)(1e-6), "the tolerances"),
        (
            lambda m: jax.jit(
                lambda p: moved(m, p, stabilization=rj.Baumgarte(alpha=12.0, beta=36.0)).q
            )(np.ones(2)),
            "α and β of Baumgarte's terms",
        ),
        (
            lambda m: jax.jacfwd(
                lambda ts: m.simulate(ts, solver=DOPRI8, stabilization=HELD, throw=False).q
            )(jnp.asarray(TS)),
            "not by output times",
        ),
    ],
)
def test_what_programs_cannot_have(model, function, words):
    with pytest.raises(rj.InputError, match=words):
        function(model)
