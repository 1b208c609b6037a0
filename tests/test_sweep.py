"""Many lanes: chunks, devices, failures, and interruptions at any moment."""

import os
import random
import signal
import subprocess
import sys
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import romjax as rj

TS = jnp.linspace(0.0, 0.5, 11)
KILLS = 20  # required


def swing(p):
    """A pendulum whose start may be impossible."""
    system = rj.CustomSystem(
        lambda q: jnp.eye(2),
        lambda t, q, v: jnp.array([0.0, -9.81]) * p["gravity"],
        lambda t, q: 0.5 * (q @ q - 1)[None],
        q0=jnp.stack([p["x"], jnp.zeros_like(p["x"])]),
        v0=jnp.zeros(2),
    )
    run = rj.simulate(system, TS, solver=rj.Rodas5P(), throw=False, max_steps=1000)
    return {"end": run.q[-1], "steps": run.stats.num_steps, "status": run.status}


def lanes(count):
    return {"gravity": jnp.linspace(0.5, 1.5, count), "x": jnp.ones(count)}


@pytest.fixture(scope="module")
def whole():
    return rj.sweep(swing, lanes(40), chunk=8)


def test_chunks_change_nothing(whole):
    """Against one at a time; the last chunk of three is not full."""
    other = rj.sweep(swing, lanes(40), chunk=16)
    assert np.allclose(other.values["end"], whole.values["end"], rtol=1e-12)
    alone = jax.jit(swing)({"gravity": jnp.asarray(0.5), "x": jnp.asarray(1.0)})
    assert np.allclose(alone["end"], whole.values["end"][0], rtol=1e-12)
    assert np.all(whole.success)


def test_impossible_lanes_leave_the_others_as_they_are(whole):
    """NaN, an inconsistent start and a run without end; the others are the same to the bit."""
    parameters = lanes(40)
    bad = {3: ("gravity", jnp.nan), 17: ("x", 1.1), 30: ("gravity", 1e14)}
    for lane, (name, value) in bad.items():
        parameters[name] = parameters[name].at[lane].set(value)
    found = rj.sweep(swing, parameters, chunk=8)
    assert set(found.failures()) == set(bad)
    assert "violates the constraints" in found.failures()[17]
    assert np.all(np.isnan(found.values["end"][list(bad)]))
    good = found.success
    assert np.array_equal(found.values["end"][good], whole.values["end"][good])
    assert np.array_equal(found.values["steps"][good], whole.values["steps"][good])


def test_any_function_and_any_trajectory():
    """Without a status, numbers that are not finite say it; a Trajectory brings its own."""
    found = rj.sweep(lambda x: jnp.log(x), jnp.array([1.0, -1.0, 2.0]))
    assert list(found.failures()) == [1]

    def run(x):
        system = rj.CustomSystem(lambda q: jnp.eye(1), lambda t, q, v: -q, q0=x[None], v0=[0.0])
        return rj.simulate(system, TS, throw=False)

    found = rj.sweep(run, jnp.array([1.0, 2.0]))
    assert found.values.q.shape == (2, len(TS), 1)
    assert np.allclose(found.values.q[1], 2 * found.values.q[0])


def test_a_function_is_compiled_once():
    """Also one that holds arrays; what is traced again are the shapes of its results."""
    traced = []

    def scale(factor, x):
        traced.append(x)
        return factor * x

    for factor in (2.0, 3.0):
        before = len(traced)
        found = rj.sweep(eqx.Partial(scale, jnp.asarray(factor)), jnp.arange(5.0), chunk=2)
        assert np.array_equal(found.values, factor * np.arange(5.0))
    assert len(traced) == before + 1


def test_a_sweep_goes_on_where_it_was(tmp_path, whole):
    """Chunks that are there are read, the others computed; another sweep is refused."""
    first = rj.sweep(swing, lanes(40), chunk=8, path=tmp_path)
    files = sorted(tmp_path.glob("chunk-*.npz"))
    assert len(files) == 5
    files[2].unlink()
    before = {file: file.stat().st_mtime_ns for file in files if file.exists()}
    second = rj.sweep(swing, lanes(40), chunk=8, path=tmp_path)
    for found in (first, second):
        assert np.array_equal(found.values["end"], whole.values["end"])
    assert all(file.stat().st_mtime_ns == then for file, then in before.items())
    with pytest.raises(ValueError, match="another sweep, which differs in its parameters"):
        rj.sweep(swing, {**lanes(40), "x": 2 * jnp.ones(40)}, chunk=8, path=tmp_path)
    with pytest.raises(ValueError, match="another sweep, which differs in its results"):
        rj.sweep(lambda p: {"other": p["x"]}, lanes(40), chunk=8, path=tmp_path)


def test_statuses_inside_of_results():
    def run(x):
        system = rj.CustomSystem(
            lambda q: jnp.eye(2),
            lambda t, q, v: -q,
            lambda t, q: q[:1] - 1,
            q0=jnp.stack([x, x]),
            v0=jnp.zeros(2),
        )
        motion = rj.simulate(system, TS, solver=rj.Rodas5P(), throw=False)
        return {"run": motion, "last": motion.q[-1]}

    found = rj.sweep(run, jnp.array([1.0, 1.1]))
    assert list(found.failures()) == [1]
    assert np.all(np.isnan(found.values["last"][1]))


def test_what_cannot_be_swept():
    for wrong in ({"a": jnp.ones(2), "b": jnp.ones(3)}, jnp.asarray(1.0), jnp.ones((0, 2)), {}):
        with pytest.raises(ValueError, match="one leading axis of lanes"):
            rj.sweep(lambda x: x, wrong)
    with pytest.raises(ValueError, match="at least one lane"):
        rj.sweep(lambda x: x, jnp.ones(3), chunk=0)


KILLED = """
import sys, jax, jax.numpy as jnp, numpy as np, romjax as rj
jax.config.update("jax_enable_x64", True)
# Some milliseconds a chunk: what is computed between twenty starts and kills is a part of all.
slow = lambda x: {"y": jax.lax.fori_loop(0, 20000, lambda _, y: jnp.cos(x + y), x)}
found = rj.sweep(slow, jnp.arange(4000.0), chunk=4, path=sys.argv[1])
np.save(sys.argv[2], found.values["y"])
"""


@pytest.mark.slow
def test_killed_at_any_moment(tmp_path):
    """After SIGKILL at random times the sweep ends with the undisturbed result, and no chunk is
    computed twice.
    """
    folder, result = tmp_path / "sweep", tmp_path / "y.npy"
    command = [sys.executable, "-c", KILLED, str(folder), str(result)]
    written: dict[str, int] = {}
    source = random.Random(0)
    for _ in range(KILLS):
        process = subprocess.Popen(command, env={**os.environ, "JAX_PLATFORMS": "cpu"})
        known = len(list(folder.glob("chunk-*.npz")))
        while process.poll() is None and len(list(folder.glob("chunk-*.npz"))) <= known:
            time.sleep(0.01)
        time.sleep(source.uniform(0, 0.05))
        process.send_signal(signal.SIGKILL)
        process.wait()
        now = {file.name: file.stat().st_mtime_ns for file in folder.glob("chunk-*.npz")}
        assert all(now[name] == then for name, then in written.items())
        written = now
    assert 0 < len(written) < 1000  # fewer than all: the sweep was killed each time
    subprocess.run(command, check=True)
    whole = rj.sweep(
        lambda x: {"y": jax.lax.fori_loop(0, 20000, lambda _, y: jnp.cos(x + y), x)},
        jnp.arange(4000.0),
        chunk=4,
    )
    assert np.array_equal(np.load(result), whole.values["y"])
    now = {file.name: file.stat().st_mtime_ns for file in folder.glob("chunk-*.npz")}
    assert all(now[name] == then for name, then in written.items())
    assert len(now) == 1000
