"""How far romjax can be trusted with nothing set: random scenes, each against a truth of its own.

A motion is right where it is within 100 tolerances of its own size (rtol = 1e-6) of the truth;
told, where it is not, and romjax says so by a flag, a warning or a refusal; silent, where it is not
and nothing was said; false, where it is right, and something was said. Sensitive motions, of which
a start that is moved by 1e-9 of the motion ends 1e-6 of it apart, are counted apart where they are
wrong or told of. Each scene runs alone and in a sweep (`jit` of `vmap`), of which the flags count,
and those of some kinds under `jit` as well. Kinds and their truths are in `trust_kinds`; a scene is
its kind and its seed, from zero on. Writes `trust.txt` beside this file.
"""

import functools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import record
from tqdm import tqdm
from trust_kinds import (
    bent,
    contacts,
    driven,
    events,
    flexible,
    joints,
    loads,
    planar,
    reduced,
    rods,
    rolling,
    scales,
    sizes,
    spatial,
    states,
    top,
)
from trust_kinds.kind import LANES, Kind, Outcome, alone, compiled, judged, numbers_of, swept

SCENES = 56  # of each kind
WAYS = {
    "alone": "each by itself",
    "jit": "each under `jit`",
    "sweep": f"in sweeps of {LANES} lanes at a time",
}
VERDICTS = ("right", "told", "false", "apart", "silent")
SHOWN = 60  # cases that are listed
FAMILIES = (
    *(planar, driven, flexible, spatial, top, bent, loads, events, contacts, scales, reduced),
    *(sizes, rods, states, rolling, joints),
)
KINDS: dict[str, Kind] = {name: kind for family in FAMILIES for name, kind in family.KINDS.items()}


def outcomes(name: str, seeds: Sequence[int], kinds: Mapping[str, Kind] = KINDS) -> list[Outcome]:
    """What comes of the scenes of one kind, in each way."""
    kind = kinds[name]
    every = [numbers_of(name, kind, seed) for seed in seeds]
    # No bar where nobody looks.
    bar = tqdm(every, name, leave=False, disable=None)
    others = {"jit": compiled, "sweep": swept}
    ways = [others[way](kind, every) for way in kind.ways[1:]]
    found = []
    for seed, numbers, *each in zip(seeds, bar, *ways, strict=True):
        truth = functools.cache(functools.partial(kind.truth, numbers))
        for way, one in zip(kind.ways, (alone(kind, numbers), *each), strict=True):
            found.append(judged(name, seed, way, one, truth))
    return found


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
    ratios = {
        f"{way}: scenes not silently wrong / all": 1 - silent / max(len(here), 1),
        f"{way}: right without alarm / right": total["right"] / max(right, 1),
    }
    return record.Section(f"Scenes with nothing set, {WAYS[way]}:", rows, ratios)


def listed(found: Sequence[Outcome], verdict: str) -> record.Section:
    """The scenes of one verdict, of the largest errors first."""
    cases = sorted((one for one in found if one.verdict == verdict), key=lambda one: -one.error)
    rows = [["kind", "seed", "way", "error", "sensitivity", "told"]]
    for one in cases[:SHOWN]:
        words = one.told if len(one.told) < 60 else one.told[:57] + "..."
        rows.append([one.kind, one.seed, one.way, f"{one.error:.1e}", f"{one.growth:.0e}", words])
    more = f", the first {SHOWN} of {len(cases)}" if len(cases) > SHOWN else ""
    return record.Section(f"Scenes that are {verdict}{more}:", rows)


def measure(
    kinds: Sequence[str] = tuple(KINDS), scenes: int = SCENES, first: int = 0
) -> Iterator[record.Section]:
    """Tables of counts for all ways, and the scenes that are silently wrong or wrongly told of."""
    found: list[Outcome] = []
    try:
        for name in tqdm(kinds, "kinds", disable=None):
            found += outcomes(name, range(first, first + scenes))
    finally:
        # What has been counted is kept if it is interrupted.
        for way in WAYS:
            yield counted(found, way)
        for verdict in ("silent", "false"):
            yield listed(found, verdict)


CHOICES = {
    "kinds": {"nargs": "+", "choices": tuple(KINDS), "default": tuple(KINDS), "metavar": "KIND"},
    "scenes": {"type": int, "default": SCENES, "help": "of each kind (%(default)s)"},
    "first": {"type": int, "default": 0, "help": "the first seed (%(default)s)"},
}

if __name__ == "__main__":
    record.main(measure, choices=CHOICES)
