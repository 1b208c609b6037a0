"""Runs in C as functions of Python."""

import ctypes
import itertools
import platform
from importlib.metadata import version
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..compiling.program import program_once
from ..integrate.judge import drift_of
from ..system.base import AbstractSystem, Run
from ..system.structure import without_names
from .beginning import Beginning
from .leaving import TIMES, Model
from .library import FLAGS, load
from .loops import functions_of, judges_states, source_of

# A library for this machine alone may use all that its processor can, which the key of the cache
# has. Longer vectors save a quarter of the time of 8 bars.
_OWN = ("-march=native",) if (platform.system(), platform.machine()) == ("Linux", "x86_64") else ()
# Steps where there is no limit: more than any run takes.
_UNLIMITED = 2**62


class Asked(NamedTuple):
    """The settings of a run: its tolerances, which may `follow` the motion, or a fixed step `dt`.

    `terms`: Baumgarte's α and β. `stiff`: by Rodas5P, and not by Dopri8.
    """

    rtol: float
    atol: float
    dt: float | None
    max_steps: int | None
    follow: bool
    terms: tuple[float, float]
    stiff: bool

    def numbers(self, own: int) -> tuple[list[float], list[int]]:
        """The numbers as C takes them; `own`: 1 for positions, 2 for velocities at the start that
        are those of the parameters, or both.
        """
        most = _UNLIMITED if self.max_steps is None else int(self.max_steps)
        counts = [int(self.stiff), int(self.follow), most, own]
        return [float(self.rtol), float(self.atol), float(self.dt or 0.0)], counts


class Told(NamedTuple):
    """The result of a run: numbers of steps, its status and flags, and rows at the output times."""

    steps: Any
    accepted: Any
    status: Any
    flags: Any
    q: Any
    v: Any
    x: Any
    violation: Any


class NativeRuns:
    """The runs of a model, by libraries that are made when they are asked for.

    `operations`: of the functions that are in them.
    """

    def __init__(self, model: Model) -> None:
        self.model, self.operations = model, dict[str, int]()
        self._libraries = dict[tuple[bool, bool], ctypes.CDLL]()
        system = model.nominal
        self.beginning = Beginning(without_names(system))
        unlimited = system.validity is None and system.full.validity is None
        self._judged = unlimited or judges_states(system)
        self.given = [float(x) for x in model.parameters.values()]
        full = system.full.n
        self._widths = full, full, 2 * system.n, 1

    def run(self, ts: np.ndarray, x0: np.ndarray | None, asked: Asked) -> Told:
        """A run of the nominal system at the times `ts`, from x0 = (q, v) or its own start."""
        system = self.model.nominal
        k, widths = len(ts), self._widths
        numbers, counts = asked.numbers(3 if x0 is None else 0)
        given = [*numbers, *asked.terms, *self.given]
        # All in two arrays, since asking one for its place takes two microseconds.
        ends = list(itertools.accumulate((k * width for width in widths), initial=len(given)))
        room, told = np.empty(ends[-1]), np.array([*counts, 0, 0, 0, 0], np.int64)
        room[: len(given)] = given
        begin, begin_counts = room.ctypes.data, told.ctypes.data
        start = 0 if x0 is None else x0.ctypes.data
        run = self.library(asked.stiff, False).model_run
        head = start, begin + 24, ts.ctypes.data, k, begin, begin_counts
        # Addresses count bytes, eight for each number.
        run(*head, *(begin + 8 * end for end in ends[:-1]), begin_counts + 8 * len(counts), None)
        q, v, x = (room[ends[i] : ends[i + 1]].reshape(k, widths[i]) for i in range(3))
        violation = room[ends[3] :]
        if not self._judged:
            told[-1] |= int(self.judged(system, ts, q, v, x, violation, asked))
        # A view of each, which costs less than an array of its own.
        steps, accepted, status, flags = (told[i, ...] for i in range(-4, 0))
        return Told(steps, accepted, status, flags, q, v, x, violation)

    def judged(
        self, system: AbstractSystem, ts: Any, q: Any, v: Any, x: Any, violation: Any, asked: Asked
    ) -> Any:
        """Return the part of the region of validity of a system that C has not judged."""
        if self._judged:
            return 0
        drift = np.asarray(0.0 if asked.dt is not None else asked.rtol)
        return _flags(system, ts, q, v, x, violation, drift)

    def library(self, stiff: bool, along: bool) -> ctypes.CDLL:
        """The library with the method for stiff systems or without, and with derivatives."""
        if (stiff, along) not in self._libraries:
            functions = functions_of(self.model, stiff, along)
            self.operations |= {f.name: f.operations for f in functions}
            flags = (*FLAGS, *_OWN, "-pthread", f"-I{jax.ffi.include_dir()}")
            # The headers of another version of jaxlib make another library.
            head = f"/* jaxlib {version('jaxlib')} */\n"
            nominal = self.model.nominal
            shares = self.beginning.at(TIMES, self.model.start()).shares
            library = load(head + source_of(nominal, functions, shares), flags)
            pointer, count = ctypes.c_void_p, ctypes.c_int64
            kinds: list[Any] = [pointer, pointer, pointer, count, *(8 * [pointer])]
            library.model_run.argtypes, library.model_run.restype = kinds, None
            self._libraries[stiff, along] = library
        return self._libraries[stiff, along]


@program_once
def _flags(
    system: AbstractSystem,
    ts: Float[Array | np.ndarray, " k"],
    q: Any,
    v: Any,
    x: Any,
    violation: Any,
    rtol: Float[Array | np.ndarray, ""],
) -> Int[Array, ""]:
    """Return the flags that the region of validity of a system gives a whole motion."""
    flags, drift, full = jnp.zeros((), int), drift_of(q, rtol), system.full
    if full.validity is not None:
        flags |= full.validity.flags(full, Run(jnp.asarray(ts), q, v, q, violation, drift))
    if system is not full and system.validity is not None:
        own = x[:, : system.n], x[:, system.n :]
        flags |= system.validity.flags(system, Run(jnp.asarray(ts), *own, q, violation, drift))
    return flags
