"""How far romjax can be trusted with nothing set: random scenes, each against a truth of its own.

A motion is right where it is within 100 tolerances of its own size (rtol = 1e-6) of the truth;
told, where it is not, and romjax says so by a flag, a warning or a refusal; silent, where it is not
and nothing was said; false, where it is right, and something was said. Sensitive motions, of which
a start that is moved by 1e-9 of the motion ends 1e-6 of it apart, are counted apart where they are
wrong or told of. Each scene runs alone, under `jit` and in a sweep (`jit` of `vmap`), where the
flags count. Kinds and their truths are in `trust_kinds`; a scene is its kind and its seed. Writes
`trust.txt` beside this file.

Hours of work are not lost: `--kept FILE` adds every outcome to a file as soon as it is found, and
what is in the file is not done again. The record says how many outcomes are of which commit.
"""

import functools
import json
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import record
from tqdm import tqdm
from trust_kinds import (
    bent,
    combined,
    contacts,
    driven,
    events,
    flexible,
    joints,
    lasting,
    loads,
    planar,
    reduced,
    rods,
    rolling,
    scales,
    sizes,
    spatial,
    states,
    stops,
    top,
    tumbling,
)
from trust_kinds.kind import (
    LANES,
    Found,
    Kind,
    Numbers,
    Outcome,
    alone,
    compiled,
    judged,
    numbers_of,
    swept,
)

SCENES = 36  # of each kind, 2000 in each way
WAYS = {
    "alone": "each by itself",
    "jit": "each under `jit`",
    "sweep": f"in sweeps of {LANES} lanes at a time",
}
VERDICTS = ("right", "told", "false", "apart", "silent")
SHOWN = 60  # cases that are listed
FAMILIES = (
    *(planar, driven, flexible, spatial, top, bent, loads, events, contacts, scales, reduced),
    *(sizes, rods, states, rolling, joints, stops, tumbling, combined, lasting),
)
KINDS: dict[str, Kind] = {name: kind for family in FAMILIES for name, kind in family.KINDS.items()}


Done = tuple[str, int, str]  # a kind, a seed and a way


def outcomes(
    name: str,
    seeds: Sequence[int],
    kinds: Mapping[str, Kind] = KINDS,
    ways: Collection[str] = tuple(WAYS),
    done: Collection[Done] = (),
) -> Iterator[Outcome]:
    """What comes of the scenes of one kind, in each way, but of those that are done."""
    kind = kinds[name]

    @functools.cache
    def numbers(seed: int) -> Numbers:
        return numbers_of(name, kind, seed)

    @functools.cache
    def truth(seed: int, nudge: float) -> np.ndarray:
        return kind.truth(numbers(seed), nudge)

    for way in (way for way in kind.ways if way in ways):
        left = [seed for seed in seeds if (name, seed, way) not in done]
        # No bar where nobody looks.
        bar = tqdm(left, f"{name}, {way}", leave=False, disable=None)
        for seed, one in zip(bar, found_in(way, kind, map(numbers, left)), strict=True):
            yield judged(name, seed, way, one, functools.partial(truth, seed))


def found_in(way: str, kind: Kind, every: Iterable[Numbers]) -> Iterator[Found]:
    """What comes of scenes in one way; those in a batch, at once."""
    if way == "alone":
        yield from (alone(kind, numbers) for numbers in every)
    elif batch := list(every):
        yield from {"jit": compiled, "sweep": swept}[way](kind, batch)


def read(kept: Path | None) -> list[tuple[str, Outcome]]:
    """Outcomes in a file, each with the commit of what it was found with; a last line that was cut
    off is taken away.
    """
    if kept is None or not kept.exists():
        return []
    text = kept.read_text()
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        kept.write_text(whole)
    return [(one.pop("commit"), Outcome(**one)) for one in map(json.loads, whole.splitlines())]


def write(kept: Path | None, at: str, one: Outcome) -> None:
    """Add an outcome to a file, which is whole after each."""
    if kept is not None:
        with kept.open("a") as file:
            file.write(json.dumps({"commit": at, **one._asdict()}) + "\n")


def counted(found: Sequence[Outcome], way: str) -> record.Section:
    """The table of one way of running, and the shares that have floors."""
    rows = [["kind", "scenes", *VERDICTS, "largest error of those right"]]
    here = [one for one in found if one.way == way]
    total = Counter(one.verdict for one in here)
    for name in dict.fromkeys(one.kind for one in here):
        own = [one for one in here if one.kind == name]
        counts = Counter(one.verdict for one in own)
        right = [one.error for one in own if one.verdict == "right"]
        rows.append(
            [name, len(own), *(counts[v] for v in VERDICTS), f"{max(right, default=0):.0e}"]
        )
    rows.append(["all", len(here), *(total[v] for v in VERDICTS), ""])
    silent, right = total["silent"], total["right"] + total["false"]
    # Of none there is no share, which is no success.
    shares = [
        1 - silent / len(here) if here else np.nan,
        total["right"] / right if right else np.nan,
    ]
    names = "scenes not silently wrong / all", "right without alarm / right"
    ratios = {f"{way}: {name}": share for name, share in zip(names, shares, strict=True)}
    return record.Section(f"Scenes with nothing set, {WAYS[way]}:", rows, ratios)


def listed(found: Sequence[Outcome], verdict: str) -> record.Section:
    """The scenes of one verdict, of the largest errors first."""
    cases = sorted((one for one in found if one.verdict == verdict), key=lambda one: -one.error)
    if not cases:
        return record.Section(f"No scene is {verdict}.")
    rows = [["kind", "seed", "way", "error", "sensitivity", "told"]]
    for one in cases[:SHOWN]:
        words = one.told if len(one.told) < 60 else one.told[:57] + "..."
        rows.append([one.kind, one.seed, one.way, f"{one.error:.1e}", f"{one.growth:.0e}", words])
    more = f", the first {SHOWN} of {len(cases)}" if len(cases) > SHOWN else ""
    return record.Section(f"Scenes that are {verdict}{more}:", rows)


def origins(commits: Sequence[str], found: Sequence[Outcome]) -> record.Section:
    """How many scenes there are, and how many outcomes are of which commit."""
    scenes = len({(one.kind, one.seed) for one in found})
    kinds, first = len({one.kind for one in found}), min((one.seed for one in found), default=0)
    text = (
        f"{scenes} scenes of {kinds} of {len(KINDS)} kinds, seeds from {first} on; where kinds have"
        "\nunequal numbers the campaign was ended before all were done. Outcomes by the commit of"
        "\nthe library that they were found with:"
    )
    return record.Section(text, [["commit", "outcomes"], *Counter(commits).items()])


def measure(
    kinds: Sequence[str] = tuple(KINDS),
    scenes: int = SCENES,
    first: int = 0,
    ways: Sequence[str] = tuple(WAYS),
    kept: Path | None = None,
) -> Iterator[record.Section]:
    """Tables of counts for all ways, and the scenes that are silently wrong or wrongly told of."""
    at = record.commit()
    found = [(commit, one) for commit, one in read(kept) if one.kind in kinds]
    done = {(one.kind, one.seed, one.way) for _, one in found}
    try:
        for name in tqdm(kinds, "kinds", disable=None):
            for one in outcomes(name, range(first, first + scenes), ways=ways, done=done):
                write(kept, at, one)
                found.append((at, one))
    finally:
        # What has been counted is kept if it is interrupted.
        commits, every = [commit for commit, _ in found], [one for _, one in found]
        yield origins(commits, every)
        for way in WAYS:
            yield counted(every, way)
        for verdict in ("silent", "false"):
            yield listed(every, verdict)


CHOICES = {
    "kinds": {"nargs": "+", "choices": tuple(KINDS), "default": tuple(KINDS), "metavar": "KIND"},
    "scenes": {"type": int, "default": SCENES, "help": "of each kind (%(default)s)"},
    "first": {"type": int, "default": 0, "help": "the first seed (%(default)s)"},
    "ways": {"nargs": "+", "choices": tuple(WAYS), "default": tuple(WAYS), "metavar": "WAY"},
    "kept": {"type": Path, "metavar": "FILE", "help": "add outcomes to it, and go on from there"},
}

if __name__ == "__main__":
    record.main(measure, choices=CHOICES)
