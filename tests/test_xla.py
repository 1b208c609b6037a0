"""The compiler's settings: taken if in time, said to be late if not."""

import os
import subprocess
import sys

import pytest

import romjax as rj
from romjax.common import compat


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
