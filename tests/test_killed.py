"""Processes that are killed at any moment lose nothing and leave nothing that is wrong."""

import itertools
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from groups import in_groups
from processes import in_a_process

import romjax as rj

KILLS = in_groups([3, 100], slow=[3])  # the last is required

# Each child is forked before JAX starts its threads, as importing takes seconds, and saves two
# things in turn; the parent ends it at some moment, or its own end does.
SAVING = """
import json, pathlib, random, re, time
folder, kills = pathlib.Path(sys.argv[1]), int(sys.argv[2])
{things}
target, ready = folder / name, folder / "ready"
source, found, parent = random.Random(0), [], os.getpid()
for _ in range(kills):
    ready.unlink(missing_ok=True)
    child = os.fork()
    if not child:
        things = [thing(number) for number in range(2)]
        for each in things:
            each.save(target)
        ready.touch()
        while os.getppid() == parent:
            for each in things:
                each.save(target)
        os._exit(0)
    while not ready.exists():
        assert os.waitpid(child, os.WNOHANG)[0] == 0
        time.sleep(0.002)
    time.sleep(source.uniform(0, 0.4))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    found.append(which(target))
print(json.dumps(found))
"""
# Arrays lie beside; each text names its own.
PLATES = """
name = "scene.toml"
shapes = [np.random.default_rng(seed).normal(size=(300, 3, 2)) for seed in range(2)]

def thing(number):
    points = shapes[number][:, 0]
    inertia = rj.Inertia(1.0, 1.0)
    return rj.Scene([rj.ModalBody(f"p{number}", inertia, [4.0, 9.0], points, shapes[number])])

def which(target):
    text = target.read_text()
    (beside,) = set(re.findall('"(scene-.*?)"', text))
    number = int("[bodies.p1]" in text)
    with np.load(folder / beside) as arrays:
        assert any(np.array_equal(arrays[key], shapes[number]) for key in arrays)
    return number
"""
# Long texts that are known before, so that nearly all time goes to writing them.
LONG = """
from romjax.files import write

name = "scene.toml"
texts = [4_000_000 * digit for digit in "01"]
write.text_of = lambda scene, *_: texts[int(scene.bodies[0].name)]

def thing(number):
    return rj.Scene([rj.RigidBody(str(number), 1.0, 1.0)])

def which(target):
    return texts.index(target.read_text())
"""
# Of one motion or the other, all of it.
RUNS = """
import h5netcdf

name = "run.nc"

def thing(number):
    scene = rj.gallery.chain(1)
    return rj.simulate(rj.assemble(scene), np.linspace(0.0, 1.0 + number, 2001))

def which(target):
    with h5netcdf.File(target, "r") as file:
        times = file["time"][:]
        assert all(np.all(np.isfinite(file[name][:])) for name in ("q", "v", "violation"))
    assert len(times) == 2001
    return round(times[-1] - 1)
"""


# Texts are written with the arrays, too.
@pytest.mark.parametrize(
    ("things", "kills"),
    in_groups(
        [(things, kills) for things in (PLATES, LONG, RUNS) for kills in (3, 100)],
        slow=[(PLATES, 3), (RUNS, 3)],
    ),
    ids=[f"{name}-{kills}" for name in ("arrays", "long", "runs") for kills in (3, 100)],
)
def test_what_is_saved_when_the_process_is_killed(things, kills, tmp_path):
    """What the file holds is one of both, with the arrays that belong to it."""
    (line,) = in_a_process(SAVING.format(things=things), tmp_path, kills)
    found = json.loads(line)
    assert len(found) == kills
    assert set(found) <= {0, 1}
    assert kills < 20 or len(set(found)) == 2


SWEEPING = """
import json, pathlib, random, time
folder, result, kills = pathlib.Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])

def sweep():
    # Some milliseconds a chunk: what is computed between all starts and kills is a part of all.
    slow = lambda x: {"y": jax.lax.fori_loop(0, 20000, lambda _, y: jnp.cos(x + y), x)}
    return rj.sweep(slow, np.arange(200.0 * kills), chunk=4, path=folder)

def there():
    return {file.name: file.stat().st_mtime_ns for file in folder.glob("chunk-*.npz")}

history, source = [there()], random.Random(0)
for _ in range(kills):
    child = os.fork()
    if not child:
        sweep()
        os._exit(0)
    ended = False
    while not ended and len(there()) <= len(history[-1]):
        ended = os.waitpid(child, os.WNOHANG)[0] == child
        time.sleep(0.01)
    time.sleep(source.uniform(0, 0.05))
    if not ended:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    history.append(there())
np.save(result, sweep().values["y"])
print(json.dumps([*history, there()]))
"""


@pytest.mark.parametrize("kills", KILLS)
def test_a_sweep_is_killed(kills, tmp_path):
    """It ends with the undisturbed result, and no chunk is computed twice."""
    folder, result = tmp_path / "sweep", tmp_path / "y.npy"
    history = json.loads(in_a_process(SWEEPING, folder, result, kills)[-1])
    assert len(history) == kills + 2
    for before, after in itertools.pairwise(history):
        assert len(before) < len(after)
        assert all(after[name] == then for name, then in before.items())
    chunks = 50 * kills
    assert 0 < len(history[-2]) < chunks  # fewer than all: the sweep was killed each time
    assert len(history[-1]) == chunks

    def slow(x):
        return {"y": jax.lax.fori_loop(0, 20000, lambda _, y: jnp.cos(x + y), x)}

    whole = rj.sweep(slow, np.arange(200.0 * kills), chunk=4)
    assert np.array_equal(np.load(result), whole.values["y"])


SHARING = """
import pathlib, random, time
from romjax.study.sweeps import claims

folder, result, seed = sys.argv[1], sys.argv[2], int(sys.argv[3])
claims.BEAT, claims.VOID = 0.05, 0.5
source = random.Random(seed)

def sweep():
    slow = lambda x: {"y": jax.lax.fori_loop(0, 40000, lambda _, y: jnp.cos(x + y), x)}
    return rj.sweep(slow, np.arange(200.0), chunk=4, path=folder)

def there():
    return len(list(pathlib.Path(folder).glob("chunk-*.npz")))

late = source.uniform(0.2, 1.0)
children = []
for number in range(4):
    child = os.fork()
    if not child:
        time.sleep(late * (number == 3))
        np.save(f"{result}{number}.npy", sweep().values["y"])
        os._exit(0)
    children.append(child)
killed, stopped, third, last = children
moment = source.randrange(1, 15)
while there() < moment:
    time.sleep(0.005)
os.kill(killed, signal.SIGKILL)
os.kill(stopped, signal.SIGSTOP)
time.sleep(source.uniform(0.1, 2.0))
os.kill(stopped, signal.SIGCONT)
for child in children:
    os.waitpid(child, 0)
print(there(), len(list(pathlib.Path(folder).glob("claim-*"))))
"""


@pytest.mark.parametrize("seed", in_groups(range(20), slow=[0]))
def test_processes_share_a_sweep(seed, tmp_path):
    """One is killed, one stopped for a while, one comes late; each that ends has all of it, equal
    to the bit to that of one process.
    """
    folder, result = tmp_path / "sweep", tmp_path / "y"
    (line,) = in_a_process(SHARING, folder, result, seed)
    assert line == "50 0"

    def slow(x):
        return {"y": jax.lax.fori_loop(0, 40000, lambda _, y: jnp.cos(x + y), x)}

    whole = rj.sweep(slow, np.arange(200.0), chunk=4).values["y"]
    for number in (1, 2, 3):
        assert np.array_equal(np.load(f"{result}{number}.npy"), whole)


# Programs of other numbers of coordinates, in a cache of their own, which begins empty.
RUNNING = """
import json, random, time
kills, source = int(sys.argv[1]), random.Random(0)

def run(count):
    spring = lambda t, q, v: -4.0 * q
    one = lambda q: jnp.eye(count)
    system = rj.CustomSystem(one, spring, q0=[1.0] * count, v0=[0.0] * count)
    return rj.simulate(system, np.linspace(0.0, 1.0, 11))

for i in range(kills):
    child = os.fork()
    if not child:
        run(1 + i % 5)
        os._exit(0)
    time.sleep(source.uniform(0, 3.0))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
print(json.dumps([run(1 + i).q[-1].tolist() for i in range(5)]))
"""


@pytest.mark.parametrize("kills", KILLS)
def test_runs_are_killed(kills, tmp_path):
    """Programs that they left in the cache give the right motion."""
    (line,) = in_a_process(RUNNING, kills, ROMJAX_CACHE_DIR=str(tmp_path))
    for i, found in enumerate(json.loads(line)):
        assert len(found) == i + 1
        assert np.allclose(found, np.cos(2.0), atol=1e-5)
