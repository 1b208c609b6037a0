"""The compiler's settings: of one program by `rj.jit`; of all, taken if in time, said to be late if
not.
"""

import functools
import os
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from zoo import oscillator, run

import romjax as rj
from romjax.common import compat
from romjax.compiling import jaxprs, xla

X = np.linspace(0.1, 0.9, 4)

PACKAGE = Path(rj.__file__).parent


@rj.jit
def wave(x, scale=1.0):
    """What is compiled in many ways."""
    return jnp.sum(jnp.sin(scale * x))


def test_jit_is_that_of_jax():
    """Under all transformations, within and around, and with their keywords."""
    value, slope = np.sum(np.sin(X)), np.cos(X)
    assert wave(X) == pytest.approx(value)
    assert wave(X, scale=2.0) == pytest.approx(np.sum(np.sin(2 * X)))
    assert wave.__name__ == "wave"
    assert wave.__doc__ == "What is compiled in many ways."
    for gradient in (jax.grad(wave), rj.jit(jax.grad(wave)), jax.jit(jax.jacfwd(wave))):
        assert gradient(X) == pytest.approx(slope)
    assert jax.vmap(wave)(np.stack([X, 2 * X]))[0] == pytest.approx(value)
    assert wave.lower(X).compile()(X) == pytest.approx(value)
    assert wave.trace(X).jaxpr.in_avals[0].shape == (*wave.eval_shape(X).shape, 4)


def test_settings_of_jit():
    """Static arguments and donation, also as a decorator, and of a method."""

    @rj.jit(static_argnames="twice", donate_argnums=0)
    def changed(x, twice):
        assert isinstance(twice, bool)
        return 2 * x if twice else x + 1

    given = jnp.asarray(X)
    assert changed(given, twice=True) == pytest.approx(2 * X)
    assert given.is_deleted()
    changed.clear_cache()

    class Scale:
        factor = 3.0

        @functools.partial(rj.jit, static_argnums=0)
        def of(self, x):
            return self.factor * x

    assert Scale().of(X) == pytest.approx(3 * X)


def test_options_of_jit_reach_the_compiler(monkeypatch):
    """Where nothing surrounds the program; those that are given count before romjax's."""
    monkeypatch.setattr(xla, "known_options", lambda: {"xla_cpu_no_such_option": True})
    function = rj.jit(lambda x: x + 1)
    assert jax.jit(function)(X) == pytest.approx(X + 1)
    with pytest.raises(jax.errors.JaxRuntimeError, match="no_such_option"):
        function(X)
    monkeypatch.setattr(xla, "known_options", lambda: {"xla_backend_optimization_level": "none"})
    assert rj.jit(lambda x: x, compiler_options={"xla_backend_optimization_level": 0})(1.0) == 1
    # Other devices have none.
    monkeypatch.setattr(xla, "known_options", lambda: None)
    assert rj.jit(lambda x: x + 1)(X) == pytest.approx(X + 1)


def much(x, others=()):
    """A loop that is worth a function, beside what is passed on."""

    def body(_, x):
        for _ in range(30):
            x = jnp.sin(x)
        return x

    return {"zero": -jnp.zeros_like(x), "sines": jax.lax.fori_loop(0, 2, body, x), "others": others}


def counted(function, calls):
    """A function that notes its calls."""

    def noting(*args):
        calls.append(args)
        return function(*args)

    return noting


@pytest.mark.parametrize(
    "others",
    [(2.0, True, None), (jnp.zeros((0, 3)), np.arange(3), np.float32(1)), (jax.random.key(0),)],
    ids=["Python", "arrays", "keys"],
)
def test_programs_in_functions_return_what_those_of_jax_do(others):
    """Also types that give way to others, arrays without entries, and keys of random numbers."""
    one, other = rj.jit(much)(0.5, others), jax.jit(much)(0.5, others)
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for x, y in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert (x.aval, bool(jnp.all(x == y))) == (y.aval, True)
    assert jnp.signbit(one["zero"])
    text = rj.jit(much).lower(X, others).as_text()
    assert ("xla_cpu_small_call" in text) == compat.compiles_functions()


def test_what_cannot_be_a_function_is_compiled_as_by_jax(monkeypatch):
    """Large arrays stay with the threads; a check that fails is no reason to try again."""
    assert "small_call" not in rj.jit(much).lower(np.zeros(10**5)).as_text()
    monkeypatch.setattr(jaxprs, "is_written_out", lambda equation: True)
    tries = []
    monkeypatch.setattr(xla.functions, "split", counted(xla.functions.split, tries))
    ordered = rj.jit(lambda x: jnp.sort(much(x)["sines"]))
    assert ordered(X) == pytest.approx(np.sort(much(X)["sines"]))
    first = len(tries)
    assert ordered(X[:2]) == pytest.approx(np.sort(much(X[:2])["sines"]))
    assert len(tries) == first
    monkeypatch.undo()
    runs = []

    @rj.jit
    def checked(x):
        jax.debug.callback(lambda: runs.append(1))
        return eqx.error_if(much(x)["sines"], x < 0, "negative")

    for _ in range(2):
        with pytest.raises((jax.errors.JaxRuntimeError, ValueError), match="negative"):
            checked(-X[0]).block_until_ready()
    assert len(runs) == 2
    with jax.disable_jit():
        assert rj.jit(lambda x: float(x))(2.0) == 2


def test_messages_of_jax_name_the_function_and_the_operation():
    """As if nothing stood between the function and JAX."""

    @rj.jit
    def undecided(x):
        return x if x > 0 else -x

    with pytest.raises(TypeError, match="undecided.*depends on the value of the argument x"):
        undecided(1.0)
    with jax.debug_nans(True), pytest.raises(FloatingPointError, match="log"):
        rj.jit(lambda x: jnp.log(much(x)["sines"] - 10))(1.0)


@pytest.fixture
def untold(monkeypatch):
    """A process that has told nothing, and whose flags are not those of the tests."""
    monkeypatch.setattr(xla, "_told", [])
    monkeypatch.setattr(xla, "_taken", [])
    monkeypatch.setenv("XLA_FLAGS", "")


def swing(damping):
    """The end of a short swing, traced only."""
    return run(oscillator(damping=damping), np.array([0.0, 0.1]), throw=False).q[-1, 0]


def test_a_run_in_a_foreign_jit_is_told_of_once(untold):
    with pytest.warns(UserWarning, match=r"compile it by romjax\.jit instead") as told:
        [jax.jit(transform(swing)).trace(9.81) for transform in (jax.checkpoint, jax.grad)]
    assert len(told) == 1
    assert PACKAGE not in Path(told[0].filename).parents


def test_many_derivatives_outside_of_a_program_are_told_of(untold):
    """One by one they are taken without the options, and in many times the time."""

    def swung(x):
        xla.tell_of_jit()
        return x**2

    for _ in range(4):
        jax.grad(swung)(1.0)
    with pytest.warns(UserWarning, match=r"compile it by romjax\.jit instead"):
        jax.value_and_grad(swung)(1.0)
    jax.grad(swung)(1.0)


def test_what_has_the_options_is_not_told_of(untold, monkeypatch):
    """Nor what runs with the flags for all programs."""
    rj.jit(jax.vmap(swing)).trace(np.array([9.0, 10.0]))
    rj.jit(swing).eval_shape(9.81)
    monkeypatch.setenv("XLA_FLAGS", " ".join(compat.compiler_flags()))
    jax.eval_shape(swing, 9.81)


def test_flags_are_added_once_and_the_compiler_knows_them():
    """XLA ends the process at a flag that it does not know."""
    words = (
        "import os, jax, romjax as rj\n"
        "rj.speed_up_xla(); rj.speed_up_xla()\n"
        "assert float(jax.numpy.ones(3).sum()) == 3\n"
        "rj.speed_up_xla()\n"
        "print(os.environ['XLA_FLAGS'])"
    )
    plain = {**os.environ, "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=true"}
    command = [sys.executable, "-W", "error", "-c", words]
    done = subprocess.run(command, env=plain, capture_output=True, text=True, check=True)
    flags = done.stdout.split()
    assert flags[0] == "--xla_cpu_multi_thread_eigen=true"
    assert len(flags) == len(set(flags)) == 1 + len(compat.compiler_flags())


def test_too_late_is_said(monkeypatch, truth):
    monkeypatch.setenv("XLA_FLAGS", "")
    with pytest.warns(UserWarning, match="call it right after importing romjax"):
        rj.speed_up_xla()
    assert os.environ["XLA_FLAGS"] == ""


@pytest.mark.instant
def test_an_unknown_version_is_said(monkeypatch):
    monkeypatch.setattr(rj.compiling.xla.compat, "compiler_flags", lambda: ())
    with pytest.warns(UserWarning, match="flags of JAX .* are not known"):
        rj.speed_up_xla()
