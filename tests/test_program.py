"""Compiled programs: one for all that differs in numbers only, with the results of JAX's own."""

import dataclasses
import functools
import weakref
from pathlib import Path

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from programs import compilations
from tolerances import DIFFERENCED, IDENTITY
from zoo import point_pendulum
from zoo import run as run_alike

import romjax as rj
from romjax.common import compat
from romjax.compiling import jaxprs, room, xla
from romjax.compiling.program import program
from romjax.integrate.outputs import cut

X = jnp.asarray(np.random.default_rng(0).normal(size=7))


def loop(x):
    return jax.lax.while_loop(lambda c: c[0] < 9, lambda c: (c[0] + 1, jnp.sin(c[1]) + x), (0, x))


def calls_a_library_between_loops(x):
    def step(carry, _):
        y = loop(carry)[1]
        return jnp.linalg.inv(jnp.eye(len(y)) + 0.1 * y[:, None] * y[None]) @ y, y

    return jax.lax.scan(step, x, None, length=4)


def saves_rows(x):
    def put(i, rows):
        return rows.at[i].set(jnp.where(i % 2 == 0, x, jnp.flip(x)))

    return jax.lax.fori_loop(0, 5, put, jnp.zeros((6, len(x))))


def prints(x):
    jax.debug.callback(lambda x: None, x)
    return loop(x)[1]


def large_product(x):
    a = jnp.outer(jnp.ones(200), jnp.tile(x, 30)[:200])
    return jax.lax.fori_loop(0, 3, lambda _, a: jnp.tanh(a @ a), a)


FUNCTIONS = {
    "loop": loop,
    "library": calls_a_library_between_loops,
    "rows": saves_rows,
    "callback": prints,
    "large product": large_product,
    "branches": lambda x: jax.lax.cond(x[0] > 0, lambda x: loop(x)[1], jnp.cos, x),
    "sorted": lambda x: jnp.sort(loop(x)[1]),
    "constant": lambda x: (jnp.zeros(3), 1.0 + 0 * x),
    "an argument that nobody uses": lambda x: jnp.concatenate([x, x[:2]])[:1] * 0 + 2.0,
    "no entries": lambda x: (x[:0], loop(x)[0], jnp.zeros((0, 3))),
    "truth": lambda x: (x > 0, ~(x > 0), jnp.any(x > 0)),
    "single precision": lambda x: loop(x.astype(jnp.float32)),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_results_are_those_of_jax(name):
    wanted, given = jax.jit(FUNCTIONS[name])(X), program(FUNCTIONS[name])(X)
    assert jax.tree.structure(wanted) == jax.tree.structure(given)
    for a, b in zip(jax.tree.leaves(wanted), jax.tree.leaves(given), strict=True):
        assert a.dtype == b.dtype
        assert np.allclose(a, b, rtol=1e-6 if a.dtype == jnp.float32 else IDENTITY, atol=IDENTITY)


def test_everything_but_arrays_is_static():
    traces = []

    @program
    def scaled(numbers, names):
        traces.append(names)
        return numbers["x"] * len(names)

    empty = jnp.zeros((0, 2))
    for factor in (1.0, 2.0):
        assert scaled({"x": factor * X, "empty": empty}, ("a", "b"))[0] == 2 * factor * X[0]
    assert scaled({"x": X, "empty": empty}, ("a",))[0] == X[0]
    assert traces == [("a", "b"), ("a",)]


def test_inside_of_a_transformation_it_is_a_part_of_it():
    doubled = program(lambda x: 2 * x)
    assert_close(jax.grad(lambda x: jnp.sum(doubled(x) ** 2))(X), 8 * X, IDENTITY)
    assert_close(jax.vmap(doubled)(X), 2 * X, IDENTITY)


@pytest.mark.parametrize(
    "solver",
    [diffrax.Dopri8(), pytest.param(rj.Rodas5P(), marks=pytest.mark.exhaustive)],
    ids=["Dopri8", "Rodas5P"],
)
def test_the_plain_loop_takes_the_steps_of_diffrax(solver):
    """The run that nobody differentiates, and the same as a part of the user's program."""
    ts = jnp.linspace(0.0, 0.3, 31)
    run = functools.partial(run_alike, point_pendulum(), solver=solver)
    one, other = run(ts), jax.jit(run)(ts)
    for count in ("num_steps", "num_accepted_steps", "num_rejected_steps"):
        assert getattr(one.stats, count) == getattr(other.stats, count)
    assert_close(one.q, other.q, 10 * IDENTITY)
    assert_close(one.v, other.v, 1000 * IDENTITY)
    assert_close(one.violation, other.violation, IDENTITY)
    # Rounding of forces of some ten newtons.
    assert_close(one.multipliers, other.multipliers, 1000 * IDENTITY)
    assert_close(one.metric, other.metric, IDENTITY)
    assert np.array_equal(one.every(3).multipliers, one.multipliers[::3])


def test_names_and_numbers_of_outputs_and_steps_are_in_no_program():
    scene = rj.gallery.chain(2)
    names = {body.name: f"other_{i}" for i, body in enumerate(scene.bodies)} | {"ground": "ground"}

    def renamed(element):
        if hasattr(element, "markers"):
            changes = {"a": element.a, "b": element.b}
            markers = {k: dataclasses.replace(m, body=names[m.body]) for k, m in changes.items()}
            return dataclasses.replace(element, **markers)
        return dataclasses.replace(element, name=names[element.name])

    bodies, joints = ([renamed(x) for x in part] for part in (scene.bodies, scene.joints))
    other = rj.Scene(bodies=bodies, joints=joints, effects=scene.effects)
    system = rj.assemble(scene)

    def run(system, count, **settings):
        return rj.simulate(system, np.linspace(0.0, 0.2, count), **settings)

    run(system, 11)
    other = rj.assemble(other)
    assert compilations(lambda: run(other, 11)) == 0
    assert compilations(lambda: [run(system, count) for count in (2, 7, 101, 301)]) == 0
    assert compilations(lambda: run(system, 11, max_steps=5000)) == 0
    assert run(other, 11).labels != run(system, 11).labels


def test_rows_that_are_asked_for_often_are_taken_by_a_program():
    rows = {"q": jnp.arange(30.0).reshape(10, 3), "t": jnp.arange(10.0)}
    for _ in range(30):
        first = cut(rows, 4)
        assert jax.tree.all(jax.tree.map(lambda x, y: bool(jnp.all(x == y[:4])), first, rows))
        assert [x.shape for x in jax.tree.leaves(first)] == [(4, 3), (4,)]
    assert compilations(lambda: cut(rows, 4)) == 0


def test_what_cannot_be_a_function_is_compiled_the_plain_way(monkeypatch):
    """Here for want of the library that sorts; and a check that fails is no reason to try again."""
    monkeypatch.setattr(jaxprs, "is_written_out", lambda equation: True)
    ordered = program(lambda x: jnp.sort(loop(x)[1]))
    assert_close(ordered(X), np.sort(loop(X)[1]), IDENTITY)
    assert_close(ordered(2 * X), np.sort(loop(2 * X)[1]), IDENTITY)
    monkeypatch.undo()
    runs = []

    @program
    def checked(x):
        jax.debug.callback(lambda: runs.append(1))
        return eqx.error_if(x, x < 0, "negative")

    assert checked(jnp.ones(1)) == 1
    with pytest.raises(jax.errors.JaxRuntimeError, match="negative"):
        checked(-jnp.ones(1)).block_until_ready()
    assert checked(jnp.ones(1)) == 1
    assert len(runs) == 3


def test_an_unknown_compiler_is_said(monkeypatch):
    xla.known_options.cache_clear()
    monkeypatch.setattr(compat, "compiler_options", lambda: {"xla_cpu_no_such_option": True})
    try:
        with pytest.warns(UserWarning, match="does not know the compiler of JAX"):
            assert program(lambda x: 3 * x)(X)[0] == 3 * X[0]
    finally:
        xla.known_options.cache_clear()


def test_frequencies_are_those_of_the_start():
    """They are remembered with a system: not those of another time, start or transformation."""
    springs = rj.CustomSystem(
        lambda q: jnp.eye(1), lambda t, q, v: -(1 + t) * (1 + q**2) * q, q0=[1.0], v0=[0.0]
    )

    def fastest(ts, **start):
        return rj.simulate(springs, ts, audit=False, **start).stats.fastest_frequency

    early, late = jnp.array([0.0, 1.0]), jnp.array([8.0, 9.0])
    for _ in range(2):
        assert_close(fastest(early), 2.0, DIFFERENCED)
        assert_close(fastest(late), 6.0, DIFFERENCED)
        assert_close(fastest(early, q0=[0.0]), 1.0, DIFFERENCED)
        assert_close(jax.jit(fastest)(early), 2.0, DIFFERENCED)


def test_a_program_without_compiling():
    """Operation by operation, so that one can look at numbers on the way."""
    seen = []

    def doubled(x):
        seen.append(isinstance(x, jax.core.Tracer))
        return 2 * x

    with jax.disable_jit():
        assert_close(program(doubled)(X), 2 * X, IDENTITY)
    assert seen == [False]


def test_programs_are_forgotten_where_memory_has_no_more_room(monkeypatch, only_new_garbage):
    """For the next one; and run as before when they are called again."""
    # Those of other tests would be read again.
    monkeypatch.setattr(room, "_remembering", weakref.WeakSet())
    sums, products = program(lambda x: x + 1.0), program(lambda x: 2.0 * x)
    assert_close(sums(X), np.asarray(X) + 1, IDENTITY)
    assert 0.0 < room.fills() < 1.0 or not Path("/proc/self/maps").exists()
    monkeypatch.setattr(room, "fills", lambda: 0.7)
    monkeypatch.setattr(room._next, "fitting", 0)
    assert_close(products(X), 2 * np.asarray(X), IDENTITY)
    assert sums._compiled.cache_info().currsize == 0
    monkeypatch.undo()
    assert_close(sums(X), np.asarray(X) + 1, IDENTITY)
    assert sums._compiled.cache_info().currsize == products._compiled.cache_info().currsize == 1
