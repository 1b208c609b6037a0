"""What tests may cost, the settings of the processes that run them, and runs that several look at.

A plugin of `conftest.py` in each process that runs tests.
"""

import contextlib
import ctypes
import functools
import gc
import hashlib
import os
import re
import time
from pathlib import Path

import cache_folder
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from processes import KEPT
from programs import compiled, listen
from scene_files import CRANK
from zoo import RODAS5P, run

import romjax as rj
from romjax.common import compat
from romjax.compiling import room, sources, xla

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

# Pieces of memory that a process may have mapped before programs are forgotten, and how much of it
# may be in use [bytes].
MOST_MAPS, MOST_MEMORY = 30_000, 3e9
# Memory that has come since the pieces were counted, from which on they are counted again [bytes]:
# to list some ten thousand takes as long as a small program.
ADDED_MEMORY = 1e8
_counted_at = [0.0]

# Required of a fast test with its fixtures: programs that it compiles, operations of JAX outside of
# them, of which the first test of a process has most, and seconds of a processor. What compiles
# neither is instant.
MOST_PROGRAMS, MOST_OPERATIONS, MOST_SECONDS = 30, 60, 10.0

# Seconds that `slowness` traces for where the limits were found: half as long as on a processor on
# which the same tests take twice as long, whose loops of Python alone are faster nevertheless.
TRACING = 0.16
# Seconds of compiling that are worth a file.
WORTH_KEEPING = 0.05
# Tests that look at what is done with functions and classes of a user, whose sources may change, or
# at how often they are traced.
UNKNOWN = {"test_program", "test_program_cache", "test_structure"}
SPENT = pytest.StashKey[tuple[int, int, float]]()


def spent() -> tuple[int, int, float]:
    """Programs and operations that this process has compiled, and the time of a processor that it
    and its children have taken [s].
    """
    times = os.times()
    return *compiled(), times.user + times.system + times.children_user + times.children_system


@functools.cache
def slowness() -> float:
    """How many times as long this processor takes as that where the limits were found, at least one
    time: by tracing, which most of the time of a fast test is.
    """

    def terms(x):
        for number in range(400):
            x = jnp.where(x > number, jnp.sin(x) * x + number, x / 2)
        return x

    begin = time.process_time()
    jax.jit(terms).lower(1.0)
    return max(1.0, (time.process_time() - begin) / TRACING)


def sources_of_tests() -> dict[str, str]:
    """The modules of the tests, and digests of all tests' sources that they come from: those of
    the verification problems too, whose numbers and mechanisms they take.
    """
    here = Path(__file__).parent
    texts = {path.stem: path.read_text() for path in sorted(here.glob("*.py"))}
    shared = "".join(text for name, text in texts.items() if not name.startswith("test_"))
    problems = sorted((here.parent / "benchmarks" / "verification_problems").glob("*.py"))
    shared += "".join(path.read_text() for path in problems)
    found = {}
    for name in texts.keys() - UNKNOWN:
        used = re.findall(r"^from (test_\w+) import", texts[name], re.MULTILINE)
        parts = [shared, texts[name], *(texts[other] for other in used)]
        found[name] = hashlib.sha256("".join(parts).encode()).hexdigest()
    return found


def one_context(make, context):
    """A function that returns what `make` once made, but within a `context` makes another one.

    To write out a small operation for the compiler takes 1 ms, and to make the context that it is
    written in, of which JAX makes one for each program, 5 ms.
    """
    outermost = functools.cache(make)
    return lambda: outermost() if context.current is None else make()


def pytest_configure(config):
    """Keep compiled programs for the next run, and for the other process of this one."""
    listen()
    if cache_folder.FOLDER:
        # And what the tests compile by JAX alone; reading a program back takes a few milliseconds.
        kept = f"{cache_folder.FOLDER}-jax", WORTH_KEEPING, -1
        for name, value in zip(KEPT, kept, strict=True):
            jax.config.update(name, value)
    # What the tests compile by JAX alone, with the options of romjax's own programs, and everything
    # without the passes that make a program fast: most programs of tests run once, and compile in
    # half the time. XLA reads the flags when it computes for the first time.
    flags = [flag for flag in compat.compiler_flags() if not flag.startswith("--xla_backend")]
    # And in one part instead of up to 32 at once, since two processes keep both cores busy.
    flags += ["--xla_backend_optimization_level=0", "--xla_cpu_parallel_codegen_split_count=1"]
    os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), *flags]).strip()
    # What runs a system of a test's own functions is not traced again in the next run.
    sources.others.update(sources_of_tests())
    # Of JAX's own parts, which another version may have elsewhere: it then takes longer.
    with contextlib.suppress(AttributeError, ImportError):
        from jax._src.interpreters import mlir
        from jax._src.lib.mlir import ir

        if hasattr(ir.Context, "current"):
            mlir.make_ir_context = one_context(mlir.make_ir_context, ir.Context)


@pytest.hookimpl(tryfirst=True)
def pytest_unconfigure():
    """Let go of everything at once: at the end pytest looks for cycles ten times, of gigabytes."""
    gc.freeze()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item):
    """Note what was spent before a test and its fixtures."""
    item.stash[SPENT] = spent()
    return (yield)


@pytest.fixture(autouse=True)
def cheap(request):
    """Fail a test that costs more than those of its group may."""
    yield
    marks = {mark.name for mark in request.node.iter_markers()}
    if marks & {"slow", "exhaustive"}:
        return
    programs, operations, seconds = np.subtract(spent(), request.node.stash[SPENT])
    if "instant" in marks:
        assert programs + operations == 0, f"{programs:.0f} programs, {operations:.0f} operations"
    assert programs <= MOST_PROGRAMS, f"{programs:.0f} programs"
    assert operations <= MOST_OPERATIONS, f"{operations:.0f} operations"
    assert seconds <= MOST_SECONDS * slowness(), f"{seconds:.1f} s"


@pytest.fixture(scope="module", autouse=True)
def room_for_programs():
    """Forget compiled programs before there are too many of them.

    Each takes hundreds of mapped pieces of memory, Linux allows a process 65530, and LLVM crashes
    where it gets no more. And what is traced stays in memory with them. Forgetting takes a second,
    and what is forgotten is traced anew: once the C library has given back what it would keep, many
    files go by until the next time.
    """
    yield
    maps, sizes = Path("/proc/self/maps"), Path("/proc/self/statm")
    if not maps.exists():
        return
    used = int(sizes.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    added, _counted_at[0] = used - _counted_at[0], min(used, _counted_at[0])
    if added < ADDED_MEMORY:
        return
    _counted_at[0] = used
    if used > MOST_MEMORY or len(maps.read_text().splitlines()) > MOST_MAPS:
        jax.clear_caches()
        room.forget_all()
        _counted_at[0] = 0.0
        with contextlib.suppress(AttributeError):  # of another C library
            ctypes.CDLL(None).malloc_trim(0)


@pytest.fixture
def only_new_garbage():
    """For tests that look for cycles: seconds, where they look at all that others have traced."""
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture(scope="module")
def without_optimisation():
    """For programs that run a few times: optimising them takes longer than they run."""
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)


@pytest.fixture
def with_optimisation(monkeypatch):
    """For programs of romjax that run for minutes: those of tests are compiled without."""
    options = compat.compiler_options()
    monkeypatch.setattr(
        xla, "known_options", lambda: options | {"xla_backend_optimization_level": 1}
    )


@pytest.fixture(scope="session")
def cart_pendulum() -> rj.AbstractSystem:
    """The chapter's example."""
    return rj.assemble(rj.gallery.cart_pendulum())


@pytest.fixture(scope="session")
def truth(cart_pendulum) -> rj.Trajectory:
    """One second of the chapter's example at 300 Hz, at a tight tolerance."""
    return run(cart_pendulum, np.linspace(0.0, 1.0, 301), solver=RODAS5P)


@pytest.fixture
def crank(tmp_path) -> Path:
    """The file of a slider crank."""
    path = tmp_path / "crank.toml"
    path.write_text(CRANK)
    return path
