"""What a problem is, how many digits of it are met, and the means that problems share."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import diffrax
import numpy as np
import scipy.integrate

import romjax as rj

DIGITS = 16.0  # of double precision, which no count exceeds
G = 9.81
# Tighter than any right value asks for.
RTOL = 1e-12


class Problem(NamedTuple):
    """A question with a right answer.

    - `statement`: what is asked, in two lines of text.
    - `source`: author, year and DOI, or where the closed form is from.
    - `right`: the values, by name.
    - `ways`: the two independent ways that gave them, in words; `again` are the values by the
      second one, where it is a program or printed.
    - `found`: the values by romjax, in the same order.
    - `scale`: what errors are relative to, each value itself unless given.
    - `scene`: what is drawn, or None.
    """

    name: str
    statement: str
    source: str
    right: Callable[[], Mapping[str, float]]
    ways: tuple[str, str]
    found: Callable[[], Sequence[float]]
    again: Callable[[], Sequence[float]] | None = None
    scale: float | None = None
    scene: Callable[[], rj.Scene] | None = None


def digits(found: Any, right: Any, scale: float | None = None) -> float:
    """−log₁₀ of the largest error, relative to `scale` or to each right value."""
    found, right = np.asarray(found, float), np.asarray(right, float)
    if found.shape != right.shape or not np.all(np.isfinite(found)):
        return 0.0
    error = np.max(np.abs(found - right) / (np.abs(right) if scale is None else scale))
    return min(DIGITS, max(0.0, -math.log10(error))) if error > 0 else DIGITS


def run(system: rj.AbstractSystem, *ts: float, **settings: Any) -> rj.Trajectory:
    """A motion at a tight tolerance, with constraints that are damped critically."""
    keep = rj.Baumgarte(alpha=12.0, beta=36.0) if system.m else None
    given = {"rtol": RTOL, "solver": diffrax.Dopri8(), "stabilization": keep, "audit": False}
    return rj.simulate(system, np.array(ts), **{**given, **settings})


def integrated(slope: Callable, start: Sequence[float], *ts: float) -> np.ndarray:
    """The states at times, the first of which is that of the start, by SciPy's DOP853."""
    span = (ts[0], ts[-1])
    settings = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
    made = scipy.integrate.solve_ivp(slope, span, np.asarray(start, float), t_eval=ts, **settings)
    return made.y.T


def named(names: str, values: Any) -> dict[str, float]:
    """Values by names that are separated by commas."""
    keys = [name.strip() for name in names.split(",")]
    return dict(zip(keys, map(float, np.ravel(values)), strict=True))


def clamp(body: Any, at: Any) -> rj.Weld:
    """The start of a body, held at a point of the ground."""
    return rj.Weld(body.at("start"), rj.ground.at(at))
