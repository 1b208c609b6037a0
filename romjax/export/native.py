"""Runs in C as functions of Python."""

import ctypes
import itertools
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

    def arrays(self, own: int) -> tuple[np.ndarray, np.ndarray]:
        """The numbers as C takes them; `own`: 1 for positions, 2 for velocities at the start that
        are those of the parameters, or both.
        """
        numbers = np.array([self.rtol, self.atol, 0.0 if self.dt is None else self.dt], float)
        most = _UNLIMITED if self.max_steps is None else self.max_steps
        return numbers, np.array([self.stiff, self.follow, most, own], np.int64)


class Told(NamedTuple):
    """What a run tells: numbers of steps, its status and flags, and rows at the output times."""

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
        self.given = np.array([*model.parameters.values()], float)

    def run(self, ts: np.ndarray, x0: np.ndarray | None, asked: Asked) -> Told:
        """A run of the nominal system at the times `ts`, from x0 = (q, v) or its own start."""
        system = self.model.nominal
        k, n, full = len(ts), system.n, system.full.n
        numbers, counts = asked.arrays(3 if x0 is None else 0)
        settings = np.concatenate([numbers, asked.terms, self.given])
        # Room for all in one piece, since asking an array for its place takes a microsecond.
        widths = (full, full, 2 * n, 1)
        ends = list(itertools.accumulate(widths, initial=0))
        room, told = np.empty(k * ends[-1]), np.zeros(4, ctypes.c_int64)
        begin, begin_settings = room.ctypes.data, settings.ctypes.data
        places = [begin + 8 * k * end for end in ends[:-1]]
        start = 0 if x0 is None else x0.ctypes.data
        run = self.library(asked.stiff, False).model_run
        head = start, begin_settings + 24, ts.ctypes.data, k, begin_settings, counts.ctypes.data
        run(*head, *places, told.ctypes.data, None)
        parts = [room[k * a : k * b] for a, b in itertools.pairwise(ends)]
        q, v, x, violation = (y.reshape(k, w) for y, w in zip(parts, widths, strict=True))
        told[3] |= int(self.judged(system, ts, q, v, x, violation[:, 0], asked))
        # A view of each, which costs less than an array of its own.
        steps, accepted, status, flags = (told[i : i + 1].reshape(()) for i in range(4))
        return Told(steps, accepted, status, flags, q, v, x, violation[:, 0])

    def judged(
        self, system: AbstractSystem, ts: Any, q: Any, v: Any, x: Any, violation: Any, asked: Asked
    ) -> Any:
        """What of the region of validity of a system C has not judged."""
        if self._judged:
            return 0
        drift = np.asarray(0.0 if asked.dt is not None else asked.rtol)
        return _flags(system, ts, q, v, x, violation, drift)

    def library(self, stiff: bool, along: bool) -> ctypes.CDLL:
        """The library with the method for stiff systems or without, and with derivatives."""
        if (stiff, along) not in self._libraries:
            functions = functions_of(self.model, stiff, along)
            self.operations |= {f.name: f.operations for f in functions}
            flags = (*FLAGS, "-pthread", f"-I{jax.ffi.include_dir()}")
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
    """What the region of validity of a system says of a whole motion."""
    flags, drift, full = jnp.zeros((), int), drift_of(q, rtol), system.full
    if full.validity is not None:
        flags |= full.validity.flags(full, Run(jnp.asarray(ts), q, v, q, violation, drift))
    if system is not full and system.validity is not None:
        own = x[:, : system.n], x[:, system.n :]
        flags |= system.validity.flags(system, Run(jnp.asarray(ts), *own, q, violation, drift))
    return flags
