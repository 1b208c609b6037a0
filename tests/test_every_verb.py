"""Every verb on every structure of the zoo: a right value, or a refusal in words; no cell is empty.

Most faults stand where two features meet that were each tested alone.
"""

import functools

import jax
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import SOLVED

import romjax as rj

pytestmark = pytest.mark.exhaustive

TS = np.linspace(0.0, 0.4, 41)
# Required of runs and models at the defaults, against runs at the tight tolerance.
ERROR = 1e-5
# Of velocities against differences of positions, relative to the largest velocity; and of forces
# that are left in an equilibrium.
DIFFERENT, BALANCED = 0.1, 1e-9
STRUCTURES = {
    "bar": zoo.bar,
    "bars": zoo.bars,
    "four-bar": zoo.four_bar,
    "pinned twice": functools.partial(zoo.four_bar, doubled=True),
    "driven": zoo.driven_four_bar,
    "cart": zoo.cart_pendulum,
    "slider crank": zoo.slider_crank,
    "bending rod": functools.partial(zoo.slider_crank, bends=True),
    "five-bar": zoo.five_bar,
    "falling beams": zoo.falling_beams,
    "top": zoo.top,
    "ball joints": zoo.ball_bars,
    "loop in space": zoo.loop_in_space,
    "beam in space": zoo.beam_in_space,
}
# No position of theirs near the start is in balance, or it is level, where weight has no stiffness.
UNBALANCED = {"bar", "top", "ball joints", "beam in space"}
FLEXIBLE = {"cart", "bending rod", "falling beams", "beam in space"}
REFUSED = {
    **{("equilibrium", name): "no equilibrium" for name in UNBALANCED},
    **{("local", name): "no body that deforms" for name in STRUCTURES if name not in FLEXIBLE},
}
# Subspaces that miss more of the motion than a run does, by the tolerance of their rank.
MISSED = {("galerkin", "five-bar"), ("galerkin", "beam in space")}


@functools.cache
def case(name):
    """The scene, its system, and a run at the tight tolerance."""
    scene = STRUCTURES[name]()
    system = rj.assemble(scene)
    return scene, system, rj.simulate(system, TS, rtol=zoo.TIGHT, audit=False)


def simulate(name):
    _, system, truth = case(name)
    run = rj.simulate(system, TS)
    assert run.is_valid
    assert rj.compare(truth, run).error <= ERROR


def in_batches(name):
    """Two lanes of one program, from two starts of which one is the run's."""
    _, system, truth = case(name)
    starts = np.stack([np.asarray(system.v0), np.asarray(system.v0)])
    many = jax.jit(jax.vmap(lambda v: rj.simulate(system, TS, v0=v, throw=False)))(starts)
    assert np.all(np.asarray(many.flags) == 0)
    assert_close(many.q[1], truth.q, ERROR, scale=np.max(np.abs(truth.q)))


def equilibrium(name):
    _, system, _ = case(name)
    q = rj.equilibrium(system)
    a, _ = jax.jit(system.acceleration)(0.0, q, np.zeros_like(q))
    assert_close(a, 0.0, BALANCED, scale=np.max(np.abs(q)) + 10.0)


def modes(name):
    """Those of the linear model."""
    found, model = rj.modes(case(name)[1]), linear(name)
    assert np.all(np.isfinite(found.frequencies))
    wanted = np.sort(np.abs(np.linalg.eigvals(np.asarray(model.A))))
    sizes = np.sort(np.abs(np.asarray(found.values)))
    # Those at zero are the square roots of rounding.
    assert_close(sizes**2, wanted**2, BALANCED, scale=np.max(wanted**2, initial=1.0))


def linear(name):
    scene, system, _ = case(name)
    push = rj.Force(scene.bodies[-1].at(), np.eye(scene.dimension)[1], rj.Constant(1.0))
    return rj.linearize(system, {"push": push}, [system.structure.labels[0]])


def linearize(name):
    """Finite, of as many states as it names."""
    model = linear(name)
    assert model.A.shape == (len(model.states),) * 2
    assert all(np.all(np.isfinite(x)) for x in (model.A, model.B, model.C, model.D))


def reduced(formulation, name):
    _, system, truth = case(name)
    basis = formulation.basis(system, truth, rj.POD(tol=1e-9))
    run = rj.simulate(rj.reduce(system, basis, formulation), TS)
    error = rj.compare(truth, run).error
    if (formulation.name, name) in MISSED:
        assert error <= 1e3 * ERROR
    else:
        assert error <= ERROR
        assert run.is_valid, run.warnings()


def measure(name):
    scene, system, truth = case(name)
    point = rj.measure(system, truth, scene.bodies[-1].at())
    differences = np.gradient(np.asarray(point.position), TS, axis=0)[1:-1]
    scale = np.max(np.abs(point.velocity))
    assert_close(point.velocity[1:-1], differences, DIFFERENT, scale=scale)


def joint_forces(name):
    """One for each joint, at all times."""
    scene, system, truth = case(name)
    forces = rj.joint_forces(system, truth)
    assert len(forces) == len(scene.joints)
    assert all(np.all(np.isfinite(force.force)) for force in forces.values())


def energy(name):
    _, system, _ = case(name)
    run = rj.simulate(system, TS)
    balance = rj.energy(system, run).balance
    assert_close(balance, 0.0, ERROR, scale=float(run.balance.extent))


def from_a_file(name, folder):
    scene, _, truth = case(name)
    scene.save(folder / "scene.toml")
    system = rj.assemble(rj.load_scene(folder / "scene.toml"))
    run = rj.simulate(system, TS, rtol=zoo.TIGHT, audit=False)
    assert_close(run.q, truth.q, SOLVED, scale=np.max(np.abs(truth.q)))


VERBS = {
    "simulate": simulate,
    "batch": in_batches,
    "equilibrium": equilibrium,
    "modes": modes,
    "linearize": linearize,
    "galerkin": functools.partial(reduced, rj.Galerkin()),
    "minimal": functools.partial(reduced, rj.Minimal()),
    "local": functools.partial(reduced, rj.Local()),
    "measure": measure,
    "joint forces": joint_forces,
    "energy": energy,
}


@pytest.mark.filterwarnings("ignore:.*stiffen its bending")
@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_on_a_structure(verb, name):
    words = REFUSED.get((verb, name))
    if words is None:
        VERBS[verb](name)
        return
    with pytest.raises((rj.ReductionError, rj.SimulationError), match=words):
        VERBS[verb](name)


@pytest.mark.parametrize("name", STRUCTURES)
def test_a_structure_from_a_file(name, tmp_path):
    from_a_file(name, tmp_path)
