"""Runs code in a process of its own, from the start."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator

import jax
import pytest

START = """
import os, signal, sys
import jax, jax.numpy as jnp, numpy as np, romjax as rj
jax.config.update("jax_enable_x64", True)
"""


# What JAX keeps of its programs on disk, as in this process.
KEPT = (
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)


@contextlib.contextmanager
def keeping_programs_of_jax() -> Iterator[None]:
    """Let processes that begin in here keep, and find, what they compile by JAX alone."""
    with pytest.MonkeyPatch.context() as patch:
        for name in KEPT if jax.config.jax_compilation_cache_dir else ():
            patch.setenv(name.upper(), str(getattr(jax.config, name)))
        yield


def in_a_process(code, *arguments, without=(), **environment):
    """What another process prints, with some variables of the environment set or taken away."""
    inherited = {name: value for name, value in os.environ.items() if name not in without}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", START + code, *map(str, arguments)],
        env=inherited | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.splitlines()
