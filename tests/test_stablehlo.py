"""Runs written as programs of XLA, against those that are made directly."""

import subprocess
import sys

import jax
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY

import romjax as rj

pytest.importorskip("flatbuffers")
TS = np.linspace(0.0, 0.3, 16)
# In a process that knows nothing of romjax.
READ = """
import sys, jax, numpy as np
jax.config.update("jax_enable_x64", True)
run = jax.export.deserialize(bytearray(open(sys.argv[1], "rb").read()))
start = np.load(sys.argv[2])
np.savez(sys.argv[3], **run.call(start["q0"], start["v0"]))
assert not any(name.startswith("romjax") for name in sys.modules)
"""


@pytest.mark.slow
def test_a_galerkin_model_runs_elsewhere(tmp_path):
    """With what `simulate` chooses, which no trace sees."""
    system = zoo.system(zoo.cart_pendulum)
    rom = rj.reduce(system, rj.pod(zoo.motion(zoo.cart_pendulum), rank=5), rj.Galerkin())
    made = rj.export.stablehlo(rom, tmp_path / "rom.run", TS)
    usual = rj.simulate(rom, TS, audit=False)
    assert type(made.solver) is type(usual.solver)
    np.savez(tmp_path / "start.npz", q0=rom.q0, v0=rom.v0)
    names = [str(tmp_path / name) for name in ("rom.run", "start.npz", "out.npz")]
    subprocess.run([sys.executable, "-c", READ, *names], check=True)
    out = np.load(tmp_path / "out.npz")
    assert int(out["status"]) == rj.Status.SUCCESS
    for name in ("q", "v"):
        assert_close(out[name], np.asarray(getattr(usual, name)), 1e3 * IDENTITY)


@pytest.mark.slow
def test_parameters_are_arguments(tmp_path):
    def make(mass, gravity):
        return rj.assemble(zoo.bar(mass=mass, gravity=gravity))

    held = rj.Baumgarte(12.0, 36.0)
    settings = {"solver": zoo.DOPRI8, "stabilization": held}
    nominal = {"mass": 1.0, "gravity": 9.81}
    made = rj.export.stablehlo(make, tmp_path / "bar.run", TS, parameters=nominal, **settings)
    read = jax.export.deserialize(bytearray(made.path.read_bytes()))
    system = make(1.4, 3.0)
    found = read.call(system.q0, system.v0, {"mass": 1.4, "gravity": 3.0})
    usual = rj.simulate(system, TS, audit=False, **settings)
    assert_close(found["q"], np.asarray(usual.q), 1e3 * IDENTITY)
    text = rj.export.stablehlo(system, tmp_path / "bar.mlir", TS, **settings)
    assert "stablehlo.while" in text.path.read_text()


@pytest.mark.instant
def test_without_flatbuffers_there_is_a_remedy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "flatbuffers", None)
    with pytest.raises(ImportError, match=r"pip install 'romjax\[stablehlo\]'; a path"):
        rj.export.stablehlo(zoo.system(zoo.bar), tmp_path / "bar.run", TS)
    assert list(tmp_path.iterdir()) == []
