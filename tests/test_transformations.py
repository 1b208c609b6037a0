"""jit, vmap, grad and jacfwd of whole simulations, against central differences."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from costs import spent
from programs import kept
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import RODAS5P, TIGHT, oscillator, run, system, unit_mass
from zoo import bar as hanging

import romjax as rj

# Fixed steps: a step size control makes the motion jump in its parameters by its tolerance, which
# a difference quotient would divide by its step.
RUN = {"dt": 0.0125, "solver": diffrax.Tsit5(), "throw": False}
STEP = 1e-4  # of central differences, relative: the error is 1e-8 from h², 1e-11 from rounding
# A hinge that the start misses a little, so that the stabilisation matters.
MISSED = np.array([0.51, 0.0, 0.0])


def pendulum() -> rj.Scene:
    """A bar on a hinge, with a spring that has a rest length, a damper, a load and gravity."""
    bar = rj.RigidBody("bar", mass=1.2, inertia=0.1, position=(0.5, 0.0))
    tip = bar.at((0.5, 0.1))
    return rj.Scene(
        bodies=[bar],
        joints=[rj.Revolute(bar.at((-0.5, 0.0)), rj.ground.at())],
        effects=[
            rj.Spring(tip, rj.ground.at((0.4, 1.0)), stiffness=50.0, rest_length=0.6),
            rj.Damper(tip, rj.ground.at(), damping=2.0),
            rj.Force(bar.at(), (1.0, 0.3), rj.Sine(5.0, 2.0, phase=0.3)),
            rj.Gravity(),
        ],
    )


PARAMETERS = (pendulum(), rj.Baumgarte(9.0, 30.0), MISSED, np.array([0.0, 0.5, 1.0]))


def loss(parameters, adjoint=None):
    """A number that depends on the scene, the stabilisation and the start."""
    scene, stabilization, q0, v0 = parameters
    settings = {"stabilization": stabilization, "adjoint": adjoint, **RUN}
    motion = run(rj.assemble(scene), jnp.linspace(0.0, 0.1, 5), q0=q0, v0=v0, **settings)
    return jnp.sum(motion.q[1:] ** 2) + 0.1 * jnp.sum(motion.v[-1]) + motion.multipliers[-1, 0] / 50


@kept
def loss_and_slopes(parameters):
    return jax.value_and_grad(loss)(parameters)


@kept
def losses(parameters):
    return jax.vmap(loss)(parameters)


@pytest.fixture(scope="module")
def reverse():
    """The loss, and its gradient as a tree."""
    return loss_and_slopes(PARAMETERS)


@pytest.fixture(scope="module")
def batch():
    """Parameters in lanes: without a change, and with each number of all moved to either side; and
    these moves.
    """
    leaves, structure = jax.tree.flatten(jax.tree.map(np.asarray, PARAMETERS))
    sizes = [leaf.size for leaf in leaves]
    start = np.concatenate([np.ravel(leaf) for leaf in leaves])
    moves = np.diag(STEP * np.maximum(1.0, np.abs(start)))
    lanes = start + np.concatenate([np.zeros((1, len(start))), moves, -moves])
    columns = np.split(lanes, np.cumsum(sizes)[:-1], axis=1)
    moved = [x.reshape(-1, *leaf.shape) for x, leaf in zip(columns, leaves, strict=True)]
    return jax.tree.unflatten(structure, moved), np.diag(moves)


@pytest.fixture(scope="module")
def alone(batch):
    """The loss of each lane by a run of its own."""
    leaves, structure = jax.tree.flatten(batch[0])
    lanes = [list(map(np.asarray, numbers)) for numbers in zip(*leaves, strict=True)]
    return np.array([loss_and_slopes(jax.tree.unflatten(structure, lane))[0] for lane in lanes])


@pytest.mark.exhaustive
def test_jit_changes_nothing():
    value = loss(PARAMETERS)
    assert_close(jax.jit(loss)(PARAMETERS), value, IDENTITY, scale=abs(value))


@pytest.mark.slow
def test_the_gradient_with_respect_to_a_scene_is_a_scene(reverse):
    scene = reverse[1][0]
    assert isinstance(scene, rj.Scene)
    assert jax.tree.structure(scene) == jax.tree.structure(PARAMETERS[0])
    assert scene.bodies[0].mass != 0
    assert scene.effects[0].rest_length != 0


def test_reverse_mode(reverse, batch, alone):
    """Every number of the scene, α, β and the start, against central differences."""
    up, down = np.split(alone[1:], 2)
    wanted = (up - down) / (2 * batch[1])
    found = np.concatenate([np.ravel(x) for x in jax.tree.leaves(reverse[1])])
    assert_close(found, wanted, DIFFERENCED, scale=np.maximum(1, np.abs(wanted)))
    assert reverse[1][1].alpha != 0


@pytest.mark.slow
def test_a_batch_of_scenes(batch, alone):
    """Each lane is a scene of its own."""
    assert_close(losses(batch[0]), alone, SOLVED)


@pytest.mark.slow
def test_forward_mode(reverse):
    """By diffrax's forward adjoint, along all numbers at once."""
    leaves = jax.tree.leaves(PARAMETERS)
    rng = np.random.default_rng(2)
    along = [rng.normal(size=np.shape(leaf)) for leaf in leaves]
    direction = jax.tree.unflatten(jax.tree.structure(PARAMETERS), along)

    @jax.jit
    def slope(parameters, direction):
        return jax.jvp(lambda x: loss(x, diffrax.ForwardMode()), (parameters,), (direction,))[1]

    found = slope(jax.tree.map(jnp.asarray, PARAMETERS), jax.tree.map(jnp.asarray, direction))
    slopes = [np.asarray(x) for x in jax.tree.leaves(reverse[1])]
    terms = [np.sum(x * y) for x, y in zip(slopes, along, strict=True)]
    assert_close(found, sum(terms), SOLVED, scale=sum(np.abs(terms)))


def swing(stiffness) -> rj.CustomSystem:
    """A system that closes over its parameter."""
    return rj.CustomSystem(unit_mass, lambda t, q, v: -stiffness * q, q0=[1.0], v0=[0.0])


def test_a_parameter_closed_over_in_lanes_of_which_two_are_bad():
    """With q = cos(√k t), ∂q/∂k = −t sin(√k t) / (2 √k). One lane of the batch needs more steps
    than it has, one is NaN and ends long before; the others have their values and slopes.
    """
    k, end = np.array([7.0, 1e8, 4.0, np.nan]), 1.3

    def last(k):
        made = run(swing(k), jnp.array([0.0, end]), max_steps=100, throw=False)
        return made.q[-1, 0], (made.status, made.stats.num_steps)

    by = jax.value_and_grad(last, has_aux=True)
    (found, (status, steps)), slopes = jax.tree.map(np.asarray, jax.jit(jax.vmap(by))(k))
    assert status.tolist() == [
        rj.Status.SUCCESS,
        rj.Status.MAX_STEPS,
        rj.Status.SUCCESS,
        rj.Status.NOT_FINITE,
    ]
    assert steps[3] < 30
    good, root = [0, 2], np.sqrt(k[[0, 2]])
    assert_close(found[good], np.cos(root * end), SOLVED)
    assert_close(slopes[good], -end * np.sin(root * end) / (2 * root), DIFFERENCED)


@pytest.mark.parametrize(
    "solver",
    [pytest.param(diffrax.Tsit5(), marks=pytest.mark.exhaustive), RODAS5P, diffrax.Kvaerno5()],
    ids=["Tsit5", "Rodas5P", "Kvaerno5"],
)
def test_any_solver(solver):
    """Explicit and implicit methods of diffrax and romjax's own agree with the exact solution;
    other numbers of outputs are the same program.
    """
    ts, two = np.linspace(0.0, 1.0, 5), oscillator((2.0, 5.0))
    motion = run(two, ts, solver=solver, rtol=TIGHT / 10)
    programs, *_ = spent()
    other = run(two, np.linspace(0.0, 1.0, 7), solver=solver, rtol=TIGHT / 10)
    assert spent()[0] == programs
    assert_close(other.q[-1], motion.q[-1], SOLVED)
    omega = np.array([2.0, 5.0])
    assert_close(motion.q, np.cos(omega * ts[:, None]), SOLVED)
    assert_close(motion.v, -omega * np.sin(omega * ts[:, None]), SOLVED, scale=omega)
    assert motion.solver == solver


@pytest.mark.parametrize("mode", ["reverse", "forward"])
def test_derivatives_of_a_run_that_does_not_end_are_no_numbers(mode):
    """Zero would be a minimum; outputs that the run gets to keep theirs."""
    adjoint, derivative = None, jax.jacrev
    if mode == "forward":
        adjoint, derivative = diffrax.ForwardMode(), jax.jacfwd

    def at(start):
        ts = np.array([0.0, 0.01, 10.0])
        settings = {"max_steps": 8, "throw": False, "adjoint": adjoint}
        return rj.simulate(oscillator(), ts, q0=start, **settings).q[jnp.array([1, -1]), 0]

    reached, missed = jax.jit(derivative(at))(np.ones(1))
    assert np.all(np.isfinite(reached))
    assert not np.any(np.isfinite(missed))


def test_methods_of_a_system_can_be_jitted():
    """`jax.jit(system.acceleration)` compiles once, however often the method is looked up."""
    made = system(hanging)
    arguments = (0.0, made.q0, made.v0)
    first, again = jax.jit(made.acceleration), jax.jit(made.acceleration)
    for a, b in zip(first(*arguments), again(*arguments), strict=True):
        assert np.array_equal(a, b)
    assert hash(made.acceleration) == hash(made.acceleration)
