"""Compiled programs on disk: what is compiled once, by this process or another, and what is not."""

import functools
import os
import pickle
import subprocess
import sys
import textwrap
import zlib
from pathlib import Path

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import IDENTITY

import romjax as rj
from romjax.common.partition import Partitioned
from romjax.compiling import program_cache
from romjax.compiling.program import program

X = jnp.asarray(np.random.default_rng(1).normal(size=5))
SYSTEM = rj.assemble(rj.gallery.chain(2))
METHOD = diffrax.Dopri8()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("ROMJAX_CACHE_DIR", str(tmp_path / "caches"))
    return program_cache.folder()


def in_a_process(code, **environment):
    """The last line that another process prints."""
    start = "import jax, numpy as np, romjax as rj\njax.config.update('jax_enable_x64', True)\n"
    done = subprocess.run(
        [sys.executable, "-c", start + textwrap.dedent(code)],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.splitlines()[-1]


RUN = """
    from romjax.basis.subspace import singular_values
    # Of a library that no call of it has been traced for, where the program is read.
    assert np.allclose(singular_values(np.diag([3.0, 2.0])), [3.0, 2.0])
    # Programs of romjax are compiled by this; what JAX compiles call by call is not.
    compiled, calls = jax.stages.Lowered.compile, []

    def counted(*args, **kwargs):
        calls.append(1)
        return compiled(*args, **kwargs)

    jax.stages.Lowered.compile = counted
    system = rj.assemble(rj.gallery.chain(1))
    run = rj.simulate(system, np.linspace(0.0, 0.2, 11), audit=False)
    rom = rj.reduce(system, rj.pod(run, rank=1), "minimal")
    multipliers = np.asarray(run.multipliers)
    numbers = run.q[-1, 2], multipliers[-1, 1], rom.q0[0]
    print(len(calls), *(float(x).hex() for x in numbers))
"""


@pytest.mark.slow
def test_another_process_compiles_nothing_and_gets_the_same_bits(folder):
    """Whatever order Python's sets have."""

    def files():
        return {file.name: file.stat().st_ino for file in folder.iterdir()}

    compiled, *first = in_a_process(RUN, PYTHONHASHSEED="1").split()
    written = files()
    texts = [name for name in written if not name.endswith(".call")]
    assert int(compiled) >= len(texts) - 1 > 5
    assert in_a_process(RUN, PYTHONHASHSEED="2").split() == ["0", *first]
    assert files() == written


@pytest.mark.slow
def test_constants_are_no_arguments_of_functions():
    """XLA would end the process at a function that is given some."""
    code = f"""
        import sys
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from zoo import four_bar
        system = rj.assemble(four_bar())
        run = rj.simulate(system, np.linspace(0.0, 2.0, 101), rtol=1e-10, audit=False)
        rom = rj.reduce(system, rj.pod(run), "minimal")
        print(bool(rj.simulate(rom, run.t, rtol=1e-10, audit=False).success))
    """
    assert in_a_process(code, XLA_FLAGS="--xla_backend_optimization_level=0") == "True"


def test_what_a_program_from_the_disk_returns_holds_its_method(folder):
    """And all other structures that are no part of the program's numbers."""

    def parted(x):
        return x, Partitioned.of(METHOD)

    first, again = program(parted)(X), program(parted)(X)
    assert len(list(folder.iterdir())) == 1
    assert jax.tree.structure(first) == jax.tree.structure(again)
    assert eqx.tree_equal(again[1].combine(), METHOD)


def test_numbers_of_what_a_program_from_the_disk_returns_stay_arrays(folder):
    """An object's numbers are the program's, and its structure alone is stored."""

    def parted(x):
        return Partitioned.of(rj.Baumgarte(x, 2 * x))

    first, again = program(parted)(X), program(parted)(X)
    assert len(list(folder.iterdir())) == 1
    assert jax.tree.structure(first) == jax.tree.structure(again)
    assert_close(again.combine().beta, 2 * X, IDENTITY)


def test_functions_of_the_user_are_known_by_what_they_compute(folder):
    def twice(x, factor):
        return factor * jnp.sin(x)

    def count():
        return len(list(folder.iterdir())) if folder.is_dir() else 0

    assert_close(program(twice)(X, 2.0), 2 * jnp.sin(X), IDENTITY)
    assert count() == 1
    # Another function of that name and place.
    twice_again = program(functools.wraps(twice)(lambda x, factor: factor * jnp.cos(x)))
    assert_close(twice_again(X, 2.0), 2 * jnp.cos(X), IDENTITY)
    assert count() == 2
    # The same one, as a new process has it.
    assert_close(program(twice)(X, 2.0), 2 * jnp.sin(X), IDENTITY)
    assert count() == 2


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (lambda x, y: 2 * x, lambda x, y: 2 * y),
        (lambda x, y: {"a": x}, lambda x, y: {"b": x}),
        (lambda x, y: x + np.arange(5.0), lambda x, y: x + np.arange(1.0, 6.0)),
        (lambda x, y: x + 0 * y[0], lambda x, y: x),
    ],
    ids=["unused arguments", "results", "constants", "arguments"],
)
def test_similar_functions_are_not_taken_for_each_other(folder, one, other):
    arguments = X, 3 * X
    for function in (one, other, one):
        wanted, given = jax.jit(function)(*arguments), program(function)(*arguments)
        assert jax.tree.structure(wanted) == jax.tree.structure(given)
        for a, b in zip(jax.tree.leaves(wanted), jax.tree.leaves(given), strict=True):
            assert_close(b, a, IDENTITY)
    assert len(list(folder.iterdir())) == 2


class Part(eqx.Module):
    """A part of the user's own."""

    x: jax.Array


@pytest.mark.instant
def test_keys_tell_apart_what_programs_depend_on():
    function = rj.integrate.run._integrated
    leaves, tree = jax.tree.flatten(SYSTEM)
    del leaves
    key = program_cache.key_of_call
    assert key(function, tree) == key(function, jax.tree.flatten(SYSTEM)[1]) is not None
    other = jax.tree.flatten(rj.assemble(rj.gallery.chain(3)))[1]
    names = [key(function, *rest) for rest in ((tree,), (other,), (tree, 1), (tree, 1.0))]
    assert len(set(names)) == 4
    # The user's own classes and functions, which may change under their names.
    assert key(function, jax.tree.flatten(Part(X))[1]) is None
    assert key(function, lambda x: x) is None
    assert key(test_keys_tell_apart_what_programs_depend_on, tree) is None


def test_what_calls_back_into_this_process_is_not_kept(folder):
    seen = []

    def told(x):
        jax.debug.callback(lambda x: seen.append(float(x[0])), x)
        return 2 * x

    for _ in range(2):
        program(told)(X).block_until_ready()
    jax.effects_barrier()
    assert seen == [float(X[0])] * 2
    assert not folder.exists()


# What can be unpacked and is no program: no pickle, a pickle of a missing class, another object.
NO_PROGRAMS = [
    zlib.compress(content)
    for content in (b"", b"no pickle", b"crom\njax\n.", pickle.dumps(X.shape), pickle.dumps("abc"))
]


def test_a_damaged_file_is_compiled_again(folder):
    def tripled(x):
        return 3 * x

    program(tripled)(X)
    (file,) = folder.iterdir()
    for damaged in (b"", file.read_bytes()[:-7], b"nothing of that kind", *NO_PROGRAMS):
        file.write_bytes(damaged)
        assert_close(program(tripled)(X), 3 * X, IDENTITY)
        assert len(file.read_bytes()) > 100


@pytest.mark.parametrize("name", ["", "file/programs"])
def test_without_a_folder_nothing_is_kept(name, tmp_path, monkeypatch):
    """None is asked for, or it cannot be made."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ROMJAX_CACHE_DIR", str(tmp_path / name) if name else "")
    assert_close(program(lambda x: 4 * x)(X), 4 * X, IDENTITY)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_oldest_programs_go_first(folder, monkeypatch):
    def shifted(x, by):
        return x + by

    for by in (1, 2, 3):
        program(shifted)(X, by)
        for file in folder.iterdir():
            os.utime(file, (file.stat().st_atime, file.stat().st_mtime - 10))
    newest = max(folder.iterdir(), key=lambda file: file.stat().st_mtime)
    size = newest.stat().st_size
    monkeypatch.setattr(program_cache, "_LARGEST", 2.5 * size)
    program(shifted)(X, 4)
    left = list(folder.iterdir())
    assert len(left) == 2
    assert newest in left


OWN_CACHE_OF_JAX = """
    import os
    from romjax.compiling.program import program
    jax.config.update("jax_compilation_cache_dir", {!r})
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    for name in {!r}:
        os.environ["ROMJAX_CACHE_DIR"] = name
        result = float(program(lambda x: jax.numpy.sin(x).sum())(np.ones(3)))
        jax.clear_caches()
    print(result)
"""


@pytest.mark.slow
def test_a_program_that_jax_keeps_too_is_kept_by_romjax(tmp_path):
    """What comes from JAX's cache on disk could not be kept: a copy of it fails when it runs."""
    folder = str(tmp_path / "romjax")
    # The first fills JAX's cache, as it would before romjax had one; the last reads romjax's.
    for names in (("", folder), (folder,)):
        code = OWN_CACHE_OF_JAX.format(str(tmp_path / "jax"), names)
        assert_close(float(in_a_process(code)), 3 * np.sin(1.0), IDENTITY)
    assert list((tmp_path / "jax").iterdir())
    assert len(list((tmp_path / "romjax").glob("*/*.program"))) == 1
