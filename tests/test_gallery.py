"""The ready scenes: each is what its file says, runs, keeps its energy, and shows its fact."""

import re
import tomllib
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest
import zoo
from gallery import keep
from gallery_facts import IN_THE_PLANE, outputs
from gallery_facts_in_space import IN_SPACE
from groups import in_groups

import romjax as rj
from romjax.files.settings import Settings
from romjax.gallery import EXAMPLES, find
from romjax.system.dynamics import jacobian

FILES = Path(rj.__file__).parent / "gallery" / "files"
# At the tolerance of the catalogue; all others at that of the default settings, with which the
# squeezer's crank is 1.1e-4 rad off after its 24 turns, and a flag says so.
TIGHTLY = ("slider-crank", "squeezer")
# With the balance of energy among the slow tests, since it makes a program half as long again: of
# what shows energies, of a chain in gravity, of contacts, and of what stiffens. Parts that bend are
# in test_long_runs.py, and all scenes with it among the exhaustive tests.
AUDITED = (
    "newtons-cradle",
    "rotating-blade",
    "squeezer",
    "swinging-cable",
    "trebuchet",
    "uncoiling-strip",
)
# What other tests move too, by one program, and is in space: in fast tests its file alone.
FAST = "spinning-top"

FACTS = {fact.__name__.replace("_", "-"): fact for fact in (*IN_THE_PLANE, *IN_SPACE)}
# All other scenes, each with its balance of energy or without.
FEW = [(name, name in AUDITED) for name in FACTS if name != FAST]
BY_DEFAULT = [*FEW, *((name, True) for name in FACTS if (name, True) not in FEW)]
# Rows that repeat others.
REPEATED = {"bricard": 1}


@pytest.mark.instant
def test_every_scene_has_a_fact():
    assert [example.name for example in EXAMPLES] == list(FACTS)
    assert len(FACTS) >= 16


@pytest.mark.instant
@pytest.mark.parametrize("name", ["bricard", "flyball-governor", "rotor", "spatial-arm"])
def test_a_scene_in_space_is_made_without_compiling(name):
    """In each process some operations of JAX would take longer than all else that makes it."""
    assert find(name).make().bodies


@pytest.mark.slow
def test_scene():
    """Tightly, and without the balance of energy."""
    run_and_show(find(FAST), zoo.run)


@pytest.mark.parametrize(("name", "audit"), in_groups(BY_DEFAULT, slow=FEW))
def test_scene_by_default(name, audit):
    """With the default settings, but for one tolerance and, in most, the balance of energy; with
    that too in the exhaustive cases.
    """
    example = find(name)
    settings = {"audit": audit}
    if name in TIGHTLY:
        settings["rtol"] = example.rtol
    run_and_show(example, lambda system, ts: rj.simulate(system, ts, **settings))


def run_and_show(example, simulated):
    """A scene shows its fact, and its moving picture is kept, for the site."""
    scene = example.make()
    system = rj.assemble(scene)
    # No joint repeats another, and what is left is what the catalogue says. Quaternions have a
    # length of their own.
    independent = system.m - REPEATED.get(example.name, 0)
    rows = eqx.filter_jit(jacobian)(system, 0.0, system.q0)
    assert np.linalg.matrix_rank(rows) == independent
    lengths = len(system.structure.quaternions)
    assert system.n - independent - lengths == example.freedoms
    run = simulated(system, outputs(example))
    assert run.is_valid, run.warnings()
    FACTS[example.name](system, run)
    keep(example, scene, run)


@pytest.mark.parametrize("name", in_groups(FACTS, fast=[FAST], slow=FACTS))
def test_file(name):
    """From Python and from its file a scene is the same, to the bit."""
    a, b = find(name).make(), rj.load_scene(FILES / f"{name}.toml")
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert np.asarray(x).tobytes() == np.asarray(y).tobytes()


@pytest.mark.instant
def test_every_file_says_how_its_scene_runs():
    files = {path.stem: tomllib.loads(path.read_text("utf-8")) for path in FILES.glob("*.toml")}
    assert files.keys() == {example.name for example in EXAMPLES}
    for example in EXAMPLES:
        file = files[example.name]
        settings = Settings.of(file.get("run", {}))
        assert file["title"] == example.title
        assert (settings.end, settings.rate) == (example.end, example.rate)
        assert (settings.pod_rank, settings.sod_rank) == (example.pod_rank, example.sod_rank)


def test_numbers_of_scenes_keep_their_derivatives():
    """Written as decimal numbers, lengths would have none."""
    flywheel = find("flywheel").make

    def length(hub, rim):
        scene = flywheel(hub=hub, rim=rim)
        return scene.bodies[-1].length + 2 * scene.bodies[0].at("foot1").point[0]

    assert jax.jit(jax.grad(length, argnums=(0, 1)))(0.1, 0.3) == (1.0, 1.0)


@pytest.mark.instant
def test_numbers_of_files_are_not_those_of_rounding():
    """None is a short decimal but for rounding, such as 0.30000000000000004."""
    for path in FILES.glob("*.toml"):
        noisy = re.findall(r"\b\d+\.\d*?(?:0{7,}|9{7,})\d{1,2}\b", path.read_text("utf-8"))
        assert not noisy, (path.name, noisy)
