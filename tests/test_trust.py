"""The campaign of random scenes: how it judges them; none of a hundred is silently wrong."""

import importlib
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parent.parent / "benchmarks"
SCENES = 100


@pytest.fixture
def trust(monkeypatch):
    monkeypatch.syspath_prepend(FOLDER)
    return importlib.import_module("trust")


def names() -> list[str]:
    """Of all kinds, which the campaign holds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        return list(importlib.import_module("trust").KINDS)


def told(trust, error, growth=1.0, words="", way="alone"):
    return trust.Outcome("made up", 0, way, error, growth, words)


@pytest.mark.instant
def test_verdicts(trust):
    """100 tolerances are right; what is wrong must be told, and what is right must not."""
    verdicts = {
        (9e-5, ""): "right",
        (1.1e-4, ""): "silent",
        (np.inf, ""): "silent",
        (np.nan, ""): "silent",
        (1.1e-4, "flags"): "told",
        (9e-5, "flags"): "false",
    }
    for (error, words), verdict in verdicts.items():
        assert told(trust, error, words=words).verdict == verdict
    # Sensitive motions count apart, unless they are right.
    assert told(trust, 1e-2, growth=2e3).verdict == "apart"
    assert told(trust, 1e-5, growth=2e3).verdict == "right"


@pytest.mark.instant
def test_counts(trust):
    """The shares that have floors are of one way alone."""
    found = [told(trust, 0.0), told(trust, 0.0, words="flags"), told(trust, 1.0)]
    section = trust.counted([*found, told(trust, 1.0, way="sweep")], "alone")
    assert [str(x) for x in section.rows[1][1:7]] == ["3", "1", "0", "1", "0", "1"]
    assert list(section.ratios.values()) == [pytest.approx(2 / 3), 0.5]
    assert len(trust.listed(found, "silent").rows) == 2
    assert str(trust.listed(found, "told")) == "No scene is told."
    assert not np.any(np.isfinite(list(trust.counted(found, "jit").ratios.values())))


@pytest.mark.instant
def test_scenes_are_those_of_their_seeds(trust):
    """Another seed, or another kind, draws other numbers; the same draws the same."""
    kind = trust.Kind(lambda chance: {"x": chance.uniform()}, None, None)
    drawn = [
        trust.numbers_of(name, kind, seed)["x"] for name, seed in (("a", 0), ("a", 1), ("b", 0))
    ]
    assert len(set(drawn)) == 3
    assert trust.numbers_of("a", kind, 1)["x"] == drawn[1]


@pytest.mark.instant
def test_a_campaign_goes_on_where_it_ended(trust, monkeypatch, tmp_path):
    """What is in the file is counted and not done again, a line that was cut off is."""
    kept, ran = tmp_path / "kept.jsonl", []

    def move(numbers):
        ran.append(numbers["x"])
        return np.array([[0.0], [numbers["x"]]]), None

    exact = lambda numbers, nudge: np.array([[0.0], [numbers["x"]]])  # noqa: E731
    kind = trust.Kind(lambda chance: {"x": 1 + chance.uniform()}, move, exact, ("alone",))
    monkeypatch.setattr(trust.outcomes, "__defaults__", ({"a": kind}, ("alone",), ()))
    for scenes in (2, 3):
        sections = list(trust.measure(["a"], scenes, kept=kept))
        assert sections[0].text.startswith(f"{scenes} scenes of 1 of ")
        assert len(ran) == scenes
    text = kept.read_text()
    assert len(text.splitlines()) == 3
    kept.write_text(text[:-9])
    list(trust.measure(["a"], 0, kept=kept))
    assert len(ran) == 3
    list(trust.measure(["a"], 3, kept=kept))
    assert len(ran) == 4
    assert len(trust.read(kept)) == 3


@pytest.mark.instant
@pytest.mark.parametrize(
    ("values", "verdict"), [(None, "told"), ([0.0, 2.0], "silent"), ([0.0, 1.0], "right")]
)
def test_a_refusal_is_told(trust, values, verdict):
    """What is refused in words has no numbers; an error is relative to the way from the start."""
    exact = np.array([[5.0], [6.0]])
    found = None if values is None else 5.0 + np.array(values)[:, None]
    words = "refused" if values is None else ""
    outcome = trust.judged("made up", 0, "alone", (found, words), lambda nudge: exact + nudge)
    assert outcome.verdict == verdict
    assert outcome.growth == (0.0 if verdict == "right" else pytest.approx(1.0, rel=1e-6))


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", names())
def test_no_scene_is_silently_wrong(trust, name):
    """The first of each kind, a hundred in all, in each way."""
    count = -(-SCENES // len(trust.KINDS))
    found = list(trust.outcomes(name, range(count)))
    assert {(one.kind, one.seed) for one in found if one.verdict == "silent"} == set()
