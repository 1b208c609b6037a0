"""What fails around a run: no home, and folders that cannot be written to."""

import os
import tempfile
from pathlib import Path

import pytest
from processes import in_a_process

pytestmark = pytest.mark.slow

ROOT = pytest.mark.skipif(getattr(os, "geteuid", int)() != 0, reason="becomes another user")


RUN = """
system = rj.assemble(rj.gallery.chain(1))
run = rj.simulate(system, np.linspace(0.0, 0.1, 3), solver=rj.Rodas5P(), audit=False)
print(run.summary().partition(":")[0])
"""
# The other user may not be able to read the packages: what they load late is loaded before.
BECOME = """
folder = os.environ.pop("ROMJAX_CACHE_DIR", None)
os.environ["ROMJAX_CACHE_DIR"] = ""
system = rj.assemble(rj.gallery.chain(2))
rj.simulate(system, np.linspace(0.0, 0.1, 3), solver=rj.Rodas5P(), audit=False)
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
assert rj.simulate(system, np.linspace(0.0, 0.1, 3), solver=rj.Rodas5P(), audit=False).success
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
def test_a_folder_that_one_can_only_read_from(shared):
    """Its programs are used where it is the user's own; nothing is written to it."""
    caches = shared / "caches"
    assert in_a_process(RUN, ROMJAX_CACHE_DIR=str(caches)) == ["success"]
    files = sorted(caches.rglob("*"))
    assert len(files) > 1
    for path in (caches, *files):
        os.chown(path, 54321, -1)
        path.chmod(0o555 if path.is_dir() else 0o444)
    assert in_a_process(BECOME + COUNTED, ROMJAX_CACHE_DIR=str(caches)) == ["True"]
    assert sorted(caches.rglob("*")) == files
