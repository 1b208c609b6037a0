"""The ready scenes: each runs with the default settings, keeps its energy, and shows its fact."""

from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest
from gallery import keep
from gallery_facts import IN_THE_PLANE, outputs, segmented_beam
from gallery_facts_in_space import IN_SPACE
from groups import in_groups

import romjax as rj
from romjax.gallery import EXAMPLES, find
from romjax.system.dynamics import jacobian

FILES = Path(rj.__file__).parent / "gallery" / "files"
# By the method of the catalogue, at its tolerance; all others with the default settings.
BY_METHOD = ("slider-crank", "segmented-beam", "flyball-governor", "spatial-arm")
# What compiles for a few seconds.
FAST = (
    "cart-pendulum",
    "double-pendulum",
    "chain",
    "four-bar",
    "bouncing-ball",
    "spinning-top",
    "wing-nut",
    "ball-chain",
)


FACTS = {fact.__name__.replace("_", "-"): fact for fact in (*IN_THE_PLANE, *IN_SPACE)}
# Rows that repeat others.
REPEATED = {"bricard": 1}


def test_every_scene_has_a_fact():
    assert [example.name for example in EXAMPLES] == list(FACTS)
    assert len(FACTS) >= 16


@pytest.mark.parametrize("name", in_groups(FACTS, fast=FAST, slow=FACTS))
def test_scene(name):
    """From Python and from its file a scene is the same, to the bit, and shows its fact.

    Its moving picture is kept, for the site.
    """
    example = find(name)
    scene = example.make()
    same(rj.load_scene(FILES / f"{name}.toml"), scene)
    system = rj.assemble(scene)
    # No joint repeats another, and what is left is what the catalogue says. Quaternions have a
    # length of their own.
    independent = system.m - REPEATED.get(name, 0)
    rows = eqx.filter_jit(jacobian)(system, 0.0, system.q0)
    assert np.linalg.matrix_rank(rows) == independent
    lengths = len(system.structure.quaternions)
    assert system.n - independent - lengths == example.freedoms
    by_method = {"solver": example.solver, "rtol": example.rtol}
    settings = by_method if name in BY_METHOD else {}
    run = rj.simulate(system, outputs(example), **settings)
    assert run.is_valid, run.warnings()
    FACTS[name](system, run)
    keep(example, scene, run)


def same(a, b):
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert np.asarray(x).tobytes() == np.asarray(y).tobytes()


def test_a_beam_of_fewer_segments_rolls_up_too():
    example = find("segmented-beam")
    system = rj.assemble(example.make(segments=6))
    run = rj.simulate(system, outputs(example))
    assert run.is_valid, run.warnings()
    segmented_beam(system, run)


def test_every_file_says_how_its_scene_runs():
    for example in EXAMPLES:
        file = rj.scene_file(FILES / f"{example.name}.toml")
        settings = file.settings
        assert file.title == example.title
        assert (settings.end, settings.rate) == (example.end, example.rate)
        assert (settings.pod_rank, settings.sod_rank) == (example.pod_rank, example.sod_rank)
    assert {path.stem for path in FILES.glob("*.toml")} == {example.name for example in EXAMPLES}
