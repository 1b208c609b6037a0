"""jit, vmap, grad and jacfwd of whole simulations, against central differences."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from zoo import TIGHT

import romjax as rj

# Fixed steps: a step size control makes the motion jump in its parameters by its tolerance, which
# a difference quotient would divide by its step.
RUN = {"ts": jnp.linspace(0.0, 0.1, 5), "dt": 0.0125, "throw": False}
STEP = 1e-4  # of central differences, relative: the error is 1e-8 from h², 1e-11 from rounding
# A hinge that the start misses a little, so that the stabilisation matters.
MISSED = jnp.array([0.51, 0.0, 0.0])


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


PARAMETERS = (pendulum(), rj.Baumgarte(9.0, 30.0), MISSED, jnp.array([0.0, 0.5, 1.0]))


def loss(parameters, adjoint=None):
    """A number that depends on the scene, the stabilisation and the start."""
    scene, stabilization, q0, v0 = parameters
    motion = rj.simulate(
        rj.assemble(scene),
        q0=q0,
        v0=v0,
        stabilization=stabilization,
        adjoint=adjoint,
        **RUN,
    )
    return jnp.sum(motion.q[1:] ** 2) + 0.1 * jnp.sum(motion.v[-1]) + motion.multipliers[-1, 0] / 50


@pytest.fixture(scope="module")
def value():
    return jax.jit(loss)


@pytest.fixture(scope="module")
def gradient():
    return jax.jit(jax.grad(loss))(PARAMETERS)


@pytest.fixture(scope="module")
def differences(value):
    """Central differences with respect to every number of all parameters."""
    leaves, structure = jax.tree.flatten(PARAMETERS)
    found = []
    for place, leaf in enumerate(leaves):
        slopes = np.zeros(leaf.shape)
        for index in np.ndindex(leaf.shape):
            step = STEP * max(1.0, abs(float(leaf[index])))

            def at(change, place=place, index=index, leaf=leaf):
                moved = [
                    *leaves[:place],
                    leaf.at[index].add(change),
                    *leaves[place + 1 :],
                ]
                return float(value(jax.tree.unflatten(structure, moved)))

            slopes[index] = (at(step) - at(-step)) / (2 * step)
        found.append(slopes)
    return jax.tree.unflatten(structure, found)


def close(found, wanted, tolerance) -> bool:
    found, wanted = (
        np.concatenate([np.ravel(x) for x in jax.tree.leaves(y)]) for y in (found, wanted)
    )
    return bool(np.all(np.abs(found - wanted) <= tolerance * np.maximum(1, np.abs(wanted))))


@pytest.mark.exhaustive
def test_jit_changes_nothing(value):
    assert close(value(PARAMETERS), loss(PARAMETERS), IDENTITY)


def test_the_gradient_with_respect_to_a_scene_is_a_scene(gradient):
    scene = gradient[0]
    assert isinstance(scene, rj.Scene)
    assert jax.tree.structure(scene) == jax.tree.structure(PARAMETERS[0])
    assert scene.bodies[0].mass != 0
    assert scene.effects[0].rest_length != 0


def test_reverse_mode(gradient, differences):
    """Every number of the scene, α, β and the start, against central differences."""
    for found, wanted in zip(gradient, differences, strict=True):
        assert close(found, wanted, DIFFERENCED)
    assert gradient[1].alpha != 0


def test_forward_mode(gradient, differences):
    """By diffrax's forward adjoint, along each number of a few parameters."""
    scene, stabilization, q0, v0 = PARAMETERS

    def some(numbers):
        stiffness, mass, alpha, angle = numbers
        changed = jax.tree.map(lambda x: x, scene)
        changed = rj.Scene(
            [_replace(scene.bodies[0], mass=mass)],
            scene.joints,
            [_replace(scene.effects[0], stiffness=stiffness), *scene.effects[1:]],
        )
        moved = q0.at[2].set(angle)
        return loss(
            (changed, _replace(stabilization, alpha=alpha), moved, v0),
            diffrax.ForwardMode(),
        )

    found = jax.jit(jax.jacfwd(some))(jnp.array([50.0, 1.2, 9.0, 0.0]))

    def picked(tree):
        return [
            tree[0].effects[0].stiffness,
            tree[0].bodies[0].mass,
            tree[1].alpha,
            tree[2][2],
        ]

    assert close(found, picked(differences), DIFFERENCED)
    assert close(found, picked(gradient), SOLVED)


def _replace(part, **numbers):
    """The part with other numbers."""
    import dataclasses

    return dataclasses.replace(part, **numbers)


def test_a_batch_of_scenes(value):
    """Mapped over the stiffness, each lane is the run of its own."""
    scene, *rest = PARAMETERS

    def of(stiffness):
        spring = _replace(scene.effects[0], stiffness=stiffness)
        return loss((rj.Scene(scene.bodies, scene.joints, [spring, *scene.effects[1:]]), *rest))

    several = jnp.array([10.0, 50.0, 200.0])
    batch = jax.jit(jax.vmap(of))(several)
    alone = []
    for stiffness in several:
        spring = _replace(scene.effects[0], stiffness=stiffness)
        changed = rj.Scene(scene.bodies, scene.joints, [spring, *scene.effects[1:]])
        alone.append(value((changed, *rest)))
    assert close(batch, jnp.stack(alone), SOLVED)
    assert len(np.unique(batch)) == len(several)


def oscillator(stiffness):
    """A system that closes over its parameter."""
    return rj.CustomSystem(lambda q: jnp.eye(1), lambda t, q, v: -stiffness * q, q0=[1.0], v0=[0.0])


def test_a_parameter_closed_over():
    """With q = cos(√k t), ∂q/∂k = −t sin(√k t) / (2 √k); with the default step size control."""
    k, end = 7.0, 1.3

    def last(k):
        return rj.simulate(oscillator(k), jnp.array([0.0, end]), rtol=TIGHT).q[-1, 0]

    found, slope = jax.jit(jax.value_and_grad(last))(k)
    root = np.sqrt(k)
    assert abs(found - np.cos(root * end)) <= SOLVED
    assert abs(slope + end * np.sin(root * end) / (2 * root)) <= DIFFERENCED


def test_a_bad_lane_is_marked_and_the_others_finish():
    """One lane of a batch needs more steps than it has, one is NaN and ends long before."""

    def run(stiffness):
        return rj.simulate(oscillator(stiffness), jnp.array([0.0, 1.0]), max_steps=100, throw=False)

    batch = jax.vmap(run)(jnp.array([1.0, 1e8, 4.0, jnp.nan]))
    assert batch.status.tolist() == [
        rj.Status.SUCCESS,
        rj.Status.MAX_STEPS,
        rj.Status.SUCCESS,
        rj.Status.NOT_FINITE,
    ]
    assert batch.stats.num_steps[3] < 30
    assert np.allclose(batch.q[jnp.array([0, 2]), -1, 0], np.cos([1.0, 2.0]), rtol=0, atol=1e-5)


@pytest.fixture(scope="module")
def by_rodas():
    return rj.simulate(rj.assemble(pendulum()), RUN["ts"], rtol=TIGHT, solver=rj.Rodas5P())


@pytest.mark.parametrize(
    "solver",
    [diffrax.Tsit5(), pytest.param(diffrax.Kvaerno5(), marks=pytest.mark.exhaustive)],
    ids=["Tsit5", "Kvaerno5"],
)
def test_any_solver(by_rodas, solver):
    """Explicit and implicit methods of diffrax agree with romjax's own."""
    motion = rj.simulate(rj.assemble(pendulum()), RUN["ts"], rtol=TIGHT, solver=solver)
    assert close((motion.q, motion.v), (by_rodas.q, by_rodas.v), SOLVED)
    assert motion.solver == solver


def test_methods_of_a_system_can_be_jitted():
    """`jax.jit(system.acceleration)` compiles once, however often the method is looked up."""
    system = rj.assemble(rj.gallery.chain(1))
    arguments = (0.0, system.q0, system.v0)
    first, again = jax.jit(system.acceleration), jax.jit(system.acceleration)
    for a, b in zip(first(*arguments), again(*arguments), strict=True):
        assert jnp.array_equal(a, b)
    assert hash(system.acceleration) == hash(system.acceleration)
