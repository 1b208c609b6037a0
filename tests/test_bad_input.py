"""What makes no sense is refused at once, in words that name the culprit and the remedy."""

import dataclasses
import functools

import diffrax
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
import zoo
from motions import through

import romjax as rj
from romjax.assembly.locate import locate
from romjax.basis.snapshots import SnapshotSet
from romjax.integrate.failures import _describe_times as describe_times
from romjax.system.reduced import check_alike


@pytest.fixture(autouse=True)
def _as_users_run():
    """Without the run-time checks of types and shapes, which only the tests switch on."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)


NAN = float("nan")


def bar(name="bar", **changes):
    return rj.RigidBody(name, **({"mass": 1.0, "inertia": 1.0} | changes))


def oscillator(**changes):
    given = {
        "mass": lambda q: jnp.eye(1),
        "force": lambda t, q, v: -q,
        "q0": [1.0],
        "v0": [0.0],
    }
    return rj.CustomSystem(**(given | changes))


class Recorded:
    """A motion that was measured: all that a basis needs."""

    def __init__(self, q):
        self.q = jnp.asarray(q)
        self.v = jnp.asarray(np.gradient(q, axis=0))
        self.t = jnp.asarray(np.arange(float(len(q))))
        self.metric = jnp.asarray(np.eye(q.shape[1]))
        self.labels = ()


RICH = Recorded(np.cos(np.outer(np.arange(9.0), np.arange(1.0, 4.0))))
PLANE = Recorded(np.stack([np.cos(np.arange(9.0)), np.sin(np.arange(9.0)), np.ones(9)], 1))
SYSTEMS = {
    "mass of a wrong shape": (
        lambda: oscillator(mass=lambda q: jnp.eye(2)),
        r"CustomSystem: mass\(q\) has shape \(2, 2\), but it must have shape \(1, 1\)",
    ),
    "force of a wrong shape": (
        lambda: oscillator(force=lambda t, q, v: jnp.sum(q)),
        r"CustomSystem: force\(t, q, v\) has shape \(\)",
    ),
    "constraint of a wrong shape": (
        lambda: oscillator(constraint=lambda t, q: q[0]),
        r"CustomSystem: constraint\(t, q\) has shape \(\)",
    ),
    "more constraints than coordinates": (
        lambda: oscillator(constraint=lambda t, q: jnp.concatenate([q, q])),
        "2 constraints on 1 coordinates leave no motion",
    ),
    "NaN start of a system": (lambda: oscillator(q0=[NAN]), "CustomSystem: q0 is .*finite"),
}


@pytest.mark.parametrize(("make", "words"), SYSTEMS.values(), ids=SYSTEMS)
def test_systems(make, words):
    """What is no scene is refused without speaking of one."""
    with pytest.raises(rj.InputError, match="(?s)" + words) as refusal:
        make()
    assert refusal.type is rj.InputError


STARTS = {
    "one time": ({"ts": [0.0]}, "ts has 1 entries; give the start and the end"),
    "times that stand still": ({"ts": [0.0, 0.1, 0.1]}, r"ts must increase, but ts\[1\] = 0\.1"),
    "times that run back": ({"ts": [0.0, 0.2, 0.1]}, r"ts\[1\] = 0\.2 is followed by 0\.1"),
    "NaN time": ({"ts": [0.0, NAN]}, "simulate: ts is .*finite"),
    "times in a matrix": ({"ts": [[0.0, 1.0]]}, r"ts has shape \(1, 2\).*one axis"),
    "NaN start": ({"q0": [NAN]}, "simulate: q0 is .*finite"),
    "infinite start": ({"v0": [float("inf")]}, "simulate: v0 is .*finite"),
    "adjoint that runs backwards": (
        {"adjoint": diffrax.BacksolveAdjoint()},
        r"adjoint=BacksolveAdjoint\(\).*by diffrax\.ForwardMode\(\).* without an adjoint",
    ),
    "start of a wrong length": ({"q0": [0.0, 1.0]}, r"q0 has shape \(2,\).*\(1\)"),
    "method as a class": (
        {"solver": rj.Rodas5P},
        r"solver is the class Rodas5P; give .* romjax\.Rodas5P\(\)",
    ),
    "method without errors": ({"solver": diffrax.Euler()}, "Euler does not estimate .*; give dt"),
    "stabilization in words": (
        {"stabilization": "baumgarte"},
        r"stabilization is of type str; give romjax\.Baumgarte\(alpha, beta\)",
    ),
    "adjoint in words": ({"adjoint": "forward"}, "adjoint is of type str; give .*ForwardMode"),
    "no tolerance": ({"rtol": 0.0}, r"rtol is 0\.0, but it must be positive"),
    "negative tolerance": ({"rtol": jnp.asarray(-1.0)}, r"rtol is -1\.0, .* positive"),
    "tolerance in words": ({"rtol": "1e-6"}, "rtol is of type str; give a positive number"),
    "tolerances in a list": ({"rtol": np.array([1e-6])}, r"rtol has shape \(1,\), .*single number"),
    "no absolute tolerance": ({"atol": 0}, "atol is 0, but it must be positive"),
    "step back": ({"dt": -0.1}, r"dt is -0\.1, but it must be positive"),
    "no steps": ({"max_steps": 0}, "max_steps=0, .* at least one step"),
    "room for less than nothing": ({"dense": -1}, "dense=-1; .* room"),
}


@pytest.mark.parametrize(("changes", "words"), STARTS.values(), ids=STARTS)
def test_times_and_starts(changes, words):
    with pytest.raises(ValueError, match=words) as refusal:
        rj.simulate(oscillator(), **({"ts": [0.0, 1.0]} | changes))
    assert not issubclass(refusal.type, rj.SceneError)


KINDS = {
    "scene that is simulated": (
        lambda: rj.simulate(rj.Scene([bar()], [], []), [0.0, 1.0]),
        r"simulate: the system is of type Scene; give what romjax\.assemble\(scene\)",
    ),
    "scene that vibrates": (lambda: rj.modes(rj.Scene([bar()], [], [])), "modes: .*Scene"),
    "list of bodies": (lambda: rj.assemble([bar()]), r"the scene is of type list; .*romjax\.Scene"),
    "basis first": (
        lambda: rj.reduce(rj.Basis.from_modes(np.eye(1), np.zeros(1)), oscillator()),
        "reduce: the system is of type Basis",
    ),
    "system as a basis": (
        lambda: rj.reduce(oscillator(), oscillator()),
        r"reduce: the basis is of type CustomSystem; .*romjax\.pod",
    ),
    "systems that are compared": (
        lambda: rj.compare(oscillator(), oscillator()),
        r"compare: a motion is of type CustomSystem; give runs of romjax\.simulate",
    ),
    "array as a motion": (lambda: rj.pod(np.ones((3, 2))), "a motion is of type ndarray"),
    "system as a motion": (lambda: rj.sod(oscillator()), "a motion is of type CustomSystem"),
    "run of another system": (
        lambda: rj.energy(rj.assemble(rj.Scene([bar()], [], [])), _motion([0.0, 1.0])),
        r"energy: the run has the coordinates .*, but the system bar\.x",
    ),
    "system that is capped": (
        lambda: rj.cap(oscillator(), 10.0),
        r"cap: the scene is of type CustomSystem; give the romjax\.Scene that a system is",
    ),
    "system in words": (lambda: rj.describe(oscillator()), "describe: the basis is .*CustomSystem"),
    "scene as the times": (
        lambda: rj.simulate(oscillator(), rj.Scene([bar()], [], [])),
        r"ts is of type Scene and no array of times; give .* jax\.numpy\.linspace",
    ),
    "list of runs where one is": (
        lambda: rj.measure(
            rj.assemble(rj.Scene([bar()], [], [])), [_motion([0.0, 1.0])], bar().at()
        ),
        "measure: the run is of type list, and not of numbers; give one run",
    ),
    "scene that rests": (
        lambda: rj.measure(rj.Scene([bar()], [], []), [0.0, 0.0, 0.0], bar().at()),
        r"measure: the system is of type Scene; give what romjax\.assemble",
    ),
    "numbers that predict": (lambda: rj.fit(1.0, 1.0, [1.0]), "predict is of type float; .*funct"),
    "scene that loses rank": (
        lambda: rj.singular_position(rj.Scene([bar()], [], []), _motion([0.0, 1.0])),
        "singular_position: the system is of type Scene",
    ),
    "run of another system that loses rank": (
        lambda: rj.singular_position(rj.assemble(rj.Scene([bar()], [], [])), _motion([0.0, 1.0])),
        r"singular_position: the run has the coordinates .*, but the system bar\.x",
    ),
    "full system whose reactions follow from it": (
        lambda: rj.reactions(_oscillator(), _motion([0.0, 1.0])),
        r"reactions: the system is no reduced model; .* romjax\.joint_forces",
    ),
    "run of another system as that of a model": (
        lambda: rj.reactions(
            rj.reduce(rj.assemble(rj.Scene([bar()], [], [])), formulation="joint"),
            _motion([0.0, 1.0]),
        ),
        r"reactions: the run has the coordinates .*, but the system bar\.x",
    ),
    "scene that is extrapolated": (
        lambda: rj.extrapolate(rj.Scene([bar()], [], []), *[_motion([0.0, 1.0])] * 2),
        "extrapolate: the system is of type Scene",
    ),
    "name as a marker": (
        lambda: locate("measure", rj.assemble(rj.Scene([bar()], [], [])), ["bar"]),
        r"measure: the marker is of type str; give .* body\.at\(point\)",
    ),
    "number as an input": (
        lambda: rj.linearize(oscillator(), {"push": 1.0}, {}),
        "linearize: input 'push' is of type float; give an effect or a function",
    ),
}


@pytest.mark.parametrize(("make", "words"), KINDS.values(), ids=KINDS)
def test_kinds(make, words):
    """What is of another kind than its place is for."""
    with pytest.raises(rj.InputError, match=words):
        make()


RANKS = {
    "rank and tol": (RICH, {"rank": 2, "tol": 0.1}, "give rank=2 or tol=0.1, not both"),
    "no rank": (RICH, {"rank": 0}, "rank=0, but the snapshots allow 1 to 3"),
    "rank above n": (RICH, {"rank": 4}, "rank=4, but the snapshots allow 1 to 3"),
    "rank above the span": (
        PLANE,
        {"rank": 3},
        "rank=3, but the snapshots span only 2 directions.*ask for at most 2",
    ),
    "rank in words": (RICH, {"rank": "best"}, "rank='best'; give a whole number or \"drop\""),
    "tolerance of nothing": (RICH, {"tol": 0.0}, r"tol=0\.0, but it must lie between 0 and 1"),
    "at rest": (Recorded(np.ones((4, 2))), {}, "the snapshots do not move.*simulate a motion"),
}


@pytest.mark.parametrize("decompose", [rj.pod, rj.sod])
@pytest.mark.parametrize(("motion", "choice", "words"), RANKS.values(), ids=RANKS)
def test_ranks(decompose, motion, choice, words):
    with pytest.raises(ValueError, match=f"{decompose.__name__.upper()}: .*{words}"):
        decompose(motion, **choice)


def test_snapshots_that_no_motion_has():
    """A single number that is none, and times that go back, of motions and of blocks of one."""
    t, q = np.arange(4.0), np.random.default_rng(0).normal(size=(4, 2))
    holed = np.where(np.arange(8).reshape(4, 2) == 3, NAN, q)
    stream = rj.PodStream.start(np.eye(2), np.zeros(2))
    given = {
        "not finite; did the simulation succeed": (t, holed, q),
        "times of a motion go back, from 3 to 2 s; give snapshots in the order": (t[::-1], q, q),
    }
    for words, snapshots in given.items():
        motion = Recorded(snapshots[1])
        motion.t, motion.v = snapshots[0], snapshots[2]
        for decompose in (rj.pod, rj.sod, lambda motion: stream.add(motion.t, motion.q, motion.v)):
            with pytest.raises(rj.InputError, match=words):
                decompose(motion)
    with pytest.raises(rj.InputError, match=r"PodStream.add: q has shape \(4, 2\).*\(3, 2\)"):
        stream.add(t[:3], q, q[:3])


def test_bases_of_a_wrong_shape():
    with pytest.raises(ValueError, match=r"modes \(3, 2\) and offset \(2,\) do not fit"):
        rj.Basis.from_modes(np.ones((3, 2)), np.zeros(2))


def test_reductions():
    system = oscillator()
    basis = rj.Basis.from_modes(np.eye(1), np.zeros(1))
    with pytest.raises(rj.ReductionError, match="formulation='best'; it must be"):
        rj.reduce(system, basis, "best")
    with pytest.raises(rj.ReductionError, match="basis has 2 coordinates and the system 1"):
        rj.reduce(system, rj.Basis.from_modes(np.eye(2), np.zeros(2)))


def test_joints_that_cannot_hold():
    """A point that should be in two places: what is left after ten sweeps is named."""
    system = rj.CustomSystem(
        lambda q: jnp.eye(2),
        lambda t, q, v: 0 * q,
        lambda t, q: jnp.stack([q[0], q[0] - 1]),
        q0=[0.0, 0.0],
        v0=[0.0, 0.0],
    )
    with pytest.raises(rj.InputError, match=r"constraint [12] is still violated.*cannot all hold"):
        rj.consistent(system)


def test_motions_that_do_not_compare():
    one, other = (_motion(t) for t in ([0.0, 1.0], [0.0, 1.0, 2.0]))
    with pytest.raises(ValueError, match=r"shapes \(2, 1\) and \(3, 1\).*same times"):
        rj.compare(one, other)
    with pytest.raises(Exception, match="different times"):
        rj.compare(one, _motion([0.0, 2.0]))
    # Of runs that begin late, and of very short ones, differences count as much.
    for t, other in (([1e6, 1e6 + 1.0], [1e6, 1e6 + 1.5]), ([0.0, 1e-8], [0.0, 2e-8])):
        with pytest.raises(ValueError, match="different times"):
            rj.compare(_motion(t), _motion(other))
    # Whole seconds are times as well.
    with pytest.raises(ValueError, match="different times"):
        rj.compare(one, dataclasses.replace(one, t=np.array([0, 2])))
    assert rj.compare(one, dataclasses.replace(one, t=np.array([0, 1]))).error == 0
    batch = jax.tree.map(lambda x: np.stack([np.asarray(x)] * 2), one)
    for refused in (
        lambda run: rj.compare(run, run),
        rj.pod,
        rj.naive_sod,
        lambda run: run.noise(),
    ):
        with pytest.raises(rj.InputError, match=r"batch of shape \(2,\); take one out of it"):
            refused(batch)


@pytest.mark.parametrize("ts", [[1.0, 0.5], [0.0], [], [0.0, NAN], [[0.0, 1.0]], 1.0, "late"])
def test_times_of_studies(ts):
    """All that simulate refuse what no run has, before they begin."""
    system, scene = rj.assemble(zoo.bars()), zoo.bars()
    box = rj.Box(lambda mass: zoo.bars((mass, 1.0)), mass=(1.0, 2.0))
    for owner, refused in {
        "reductions": lambda: rj.reductions(scene, ts),
        "accuracy": lambda: rj.accuracy(system, ts),
        "tune_baumgarte": lambda: rj.tune_baumgarte(system, ts),
        "sensitivities": lambda: rj.sensitivities(box, ts),
        "reduce_over": lambda: rj.reduce_over(box, ts, 1e-3),
        "fit_over": lambda: rj.fit_over(box, ts, lambda run: run.q, 0.0),
    }.items():
        with pytest.raises(ValueError, match=f"^{owner}: ts"):
            refused()


def test_bodies_in_another_order():
    """As many coordinates of the same names: nothing else would tell."""
    scene = zoo.bars()
    systems = [rj.assemble(rj.Scene(b, scene.joints)) for b in (scene.bodies, scene.bodies[::-1])]
    runs = [through(system, [0.0, 1.0]) for system in systems]
    basis = rj.Basis.from_modes(np.eye(6)[:, :1], np.zeros(6))
    basis = dataclasses.replace(basis, snapshots=SnapshotSet.of(runs[1]))
    for refused in (
        lambda: rj.compare(*runs),
        lambda: rj.pod(runs),
        lambda: rj.reduce(systems[0], basis),
        lambda: rj.plot.response(*runs),
        lambda: check_alike(*systems),
    ):
        with pytest.raises(ValueError, match=r"another order, 'bar2.x' in the place of 'bar1.x'"):
            refused()
    with pytest.raises(rj.ReductionError, match="reduce: the basis: .*; make it from a simulation"):
        rj.reduce(systems[0], basis)


def _motion(t):
    t = np.asarray(t)
    return through(_oscillator(), t, t[:, None], np.ones((len(t), 1)))


@functools.cache
def _oscillator():
    return oscillator()


def test_inconsistent_start():
    """The joint and the amount are named, and so is the function that helps."""
    ts, pendulum = [0.0, 0.1], zoo.system(zoo.bar)
    words = r"violates joint 'Revolute\(bar1, ground\)': {} = {} m.*romjax\.consistent"
    with pytest.raises(ValueError, match=words.format("C", "0.01")):
        zoo.run(pendulum, ts, q0=[0.51, 0.0, 0.0])
    with pytest.raises(ValueError, match=words.format("its rate", "0.3")):
        zoo.run(pendulum, ts, v0=[0.3, 0.0, 0.0])
    with pytest.raises(ValueError, match=words.format("C", "0.01") + r".*t=2\)"):
        zoo.run(pendulum, [2.0, 2.1], q0=[0.51, 0.0, 0.0])
    marked = zoo.run(pendulum, ts, q0=[0.51, 0.0, 0.0], throw=False)
    assert marked.status == rj.Status.INCONSISTENT_START
    assert "romjax.consistent" in marked.summary()
    q, v = rj.consistent(pendulum, [0.51, 0.0, 0.0], [0.3, 0.0, 0.0])
    assert zoo.run(pendulum, ts, q0=q, v0=v).success


def test_too_few_steps():
    system, run = zoo.oscillator(), {"ts": [0.0, 10.0], "max_steps": 4}
    with pytest.raises(
        rj.SimulationError, match=r"4 steps.*t = 10 s and failed: MAX_STEPS.*raise max_steps"
    ):
        zoo.run(system, **run)
    trajectory = zoo.run(system, throw=False, **run)
    assert trajectory.status == rj.Status.MAX_STEPS
    assert not trajectory.success
    late = run | {"ts": [1e10, 1e10 + 10.0]}
    with pytest.raises(rj.SimulationError, match=r"told apart by 2e-06 s.*begin at 0"):
        zoo.run(system, **late)
    # Of one time there is no length to compare with.
    for times in ([1e10], [0.0], [0.0, 0.0]):
        assert describe_times(np.asarray(times)) == ""


def test_a_motion_without_bounds():
    """q̈ = 6 q² from rest at one leaves every bound at a finite time: raised, or marked."""
    system = oscillator(force=lambda t, q, v: 6 * q**2, v0=[2.0])
    run = {"ts": [0.0, 5.0], "max_steps": 400, "rtol": 1e-6}
    with pytest.raises(rj.SimulationError, match="towards t = 5 s and failed: NOT_FINITE"):
        zoo.run(system, **run)
    assert zoo.run(system, throw=False, **run).status == rj.Status.NOT_FINITE


def test_single_precision_says_so():
    system = oscillator(
        q0=jnp.asarray(np.ones(1, np.float32)),
        v0=jnp.asarray(np.zeros(1, np.float32)),
        mass=lambda q: jnp.eye(1, dtype=jnp.float32),
    )
    with pytest.warns(UserWarning, match="single precision.*jax_enable_x64"):
        rj.simulate(system, jnp.asarray(np.array([0.0, 1.0], np.float32)), audit=False)


@pytest.mark.instant
def test_a_compression_is_to_noise_or_rank():
    with pytest.raises(rj.InputError, match="compress='all'"):
        rj.SOD(compress="all")
