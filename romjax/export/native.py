"""Runs in C as functions of Python."""

import ctypes
import itertools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..compiling.program import program_once
from ..integrate.judge import drift_of
from ..system.base import AbstractSystem, Run
from ..system.schedule import Schedule
from .library import load
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


class Told(NamedTuple):
    """What a run tells: numbers of steps, its status and flags, and rows at the output times."""

    steps: int
    accepted: int
    status: int
    flags: int
    q: np.ndarray
    v: np.ndarray
    x: np.ndarray
    violation: np.ndarray


class NativeRuns:
    """The runs of a system without names, by libraries that are made when they are asked for.

    `operations`: of the functions that are in them.
    """

    def __init__(self, system: AbstractSystem) -> None:
        self.system, self.operations = system, dict[str, int]()
        self._libraries = dict[bool, Any]()
        corners = np.asarray(Schedule.of(system).corners(system.q0[:0]), float)
        self._corners = np.ascontiguousarray(corners[np.isfinite(corners)])
        unlimited = system.validity is None and system.full.validity is None
        self._judged = unlimited or judges_states(system)

    def run(self, ts: np.ndarray, x0: np.ndarray, asked: Asked) -> Told:
        """A run from x0 = (q, v) at the times `ts`."""
        k, n, full = len(ts), self.system.n, self.system.full.n
        dt = 0.0 if asked.dt is None else asked.dt
        settings = np.array([asked.rtol, asked.atol, dt, *asked.terms], float)
        most = _UNLIMITED if asked.max_steps is None else asked.max_steps
        corners = self._corners if asked.dt is None else self._corners[:0]
        counts = np.array([asked.stiff, asked.follow, most, len(corners)], ctypes.c_int64)
        # Room for all in one piece, since asking an array for its place takes a microsecond.
        widths = (full, full, 2 * n, 1)
        ends = list(itertools.accumulate(widths, initial=0))
        room, told = np.empty(k * ends[-1]), np.zeros(4, ctypes.c_int64)
        begin = room.ctypes.data
        places = [begin + 8 * k * end for end in ends[:-1]]
        given = settings.ctypes.data, counts.ctypes.data, corners.ctypes.data
        run = self._library(asked.stiff)
        run(x0.ctypes.data, ts.ctypes.data, k, *given, *places, told.ctypes.data)
        parts = [room[k * a : k * b] for a, b in itertools.pairwise(ends)]
        q, v, x, violation = (y.reshape(k, w) for y, w in zip(parts, widths, strict=True))
        steps, accepted, status, flags = told.tolist()
        if not self._judged:
            drift = np.asarray(0.0 if asked.dt is not None else asked.rtol)
            flags |= int(_flags(self.system, ts, q, v, x, violation[:, 0], drift))
        return Told(steps, accepted, status, flags, q, v, x, violation[:, 0])

    def _library(self, stiff: bool) -> Any:
        """The run in C, with the method for stiff systems or without."""
        if stiff not in self._libraries:
            functions = functions_of(self.system, stiff)
            self.operations |= {f.name: f.operations for f in functions}
            run = load(source_of(self.system, functions, stiff)).model_run
            pointer = ctypes.c_void_p
            run.argtypes, run.restype = [pointer, pointer, ctypes.c_int64, *(8 * [pointer])], None
            self._libraries[stiff] = run
        return self._libraries[stiff]


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
