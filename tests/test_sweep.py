"""Many lanes: chunks, devices, failures, and interruptions at any moment."""

import contextlib
import errno
import json
import os
import threading
import time
import types
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from numpy.testing import assert_equal
from processes import in_a_process
from tolerances import IDENTITY, SOLVED
from zoo import Stiffness, run, unit_circle, unit_mass

import romjax as rj
from romjax.study.sweeps import claims
from romjax.study.sweeps.chunks import Chunks
from romjax.study.sweeps.sweep import Sweep, _chunk

TS = np.linspace(0.0, 0.5, 11)


class Pull(eqx.Module):
    """A force along y, whose size is a parameter."""

    size: jax.Array

    def __call__(self, t, q, v):
        return jnp.stack([0 * self.size, -9.81 * self.size])


def swing(p):
    """A pendulum whose start may be impossible."""
    start = jnp.stack([p["x"], jnp.zeros_like(p["x"])])
    system = rj.CustomSystem(unit_mass, Pull(p["gravity"]), unit_circle, q0=start, v0=jnp.zeros(2))
    made = run(system, TS, throw=False, max_steps=1000)
    return {"end": made.q[-1], "run": made}


def lanes(count):
    return {"gravity": np.linspace(0.5, 1.5, count), "x": np.ones(count)}


@pytest.fixture(scope="module")
def whole():
    return rj.sweep(swing, lanes(20), chunk=8)


@pytest.mark.instant
def test_success_knows_what_runs_warn_of():
    """Tolerances that are too coarse, as well as lost energy; not where a model leaves its box."""
    told = [rj.Flag.NONE, rj.Flag.ENERGY, rj.Flag.RESOLUTION, rj.Flag.PHASE, rj.Flag.UNTRIED]
    found = Sweep(None, np.zeros(5, int), np.array([int(x) for x in told]), None)
    assert found.success.tolist() == [True, False, False, False, True]
    assert [*found.failures()] == [1, 2, 3]
    assert "so many times" in found.failures()[3]


@pytest.mark.instant
def test_lanes_of_a_chunk():
    """Some hundred on a CPU, thousands on a GPU, no more than there are; on each device as many."""
    cpu, gpu = types.SimpleNamespace(platform="cpu"), types.SimpleNamespace(platform="gpu")
    assert _chunk([cpu], 1000) == 256
    assert _chunk([cpu, cpu], 101) == 102
    assert _chunk([gpu], 1000) == 1000
    assert _chunk([gpu], 10**6) == 16_384


def test_chunks_change_nothing(whole):
    """Against one batch to the bit, and at their ends one at a time, whose steps round otherwise.

    The last chunk of three is not full.
    """
    together = rj.jit(jax.vmap(swing))(lanes(20))
    assert_equal(whole.values["end"], together["end"])
    assert_equal(whole.values["run"].q, together["run"].q)
    alone = rj.jit(swing)
    for lane in (0, 7, 8, 19):
        wanted = alone({name: x[lane] for name, x in lanes(20).items()})
        assert_close(whole.values["end"][lane], wanted["end"], SOLVED)
    assert whole.values["end"].shape == (20, 2)
    assert np.all(whole.success)


ON_TWO_DEVICES = """
assert len(jax.devices()) == 2
def end(force):
    pulled = lambda t, q, v: force * jnp.array([1.0, 0.0]) - q
    system = rj.CustomSystem(lambda q: jnp.eye(2), pulled, q0=jnp.ones(2), v0=jnp.zeros(2))
    return rj.simulate(system, jnp.linspace(0.0, 1.0, 3), rtol=1e-10).q[-1]
print(*np.ravel(rj.sweep(end, np.array([0.0, 0.5, 1.0, 2.0])).values))
"""


@pytest.mark.slow
def test_lanes_on_two_devices_with_one_start():
    """With nothing set, so that reverse mode is prepared; masses on springs are released from 1 m
    under a force in the first direction.
    """
    flags = "--xla_force_host_platform_device_count=2"
    (line,) = in_a_process(ON_TWO_DEVICES, XLA_FLAGS=flags)
    forces = np.array([0.0, 0.5, 1.0, 2.0])
    wanted = np.stack([forces + (1 - forces) * np.cos(1.0), np.full(4, np.cos(1.0))], axis=1)
    assert_close(np.reshape([float(x) for x in line.split()], (4, 2)), wanted, SOLVED)


def test_impossible_lanes_leave_the_others_as_they_are(whole):
    """NaN, an inconsistent start and a run without end, by the status of a run inside of results;
    the others are the same to the bit.
    """
    parameters = lanes(20)
    bad = {3: ("gravity", np.nan), 11: ("x", 1.1), 17: ("gravity", 1e14)}
    for lane, (name, value) in bad.items():
        parameters[name][lane] = value
    found = rj.sweep(swing, parameters, chunk=8)
    assert set(found.failures()) == set(bad)
    assert "violates the constraints" in found.failures()[11]
    assert np.all(np.isnan(found.values["end"][list(bad)]))
    good = found.success
    assert np.array_equal(found.values["end"][good], whole.values["end"][good])
    steps = [np.asarray(x.values["run"].stats.num_steps)[good] for x in (found, whole)]
    assert np.array_equal(*steps)


def test_negative_masses_and_inertias_are_no_success():
    """Scenes refuse numbers alone. A constant force moves a negative mass smoothly, backwards."""

    def pushed(p):
        body = rj.RigidBody("body", *p)
        push = rj.Force(body.at(), (1.0, 0.0), rj.Constant(1.0))
        made = run(rj.assemble(rj.Scene([body], effects=[push])), TS, throw=False)
        return {"end": made.q[-1, 0], "status": made.status}

    found = rj.sweep(pushed, np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0]]))
    assert_close(found.values["end"][0], 0.5 * TS[-1] ** 2, IDENTITY)
    assert np.all(np.isnan(found.values["end"][1:]))
    assert_equal(found.status, [rj.Status.SUCCESS] + 2 * [rj.Status.NEGATIVE_MASS])


def test_negative_inertias_in_space_are_seen_in_any_orientation():
    def has_mass(inertia):
        turn = rj.spatial.euler("XYZ", (0.3, 0.5, 0.7))
        body = rj.spatial.RigidBody("body", 1.0, inertia, orientation=turn)
        system = rj.assemble(rj.Scene([body]))
        return system.state(0.0, system.q0, system.v0).has_mass()

    inertias = jnp.array([[1.0, 1.0, 1.0], [-0.1, 1.0, 1.0], [1.0, 1.0, -0.01]])
    assert_equal(np.asarray(jax.jit(jax.vmap(has_mass))(inertias)), [True, False, False])


def test_any_function_and_any_trajectory():
    """Without a status, NaNs say it, and not what never comes; a Trajectory brings its own."""
    found = rj.sweep(jnp.log, np.array([1.0, -1.0, 0.0]))
    assert list(found.failures()) == [1]
    assert np.array_equal(found.values, [0.0, np.nan, -np.inf], equal_nan=True)

    def motion(x):
        force = Stiffness(jnp.ones(1), jnp.zeros(1))
        system = rj.CustomSystem(unit_mass, force, q0=x[None], v0=[0.0])
        return run(system, TS, throw=False)

    found = rj.sweep(motion, np.array([1.0, 2.0]))
    q = np.asarray(found.values.q)
    assert q.shape == (2, len(TS), 1)
    assert np.allclose(q[1], 2 * q[0])


def test_a_function_is_compiled_once():
    """Also one that holds arrays: other numbers in it are another call of the same program."""
    traced = []

    def scale(factor, x):
        traced.append(x)
        return factor * x

    for factor in (2.0, 3.0):
        before = len(traced)
        found = rj.sweep(eqx.Partial(scale, jnp.asarray(factor)), np.arange(5.0), chunk=2)
        assert np.array_equal(found.values, factor * np.arange(5.0))
    assert len(traced) == before == 1


def test_a_sweep_goes_on_where_it_was(tmp_path, whole):
    """Chunks that are there are read, the others computed; another sweep is refused."""
    first = rj.sweep(swing, lanes(20), chunk=8, path=tmp_path)
    files = sorted(tmp_path.glob("chunk-*.npz"))
    assert len(files) == 3
    files[1].unlink()
    before = {file: file.stat().st_mtime_ns for file in files if file.exists()}
    second = rj.sweep(swing, lanes(20), chunk=8, path=tmp_path)
    for found in (first, second):
        assert np.array_equal(found.values["end"], whole.values["end"])
    assert all(file.stat().st_mtime_ns == then for file, then in before.items())
    with pytest.raises(ValueError, match="another sweep, which differs in its parameters"):
        rj.sweep(swing, {**lanes(20), "x": 2 * np.ones(20)}, chunk=8, path=tmp_path)
    with pytest.raises(ValueError, match="another sweep, which differs in its results"):
        rj.sweep(lambda p: {"other": p["x"]}, lanes(20), chunk=8, path=tmp_path)


def double(p):
    return {"y": 2 * p["x"]}


def numbers(seed=0):
    return {"x": np.random.default_rng(seed).normal(size=20)}


def spoil(way, files, tmp_path):
    """Make a file of a folder of chunks one that is not its own, or not whole."""
    content = files[1].read_bytes()
    match way:
        case "another chunk":
            files[1].write_bytes(files[0].read_bytes())
        case "truncated":
            files[1].write_bytes(content[: len(content) // 2])
        case "empty":
            files[1].write_bytes(b"")
        case "one bit":
            files[1].write_bytes(content.replace(*spoilt(files[1])))
        case "no checksum":
            np.savez(files[1], *np.load(files[1]).values())
        case "other lanes":
            other = tmp_path / "other"
            rj.sweep(double, numbers(1), chunk=8, path=other)
            files[1].write_bytes((other / files[1].name).read_bytes())


def spoilt(file):
    """The numbers of a chunk as they are in its file, and with one bit of them turned over."""
    with np.load(file) as stored:
        before = stored["arr_0"].tobytes()
    return before, bytes([before[0] ^ 1]) + before[1:]


WAYS = ["another chunk", "truncated", "empty", "one bit", "no checksum", "other lanes"]


@pytest.mark.parametrize("way", WAYS)
def test_what_is_not_the_chunk_is_computed_anew(way, tmp_path):
    folder, wanted = tmp_path / "sweep", 2 * numbers()["x"]
    rj.sweep(double, numbers(), chunk=8, path=folder)
    files = sorted(folder.glob("chunk-*.npz"))
    before = [file.read_bytes() for file in files]
    spoil(way, files, tmp_path)
    assert files[1].read_bytes() != before[1]
    found = rj.sweep(double, numbers(), chunk=8, path=folder)
    assert np.array_equal(found.values["y"], wanted)
    assert [file.read_bytes() for file in files] == before


def test_a_full_disk_keeps_the_chunks_that_are_done(tmp_path, monkeypatch):
    written, write = [], Path.write_bytes

    def full(path, content):
        written.append(path)
        if len(written) > 2:  # what says which sweep it is, and a chunk
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(path, content)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_bytes", full)
        with pytest.raises(OSError, match="nothing was written.*chunk-000001.npz"):
            rj.sweep(double, numbers(), chunk=8, path=tmp_path)
    names = ["chunk-000000.npz", "sweep.json"]
    assert sorted(file.name for file in tmp_path.iterdir()) == names
    before = (tmp_path / names[0]).stat().st_mtime_ns
    found = rj.sweep(double, numbers(), chunk=8, path=tmp_path)
    assert np.array_equal(found.values["y"], 2 * numbers()["x"])
    assert (tmp_path / names[0]).stat().st_mtime_ns == before


def test_a_folder_that_does_not_say_which_sweep_it_holds_is_refused(tmp_path):
    """As where the file belongs to another program; without it, whole chunks are used."""
    rj.sweep(double, numbers(), chunk=8, path=tmp_path)
    files = sorted(tmp_path.glob("chunk-*.npz"))
    before = [file.stat().st_mtime_ns for file in files]
    for content in (b"", b'{"lanes": 2', b"[1]", b"\xff"):
        (tmp_path / "sweep.json").write_bytes(content)
        with pytest.raises(ValueError, match="sweep.json does not say which.*remove the file"):
            rj.sweep(double, numbers(), chunk=8, path=tmp_path)
        assert (tmp_path / "sweep.json").read_bytes() == content
    (tmp_path / "sweep.json").unlink()
    rj.sweep(double, numbers(), chunk=8, path=tmp_path)
    assert [file.stat().st_mtime_ns for file in files] == before


def test_claims_of_the_living_are_waited_for_and_those_of_the_dead_are_not(tmp_path, monkeypatch):
    """A claim is void that nobody renews, or whose process has ended on this machine."""
    monkeypatch.setattr(claims, "VOID", 0.2)
    mine = claims.Claims(tmp_path)
    other = claims.Claims(tmp_path)
    with mine.held(3) as own, other.held(3) as both, other.held(4) as another:
        assert (own, both, another) == (True, False, True)
    assert not list(tmp_path.iterdir())
    # Of another machine: only its age tells.
    file = tmp_path / "claim-000003.json"
    file.write_text('{"host": "elsewhere", "pid": 1, "key": ""}')
    with mine.held(3) as own:
        assert not own
    os.utime(file, (0, 0))
    with mine.held(3) as own:
        assert own
    # Of this one: a process that is not there any more.
    file.write_text(json.dumps({**mine.owner, "pid": 2**22 + 1, "key": ""}))
    with mine.held(3) as own:
        assert own
    # What is not yet written is somebody's.
    file.write_text("")
    with mine.held(3) as own:
        assert not own


def test_a_sweep_waits_for_chunks_of_others(tmp_path):
    """And computes what is given up."""
    folder = tmp_path / "sweep"
    whole = rj.sweep(double, numbers(), chunk=8, path=folder)
    (folder / "chunk-000001.npz").unlink()
    file = folder / "claim-000001.json"
    file.write_text('{"host": "elsewhere", "pid": 1, "key": ""}')
    threading.Timer(0.3, file.unlink).start()
    began = time.monotonic()
    found = rj.sweep(double, numbers(), chunk=8, path=folder)
    assert time.monotonic() - began >= 0.25
    assert np.array_equal(found.values["y"], whole.values["y"])
    assert not list(folder.glob("claim-*"))


def test_a_sweep_computes_rather_than_be_idle(tmp_path):
    """Of what another process holds for longer than a chunk takes here: it may be stopped."""
    whole = rj.sweep(double, numbers(), chunk=8, path=tmp_path)
    for number in (1, 2):
        (tmp_path / f"chunk-00000{number}.npz").unlink()
    claim = tmp_path / "claim-000001.json"
    claim.write_text('{"host": "elsewhere", "pid": 1, "key": ""}')
    began = time.monotonic()
    found = rj.sweep(double, numbers(), chunk=8, path=tmp_path)
    assert time.monotonic() - began < claims.VOID / 2
    assert np.array_equal(found.values["y"], whole.values["y"])


def numbered(computed):
    """A function that computes a chunk, and keeps its number."""

    def compute(number):
        computed.append(number)
        return [np.array([number])]

    return compute


def test_a_process_that_comes_late_leaves_the_living_their_chunks(tmp_path, monkeypatch):
    """It cannot know how long one takes, but that its claim is renewed; a stopped one's is not."""
    monkeypatch.setattr(claims, "BEAT", 0.2)
    living, late, computed = Chunks(tmp_path), Chunks(tmp_path), []

    def slowly(number):
        time.sleep(8 * claims.BEAT)
        return [np.array([number])]

    other = threading.Thread(target=living.complete, args=(1, slowly, id))
    other.start()
    while not (tmp_path / "claim-000000.json").exists():
        time.sleep(0.01)
    assert_equal(late.complete(1, numbered(computed), id), [np.array([0])])
    other.join()
    assert not computed
    (tmp_path / "claim-000001.json").write_text('{"host": "elsewhere", "pid": 1, "key": ""}')
    began = time.monotonic()
    assert_equal(Chunks(tmp_path).complete(2, numbered(computed), id), [np.array([0, 1])])
    assert 2 * claims.BEAT < time.monotonic() - began < claims.VOID / 2
    assert computed == [1]


def test_all_waits_together_take_no_longer_than_a_chunk(tmp_path):
    """Of chunks that a stopped process holds; it does not wait for each anew."""
    takes, count = 0.3, 4

    def compute(number):
        time.sleep(takes)
        return [np.array([number])]

    for number in range(1, count):
        held = tmp_path / f"claim-00000{number}.json"
        held.write_text('{"host": "elsewhere", "pid": 1, "key": ""}')
    began = time.monotonic()
    Chunks(tmp_path).complete(count, compute, id)
    assert time.monotonic() - began < (count + 3) * takes


def test_processes_that_are_idle_begin_at_different_chunks(tmp_path):
    """Of those that others hold for longer than one took here."""
    begun = []

    def compute(number):
        begun.append(number)
        raise KeyboardInterrupt

    holder = claims.Claims(tmp_path)
    with contextlib.ExitStack() as stack:
        assert all(stack.enter_context(holder.held(number)) for number in range(8))
        for _ in range(8):
            idle = Chunks(tmp_path)
            idle.latest = 1e-3
            with pytest.raises(KeyboardInterrupt):
                idle.complete(8, compute, id)
    assert len(begun) == 8
    assert len(set(begun)) > 1


@pytest.mark.instant
def test_what_cannot_be_swept():
    for wrong in ({"a": np.ones(2), "b": np.ones(3)}, np.asarray(1.0), np.ones((0, 2)), {}):
        with pytest.raises(ValueError, match="one leading axis of lanes"):
            rj.sweep(lambda x: x, wrong)
    with pytest.raises(ValueError, match="at least one lane"):
        rj.sweep(lambda x: x, np.ones(3), chunk=0)
