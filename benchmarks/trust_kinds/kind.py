"""What a kind of scenes is, and which of its motions are right."""

import functools
import warnings
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

import romjax as rj

OUTPUTS = 101
LANES = 32  # of a chunk of a sweep
ALLOWED = 100.0  # tolerances of the motion's size
RTOL = 1e-6  # of `simulate` with nothing set
NUDGE = 1e-9  # of the motion, by which a start is moved
SENSITIVE = 1e3  # times so much apart at the end
# That a beam has none is said of the scene, and not of its motion: the truth has none either.
OF_THE_SCENE = "stiffening"

Numbers = dict[str, Any]
EVERY = ("alone", "jit", "sweep")


class Kind(NamedTuple):
    """Scenes of one structure, whose numbers are drawn.

    - `draw`: the numbers of a scene, arrays of the same shapes for all scenes.
    - `move`: what romjax makes of them with nothing set, (k, c) in one unit, and the run, or None
      where nothing is simulated. Settings are those that a batch needs.
    - `truth`: the same values by other means, of a start that is moved by a share of the motion.
    - `ways`: those in which `move` can be called.
    """

    draw: Callable[[np.random.Generator], Numbers]
    move: Callable[..., tuple[Any, rj.Trajectory | None]]
    truth: Callable[[Numbers, float], np.ndarray]
    ways: tuple[str, ...] = EVERY


class Outcome(NamedTuple):
    """What came of one scene in one way: its error in sizes of the motion, how much its motion
    magnifies a change of the start, and what romjax told of it, empty if nothing.
    """

    kind: str
    seed: int
    way: str
    error: float
    growth: float
    told: str

    @property
    def verdict(self) -> str:
        """In a word. A sensitive motion counts apart where it is wrong or told."""
        right = self.error <= ALLOWED * RTOL
        if right and not self.told:
            return "right"
        if self.growth > SENSITIVE:
            return "apart"
        return "false" if right else "told" if self.told else "silent"


def numbers_of(name: str, kind: Kind, seed: int) -> Numbers:
    """The numbers of one scene."""
    return kind.draw(np.random.default_rng([zlib.crc32(name.encode()), seed]))


def times(end: Any) -> Any:
    """The output times of a run."""
    return end * np.linspace(0.0, 1.0, OUTPUTS)


def places(system: rj.AbstractSystem, run: rj.Trajectory) -> Any:
    """The positions of all bodies [m], (k, c)."""
    return run.q[:, np.ravel(system.structure.positions)]


def moved(scene: Callable[[Numbers], rj.Scene]) -> Callable[..., tuple[Any, rj.Trajectory]]:
    """The places of a scene's bodies over the time from zero to the number "end"."""

    def move(numbers: Numbers, **settings: Any) -> tuple[Any, rj.Trajectory]:
        system = rj.assemble(scene(numbers))
        run = rj.simulate(system, times(numbers["end"]), **settings)
        return places(system, run), run

    return move


Found = tuple[np.ndarray | None, str]  # values, none where it is refused, and what was told


def alone(kind: Kind, numbers: Numbers) -> Found:
    """What comes of one scene by itself."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            values, run = kind.move(numbers)
        except Exception as refusal:
            return None, f"{type(refusal).__name__}: {refusal}"
        told = [str(one.message) for one in caught]
        if run is not None:
            told += [one for one in run.each_warning() if OF_THE_SCENE not in one]
            told += [] if run.is_valid else [f"flags {rj.Flag(int(run.flags))!r}"]
        return np.asarray(values), "; ".join(told)


@functools.cache
def _lane(kind: Kind) -> Callable[[Numbers], dict[str, Any]]:
    """Values, status and flags of one scene while JAX traces; what is doubtful keeps its values."""

    def lane(numbers: Numbers) -> dict[str, Any]:
        values, run = kind.move(numbers, throw=False)
        return {"values": values, "status": run.status, "flags": run.flags}

    return lane


@functools.cache
def _program(kind: Kind) -> Callable[[Numbers], dict[str, Any]]:
    return jax.jit(_lane(kind))


def _words(status: Any, flags: Any) -> str:
    """What status and flags tell."""
    ended, against = rj.Status(int(status)), rj.Flag(int(flags))
    words = [] if ended is rj.Status.SUCCESS else [ended.name]
    return "; ".join(words + ([f"flags {against!r}"] if against else []))


def compiled(kind: Kind, every: list[Numbers]) -> list[Found]:
    """What comes of many scenes, one after the other under `jit`."""
    lanes = [jax.device_get(_program(kind)(numbers)) for numbers in every]
    return [(one["values"], _words(one["status"], one["flags"])) for one in lanes]


def swept(kind: Kind, every: list[Numbers]) -> list[Found]:
    """What comes of many scenes in one sweep."""
    lanes = jax.tree.map(lambda *x: np.stack(x), *every)
    found = rj.sweep(_lane(kind), lanes, chunk=min(len(every), LANES))
    told = map(_words, found.status, found.flags)
    return list(zip(found.values["values"], told, strict=True))


def judged(name: str, seed: int, way: str, found: Found, truth: Callable[..., Any]) -> Outcome:
    """The outcome of a scene; a motion that nobody saw is wrong. `truth` is of the nudge alone."""
    values, told = found
    exact = truth(0.0)
    size = extent(exact)
    whole = values is not None and np.isfinite(values).all()
    error = float(np.max(np.abs(values - exact)) / size) if whole else np.inf
    growth = 0.0
    if told or not error <= ALLOWED * RTOL:
        growth = float(np.max(np.abs(truth(NUDGE) - exact)) / size / NUDGE)
    return Outcome(name, seed, way, error, growth, told)


def extent(values: np.ndarray) -> float:
    """How far a motion gets from its start; the size of values that are one row."""
    moves = values - values[0] if len(values) > 1 else values
    return float(np.max(np.abs(moves)))
