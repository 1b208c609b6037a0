"""Runs code in a process of its own, from the start."""

import os
import subprocess
import sys

START = """
import os, signal, sys
import jax, jax.numpy as jnp, numpy as np, romjax as rj
jax.config.update("jax_enable_x64", True)
"""


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
