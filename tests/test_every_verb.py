"""Every verb on every structure: a right value, or a refusal in words; no cell is empty.

Most faults stand where two features meet that were each tested alone. What is refused, and the
names of all rows and columns, are those of the page that the site makes of them.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import structures
import verbs
import zoo
from comparison import assert_close
from page_data import data
from tolerances import IDENTITY, SOLVED
from verbs import COARSE, REFUSED, STRUCTURES, VERBS

import romjax as rj
from romjax.cli import main

TS = np.linspace(0.0, 0.4, 41)
# Required of runs and models at the defaults, against runs at the tight tolerance.
ERROR = 1e-5
# Of forces that are left in an equilibrium.
BALANCED = 1e-9
# Of derivatives and velocities against central differences with a step of this size.
SLOPE, STEP = 1e-5, 1e-6


@functools.cache
def case(name):
    """The scene, its system, and a run at the tight tolerance."""
    scene = scene_of(name)
    system = rj.assemble(scene)
    return scene, system, move(name, system, rtol=zoo.TIGHT, audit=False)


@functools.cache
def scene_of(name):
    return structures.MAKE[name]()


def events(name):
    """What happens to it."""
    return structures.EVENTS.get(name, lambda scene: [])(scene_of(name))


def move(name, system, **settings):
    """A run with what happens to the structure."""
    return rj.simulate(system, TS, events=[*events(name), *settings.pop("also", ())], **settings)


def weighing(scene, share):
    """The scene with a share of its weight."""
    effects = [
        dataclasses.replace(effect, acceleration=share * effect.acceleration)
        if isinstance(effect, rj.Gravity)
        else effect
        for effect in scene.effects
    ]
    return rj.Scene(scene.bodies, scene.joints, effects)


def simulate(name):
    _, system, truth = case(name)
    run = move(name, system)
    assert run.is_valid
    assert rj.compare(truth, run).error <= ERROR


def sweep(name):
    """Two lanes of one program, from two starts of which one is the run's."""
    _, system, truth = case(name)
    starts = np.stack([np.asarray(system.v0), np.asarray(system.v0)])
    swept = rj.sweep(lambda v: {"run": move(name, system, v0=v, throw=False)}, starts)
    assert np.all(swept.is_valid), swept.failures()
    assert_close(swept.values["run"].q[1], truth.q, ERROR, scale=np.max(np.abs(truth.q)))


def gradient(name):
    """Of accelerations and forces of joints, by states on the way and by the weight, along some
    direction.
    """
    scene, _, truth = case(name)
    k, chance = len(TS) // 2, np.random.default_rng(3)
    now = np.asarray(truth.q)[k], np.asarray(truth.v)[k], np.ones(())
    along = tuple(chance.normal(size=x.shape) for x in now)

    def answers(q, v, share):
        a, multipliers = rj.assemble(weighing(scene, share)).acceleration(TS[k], q, v)
        return jnp.concatenate([a, multipliers])

    @jax.jit
    def slopes(step):
        ends = [
            answers(*(x + h * d for x, d in zip(now, along, strict=True))) for h in (step, -step)
        ]
        return jax.jvp(answers, now, along)[1], (ends[0] - ends[1]) / (2 * step)

    slope, wanted = slopes(STEP)
    assert_close(slope, wanted, SLOPE, scale=np.max(np.abs(wanted)))


def watch(name):
    """The coordinate that moves most has the level there, and passes it as often between outputs as
    its values before and after tell: an odd number of times where it lies between them.
    """
    _, system, truth = case(name)
    q = np.asarray(truth.q)
    i, k = int(np.argmax(np.ptp(q, axis=0))), len(TS) // 2
    label, level = system.full.structure.labels[i], 0.5 * (q[k, i] + q[k + 1, i])
    crossing = rj.Crossing(rj.quantity.Coordinate(label), level)
    run = move(name, system, also=[crossing], rtol=zoo.TIGHT, audit=False)
    number = len(events(name))
    there = np.asarray(run.events.q)[np.asarray(run.events.happened)[:, number], i]
    assert_close(there, level, SOLVED, scale=np.ptp(q[:, i]))
    counts, _ = np.histogram(run.events.times(number), TS)
    assert np.array_equal(counts % 2 == 1, np.diff(np.sign(q[:, i] - level)) != 0)


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
    run = move(name, rj.reduce(system, basis, formulation))
    error = rj.compare(truth, run).error
    if (formulation.name, name) in COARSE:
        assert error <= 1e3 * ERROR
    else:
        assert error <= ERROR
        assert run.is_valid


def measure(name):
    """A velocity, by positions a little before and after."""
    scene, system, truth = case(name)
    k, marker = len(TS) // 2, scene.bodies[-1].at()
    velocity = np.asarray(rj.measure(system, truth, marker).velocity)[k]
    q, change = np.asarray(truth.q)[k], STEP * np.asarray(truth.v)[k]
    after, before = (rj.measure(system, x, marker).position for x in (q + change, q - change))
    wanted = np.squeeze(np.asarray(after) - np.asarray(before)) / (2 * STEP)
    assert_close(velocity, wanted, SLOPE, scale=np.max(np.abs(truth.v)))


def joint_forces(name):
    """One for each joint, at all times."""
    scene, system, truth = case(name)
    forces = rj.joint_forces(system, truth)
    assert len(forces) == len(scene.joints)
    assert all(np.all(np.isfinite(force.force)) for force in forces.values())


def energy(name):
    """What impacts take is no work of the parts; where bodies part from each other, steps at the
    defaults lose more than elsewhere.
    """
    _, system, _ = case(name)
    run = move(name, system, **({"rtol": 1e-8} if name in structures.TOUCHING else {}))
    history = rj.energy(system, run)
    balance = run.balance.largest if run.events is not None else history.balance
    scale = float(np.max(np.abs(run.balance.extent)))
    assert_close(balance, 0.0, ERROR, scale=scale)


def animate(name):
    """A marker's path is where it is measured, and the page tells all frames."""
    scene, system, truth = case(name)
    marker = scene.bodies[-1].at()
    moved = rj.animate(scene, truth, trace=marker)
    (trace,) = (o for o in moved.models[0].actual if o.style == "trace")
    wanted = np.asarray(rj.measure(system, truth, marker).position)
    assert_close(trace.points[:, 0], wanted, IDENTITY, scale=np.max(np.abs(wanted)))
    assert data(moved.html())["frames"] == len(TS)


def results(name, folder):
    """Numbers and words of a run that was saved are those that it had."""
    scene, _, truth = case(name)
    truth.save(folder / "run.nc", scene)
    read = rj.load(folder / "run.nc")
    for part in ("t", "q", "v", "violation", "multipliers", "metric"):
        assert np.array_equal(getattr(read, part), getattr(truth, part)), part
    assert (read.labels, read.warnings()) == (truth.labels, truth.warnings())


def from_a_file(name, folder):
    scene, _, truth = case(name)
    scene.save(folder / "scene.toml")
    system = rj.assemble(rj.load_scene(folder / "scene.toml"))
    run = move(name, system, rtol=zoo.TIGHT, audit=False)
    assert_close(run.q, truth.q, SOLVED, scale=np.max(np.abs(truth.q)))


def check(name, folder, capsys):
    """The file is described, with as many freedoms as there are modes."""
    scene, system, _ = case(name)
    scene.save(folder / "scene.toml")
    assert main(["check", str(folder / "scene.toml")]) == 0
    said = capsys.readouterr().out
    assert f"freedoms     {len(rj.modes(system).frequencies)}" in said
    assert "all joints hold" in said


RIGHT = {
    "simulate": simulate,
    "sweep": sweep,
    "gradient": gradient,
    "events": watch,
    "equilibrium": equilibrium,
    "modes": modes,
    "linearize": linearize,
    "galerkin": functools.partial(reduced, rj.Galerkin()),
    "minimal": functools.partial(reduced, rj.Minimal()),
    "local": functools.partial(reduced, rj.Local()),
    "measure": measure,
    "joint forces": joint_forces,
    "energy": energy,
    "animate": animate,
    "results": results,
    "file": from_a_file,
    "check": check,
}
NEEDED = {"results": ("folder",), "file": ("folder",), "check": ("folder", "capsys")}


@pytest.mark.instant
def test_the_page_names_every_cell():
    assert list(STRUCTURES) == list(structures.MAKE)
    assert list(VERBS) == list(RIGHT)
    cells = {(verb, name) for verb in VERBS for name in STRUCTURES}
    assert REFUSED.keys() | COARSE <= cells
    rows = [line for line in verbs.text().splitlines() if line.startswith("| **")]
    assert [line.count("|") for line in rows] == [len(VERBS) + 2] * len(STRUCTURES)


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("ignore:.*stiffen its bending", "ignore:.*not in balance")
@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_on_a_structure(verb, name, tmp_path, capsys):
    fixtures = {"folder": tmp_path, "capsys": capsys}
    needed = {key: fixtures[key] for key in NEEDED.get(verb, ())}
    words = REFUSED.get((verb, name))
    if words is None:
        RIGHT[verb](name, **needed)
        return
    with pytest.raises((rj.ReductionError, rj.SimulationError), match=words):
        RIGHT[verb](name, **needed)
