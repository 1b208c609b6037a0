"""Compiled models: the runs of `simulate`, by native code, and what is refused."""

import functools

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from groups import in_groups
from native import called, library
from test_drives import shortened
from test_joint_effects import pendulum
from tolerances import SOLVED
from zoo import DOPRI8, RODAS5P

import romjax as rj
from romjax.export import equations, loops
from romjax.export import library as libraries
from romjax.export.leaving import model_of
from romjax.system.structure import without_names

TS = np.linspace(0.0, 0.5, 26)
HELD = rj.Baumgarte(alpha=12.0, beta=36.0)
# Required: emitted functions differ from those of JAX by this share of the largest number.
EMITTED = 2e-13
EPSILON, SEVERAL = np.finfo(float).eps, 10.0
# Required: both take the same steps, whose lengths differ by what rounding does to estimates of
# errors; so that runs differ by no more than their errors, which are some times the tolerance, and
# numbers of steps by a hundredth.
ALIKE, STEPS = 2.0, 0.01


@functools.cache
def cart(formulation=None, rank=4):
    """The cart, or a model of it."""
    system = zoo.system(zoo.cart_pendulum)
    if formulation is None:
        return system
    return rj.reduce(system, rj.pod(zoo.motion(zoo.cart_pendulum), rank=rank), formulation)


def compared(system, ts=TS, **settings):
    """Runs by both ways, which take the same steps."""
    native = rj.compile(system).simulate(ts, **settings)
    usual = rj.simulate(system, ts, audit=False, **settings)
    for name in ("num_steps", "num_accepted_steps"):
        one, other = int(native.stats[name]), int(usual.stats[name])
        assert abs(one - other) <= STEPS * other
    assert int(native.status) == int(usual.status)
    assert int(native.flags) == int(usual.flags) or not usual.success
    assert native.solver_name == usual.solver_name
    for name in ("q", "v", "violation"):
        one, other = getattr(native, name), np.asarray(getattr(usual, name))
        reached = np.isfinite(other)
        np.testing.assert_array_equal(np.isnan(one), ~reached)
        largest = 1 + np.max(np.abs(other[reached]))
        assert_close(one[reached], other[reached], ALIKE * settings.get("rtol", 1e-6), largest)
    return native, usual


# The same runs.


def test_a_run_is_that_of_simulate():
    """And a trajectory like any other."""
    run, usual = compared(zoo.system(zoo.bar), solver=DOPRI8, stabilization=HELD)
    assert run.success
    assert not run.warnings()
    assert run.system is not None
    assert_close(run["bar1.x"], usual["bar1.x"], SOLVED)
    assert_close(run.multipliers, usual.multipliers, SOLVED, scale=100.0)
    assert run.balance is None


DEFAULTS = {
    "stiff": lambda: cart(),
    "loop": lambda: zoo.system(zoo.four_bar),
    "subspace": lambda: cart(rj.Galerkin()),
    "closed form": lambda: cart(rj.Minimal(), 3),
}


@pytest.mark.parametrize("name", in_groups(DEFAULTS, slow=["stiff", "loop"]))
def test_defaults_are_those_of_simulate(name):
    # In half a second rounding decides whether a step of the loop is accepted.
    compared(DEFAULTS[name](), TS * 1.2 if name == "loop" else TS)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        # Where the fast mode hangs on rounding, steps do: between the tolerances of these two.
        {"rtol": 1e-10},
        {"rtol": 1e-6, "atol": 1e-6},
        {"dt": 1e-3},
        # Fast modes that ring: at looser tolerances the two step sizes part by rounding.
        {"q0": np.array([0.1, 0.1, 0.0, 0.1, -0.3, 0.0, 0.0, 0.0]), "rtol": 1e-8},
        {"solver": DOPRI8, "max_steps": 20, "throw": False},
        {"stabilization": None},
    ],
)
def test_settings(settings):
    compared(cart(), **{"solver": RODAS5P, "stabilization": HELD, **settings})


SLOW = [zoo.driven_four_bar, zoo.beam_in_space, zoo.loop_in_space]
MECHANISMS = [*SLOW, zoo.slider_crank, zoo.top]


@pytest.mark.parametrize("make", in_groups(MECHANISMS, slow=SLOW))
def test_mechanisms(make):
    """Loads with corners, motion in space, beams."""
    compared(zoo.system(make))


@pytest.mark.slow
def test_a_model_outside_of_its_training_says_so():
    rom = cart(rj.Minimal(), 3)
    q0 = np.asarray(rom.q0) + 5.0
    run = rj.compile(rom).simulate(TS, q0=q0, throw=False)
    assert run.flags & rj.Flag.OUTSIDE_TRAINING
    assert "box of the snapshots" in run.warnings()


@pytest.mark.slow
def test_what_fails_says_so():
    model = rj.compile(zoo.system(zoo.bar))
    with pytest.raises(rj.SimulationError, match="Dopri8 took 3 steps"):
        model.simulate(TS, max_steps=3)
    failed = model.simulate(TS, max_steps=3, throw=False)
    for rows in (failed.q, failed.v, failed.violation[:, None]):
        assert np.array_equal(np.all(np.isnan(rows), axis=1), np.any(np.isnan(rows), axis=1))
        assert np.isnan(rows[-1, 0])
        assert np.isfinite(rows[0, 0])
    with pytest.raises(ValueError, match="the start violates"):
        model.simulate(TS, q0=np.array([0.5, 0.3, 0.0]))
    falling = rj.CustomSystem(
        mass=lambda q: jnp.eye(1), force=lambda t, q, v: q**3 * 1e3, q0=[1.0], v0=[10.0]
    )
    run = rj.compile(falling).simulate(TS, throw=False)
    assert run.status == rj.Status.NOT_FINITE
    assert not np.all(np.isfinite(run.q))


@pytest.mark.slow
@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_joints_that_come_apart_are_told(size):
    """By what the mechanism is large, and not by a metre."""
    with pytest.raises(rj.SimulationError, match="CONSTRAINTS_VIOLATED: not all joints hold"):
        rj.compile(shortened(size)).simulate(TS + TS, solver=DOPRI8, stabilization=HELD)


@pytest.mark.slow
def test_the_second_process_compiles_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("ROMJAX_CACHE_DIR", str(tmp_path))
    source = "double twice(double x) { return 2 * x; }"
    libraries.load(source)
    assert len(list(tmp_path.glob("*/*.library"))) == 1
    monkeypatch.setattr(libraries, "_compiled", None)
    assert libraries.load(source).twice is not None


# Every formulation, against JAX.


def check_functions(system, stiff=True, turns=True):
    """All functions of a system at states near its start, of other positions if it `turns`."""
    bare, n = without_names(system), system.n
    model = model_of("test", bare, {}, None, {}, None, "model")
    functions = loops.functions_of(model, stiff)
    code = library(functions, ("-O0", "-std=c99", "-fPIC"))
    rng = np.random.default_rng(0)
    found, wanted, moved = ({f.name: [] for f in functions} for _ in range(3))
    made = {"rate": equations.rate, "output": equations.physical_output, "linear": equations.linear}
    for size in (0.0, 1e-3, 1e-2):
        x = np.concatenate([np.asarray(system.q0), np.asarray(system.v0)])
        x += size * rng.standard_normal(2 * n) * np.repeat([turns, 1], n)
        given = {"t": 0.1 + size, "x": x, "s": np.array([10.0, 25.0]), "rtol": 1e-6}
        for f in functions:
            name = f.name.removeprefix("model_")
            if name in made:
                args = [given[key] for key in f.arguments]
                found[f.name].append(called(code, f, *args))
                args = args[: 2 if name == "output" else 3]
                wanted[f.name].append(_jitted(made[name])(bare, *args))
                args[1] = x * (1 + EPSILON * rng.choice([-1, 1], 2 * n))
                moved[f.name].append(_jitted(made[name])(bare, *args))
    for name in found:
        for key in (found[name] or [{}])[0]:
            one, other, near = (
                np.stack([each[key] for each in results[name]])
                for results in (found, wanted, moved)
            )
            # Where joints repeat each other, rounding of the state alone makes more; and an
            # evaluation rounds more than once.
            rounding = SEVERAL * np.max(np.abs(near - other))
            most = max(EMITTED * max(1.0, np.max(np.abs(other))), rounding)
            assert_close(one, other, most)


@functools.cache
def _jitted(function):
    return eqx.filter_jit(function)


FORMULATIONS = {
    "full": lambda: cart(),
    "galerkin": lambda: cart(rj.Galerkin()),
    "closed form": lambda: cart(rj.Minimal(), 3),
    "local": lambda: rj.reduce(*bending_basis(), rj.Local()),
    "capped": lambda: rj.assemble(rj.cap(rj.gallery.cart_pendulum(), 200.0)),
    "implicit": lambda: loop(rj.Minimal()),
    "table": lambda: loop(rj.Tabulated()),
    "hyper": lambda: rj.reduce(*chain_basis(), rj.HyperReduced()),
    "joint coordinates": lambda: rj.reduce(zoo.system(zoo.bars), formulation=rj.JointCoordinates()),
    "cut joints": lambda: rj.reduce(zoo.system(zoo.four_bar), formulation=rj.JointCoordinates()),
    "effects along them": lambda: rj.reduce(
        rj.assemble(pendulum(0.2, 0.5, 0.3)), formulation=rj.JointCoordinates()
    ),
    "rod": lambda: rj.assemble(rod()),
}
# Of which the derivatives have more operations than are emitted, or hang on tables.
EXPLICIT = ("hyper", "rod")
# What is emitted for these stands in the others too, and the runs of the cart take all of it.
OTHERS = ("full", "galerkin", "capped", "joint coordinates")


def rod():
    """A very flexible rod on a hinge."""
    bent = rj.Rod("rod", 1.0, 1.0, 1.0, 3, shapes="pinned-free", rotary=1e-3, angle=0.3)
    hinge = rj.Revolute(bent.at("start"), rj.ground.at(), name="hinge")
    return rj.Scene([bent], [hinge], [rj.Gravity((0.0, -9.81))])


def bending_basis():
    return zoo.system(zoo.cart_pendulum), rj.pod(zoo.motion(zoo.cart_pendulum), rank=5)


def chain_basis():
    system = zoo.system(zoo.bars)
    return system, rj.pod(zoo.motion(zoo.bars, end=0.5), rank=2)


def loop(formulation):
    system = zoo.system(zoo.slider_crank)
    return rj.reduce(system, rj.pod(zoo.motion(zoo.slider_crank, end=0.5), rank=1), formulation)


@pytest.mark.parametrize(
    "name", in_groups(FORMULATIONS, slow=[x for x in FORMULATIONS if x not in OTHERS])
)
def test_every_formulation_leaves(name):
    check_functions(FORMULATIONS[name](), stiff=name not in EXPLICIT)


# Scenes of more operations than straight-line code pays for.
TOO_LONG = ("flexible-link",)


@pytest.mark.exhaustive
@pytest.mark.parametrize("example", rj.gallery.EXAMPLES, ids=lambda x: getattr(x, "name", x))
def test_every_scene_of_the_gallery_leaves(example):
    # Where joints repeat each other, elsewhere they contradict each other, which no rounding bears.
    example = rj.gallery.find(example) if isinstance(example, str) else example
    system = rj.assemble(example.make())
    if example.name in TOO_LONG:
        with pytest.raises(rj.InputError, match="operations, and straight-line code pays up to"):
            check_functions(system, stiff=False, turns=False)
    else:
        check_functions(system, stiff=False, turns=False)


# What is refused.


def held_by_a_controller():
    bar = zoo.bar().bodies[0]
    pid = rj.PID(bar.at(), rj.ground.at(), rj.Constant(0.1), 10.0, integral=2.0)
    return rj.assemble(rj.Scene([bar], [], [pid]))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: rj.assemble(rj.gallery.bouncing_ball()), "where contacts begin"),
        (lambda: rj.gallery.chain(1), "compile: the system"),
        (lambda: held_by_a_controller(), "effects with first-order states"),
        (
            lambda: rj.CustomSystem(
                mass=lambda q: jnp.eye(1), force=lambda t, q, v: t * q, q0=np.ones(1), v0=np.ones(1)
            ),
            "does not say when it changes",
        ),
    ],
)
def test_systems_that_cannot_be_compiled(make, words):
    with pytest.raises(rj.InputError, match=words):
        rj.compile(make())


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"solver": diffrax.Tsit5()}, "not of Tsit5"),
        ({"stabilization": rj.Projection()}, "not by Projection"),
        ({"rtol": -1.0}, "rtol"),
        ({"q0": np.zeros(2)}, "q0"),
    ],
)
def test_runs_that_cannot_be_compiled(settings, words):
    model = rj.compile(zoo.system(zoo.bar))
    with pytest.raises(ValueError, match=words):
        model.simulate(TS, **settings)


@pytest.mark.instant
def test_without_a_compiler_there_is_a_cure(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    libraries.compiler.cache_clear()
    try:
        with pytest.raises(rj.InputError, match="apt install gcc"):
            libraries.load("int x;")
    finally:
        libraries.compiler.cache_clear()


@pytest.mark.instant
def test_what_the_compiler_says_is_told():
    with pytest.raises(rj.InputError, match=r"has failed: .*error"):
        libraries.load("int x = ;")
