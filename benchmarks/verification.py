"""Published and closed-form problems: the digits of each that romjax meets, and in what time.

A problem has a right value that two independent ways gave; where the second one is a program or
printed, it is compared with the first here, too. Problems are in `verification_problems`, by
theme. Digits are of the worst value of a problem, relative to it, or to its scale. The first time
is that of a call with all compiling, the second one that of the same call again. Each problem has
a floor of digits. Writes `verification.txt` and `verification.json` beside this file; the page of
the site is made of the latter.
"""

import math
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import record
from tqdm import tqdm
from verification_problems import (
    columns,
    events,
    far,
    plane,
    points,
    reduced,
    rest,
    slopes,
    small,
    space,
    turning,
    whirl,
)
from verification_problems.picture import svg
from verification_problems.problem import Problem, digits

THEMES: Mapping[str, Sequence[Problem]] = {
    "Rigid mechanisms in the plane": (*points.PROBLEMS, *plane.PROBLEMS),
    "Rigid bodies in space": space.PROBLEMS,
    "Equilibria": rest.PROBLEMS,
    "Rods that bend far, and columns": (*far.PROBLEMS, *columns.PROBLEMS),
    "Small motions": small.PROBLEMS,
    "Blades, shafts and beams in space": (*turning.PROBLEMS, *whirl.PROBLEMS),
    "Impacts, passages and contact": events.PROBLEMS,
    "Reduced models and joint coordinates": reduced.PROBLEMS,
    "Derivatives": slopes.PROBLEMS,
}
NAMES = tuple(problem.name for problems in THEMES.values() for problem in problems)


def ratio(name: str) -> str:
    """Of the digits of a problem, by which floors.toml knows it."""
    return f"digits of {name}"


def timed(problem: Problem) -> tuple[np.ndarray, float]:
    start = time.perf_counter()
    found = np.asarray([float(x) for x in problem.found()])
    return found, time.perf_counter() - start


def judged(problem: Problem) -> dict[str, Any]:
    """Values, digits and times of a problem; digits are NaN where romjax ends with an error."""
    right = dict(problem.right())
    wanted = list(right.values())
    again = math.nan if problem.again is None else digits(problem.again(), wanted, problem.scale)
    try:
        found, first = timed(problem)
        _, second = timed(problem)
    except Exception:
        # The other problems count all the same; this one is below its floor.
        traceback.print_exc()
        found, first, second = np.full(len(wanted), math.nan), math.nan, math.nan
    drawn = {} if problem.scene is None else {"picture": svg(problem.scene())}
    met = digits(found, wanted, problem.scale) if np.all(np.isfinite(found)) else math.nan
    return {
        "right": right,
        "found": found.tolist(),
        "digits": met,
        "agree": again,
        "first": first,
        "second": second,
        **drawn,
    }


def short(x: float, form: str) -> str:
    return format(x, form) if math.isfinite(x) else "-"


def measure(only: Sequence[str] = NAMES) -> Iterator[record.Section]:
    """A table of each theme, and the values."""
    values = [["problem", "value", "right", "romjax"]]
    for theme, problems in THEMES.items():
        chosen = [problem for problem in problems if problem.name in only]
        if not chosen:
            continue
        # No bar where nobody looks.
        results = {p.name: judged(p) for p in tqdm(chosen, theme, leave=False, disable=None)}
        rows = [["problem", "digits", "two ways agree to", "first call [s]", "again [s]"]]
        for name, one in results.items():
            times = [short(one[key], ".2g") for key in ("first", "second")]
            rows.append([name, *(short(one[key], ".1f") for key in ("digits", "agree")), *times])
            for (label, right), found in zip(one["right"].items(), one["found"], strict=True):
                values.append([name, label, f"{right:.15g}", f"{found:.15g}"])
        ratios = {ratio(name): one["digits"] for name, one in results.items()}
        yield record.Section(f"{theme}:", rows, ratios, data=results)
    yield record.Section("Values:", values)


CHOICES = {"only": {"nargs": "+", "choices": NAMES, "default": NAMES, "metavar": "PROBLEM"}}

if __name__ == "__main__":
    record.main(measure, choices=CHOICES)
