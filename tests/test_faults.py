"""What fails around a run: no home, folders that cannot be written to, processes that end."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = pytest.mark.skipif(getattr(os, "geteuid", int)() != 0, reason="becomes another user")
KILLS = 20  # required
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


RUN = """
system = rj.assemble(rj.gallery.chain(1))
print(rj.simulate(system, np.linspace(0.0, 0.1, 3), solver=rj.Rodas5P()).summary())
"""
# The other user may not be able to read the packages: what they load late is loaded before.
BECOME = """
folder = os.environ.pop("ROMJAX_CACHE_DIR", None)
os.environ["ROMJAX_CACHE_DIR"] = ""
rj.simulate(rj.assemble(rj.gallery.chain(2)), np.linspace(0.0, 0.1, 3), solver=rj.Rodas5P())
del os.environ["ROMJAX_CACHE_DIR"]
if folder is not None:
    os.environ["ROMJAX_CACHE_DIR"] = folder
os.setgid(54321), os.setuid(54321)
"""
# Whether it takes all programs from disk.
COUNTED = """
compiled, calls = jax.stages.Lowered.compile, []

def counted(*args, **kwargs):
    calls.append(1)
    return compiled(*args, **kwargs)

jax.stages.Lowered.compile = counted
system = rj.assemble(rj.gallery.chain(1))
assert rj.simulate(system, np.linspace(0.0, 0.1, 3), solver=rj.Rodas5P()).success
print(not calls)
"""


@ROOT
def test_without_a_home_or_an_entry_of_the_user():
    """As in a container that runs under any number."""
    lines = in_a_process(BECOME + RUN, without={"HOME", "XDG_CACHE_HOME", "ROMJAX_CACHE_DIR"})
    assert lines == ["success"]


@pytest.fixture
def shared():
    """A folder that other users find, which those of pytest are not."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@ROOT
@pytest.mark.parametrize("owner", [54321, 0])
def test_a_folder_that_one_can_only_read_from(owner, shared):
    """Its programs are used where it is the user's own; nothing is written to it."""
    caches = shared / "caches"
    assert in_a_process(RUN, ROMJAX_CACHE_DIR=str(caches)) == ["success"]
    files = sorted(caches.rglob("*"))
    assert len(files) > 1
    for path in (caches, *files):
        os.chown(path, owner, -1)
        path.chmod(0o555 if path.is_dir() else 0o444)
    assert in_a_process(BECOME + COUNTED, ROMJAX_CACHE_DIR=str(caches)) == [str(owner == 54321)]
    assert sorted(caches.rglob("*")) == files


# Each child saves two scenes in turn; the parent ends it at some moment.
KILLED = """
import json, pathlib, random, re, time
folder, kills = pathlib.Path(sys.argv[1]), int(sys.argv[2])
target, ready = folder / "scene.toml", folder / "ready"
{scenes}
source, found = random.Random(0), []
for _ in range(kills):
    ready.unlink(missing_ok=True)
    child = os.fork()
    if not child:
        scenes = [scene(number) for number in range(2)]
        for each in scenes:
            each.save(target)
        ready.touch()
        while True:
            for each in scenes:
                each.save(target)
    while not ready.exists():
        assert os.waitpid(child, os.WNOHANG)[0] == 0
        time.sleep(0.002)
    time.sleep(source.uniform(0, 0.4))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    found.append(which(target.read_text()))
print(json.dumps(found))
"""
# Arrays lie beside; each text names its own.
PLATES = """
shapes = [np.random.default_rng(seed).normal(size=(300, 3, 2)) for seed in range(2)]

def scene(number):
    points = shapes[number][:, 0]
    inertia = rj.Inertia(1.0, 1.0)
    return rj.Scene([rj.ModalBody(f"p{number}", inertia, [4.0, 9.0], points, shapes[number])])

def which(text):
    (name,) = set(re.findall('"(scene-.*?)"', text))
    number = int("[bodies.p1]" in text)
    with np.load(folder / name) as arrays:
        assert any(np.array_equal(arrays[key], shapes[number]) for key in arrays)
    return number
"""
# Long texts that are known before, so that nearly all time goes to writing them.
LONG = """
from romjax.files import write

texts = [4_000_000 * digit for digit in "01"]
write.text_of = lambda scene, *_: texts[int(scene.bodies[0].name)]

def scene(number):
    return rj.Scene([rj.RigidBody(str(number), 1.0, 1.0)])

def which(text):
    return texts.index(text)
"""


@pytest.mark.parametrize("scenes", [PLATES, LONG], ids=["arrays", "long"])
def test_a_scene_that_is_saved_when_the_process_is_killed(scenes, tmp_path):
    """What the file holds is one of the scenes, with the arrays that belong to it."""
    (line,) = in_a_process(KILLED.format(scenes=scenes), tmp_path, KILLS)
    found = json.loads(line)
    assert len(found) == KILLS
    assert set(found) == {0, 1}
