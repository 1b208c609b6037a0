"""The start of a system, computed by C: XLA takes several times as long to compile it."""

import ctypes
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..integrate.amplitudes import amplitude_shares
from ..integrate.default import default_stabilization
from ..system.base import AbstractSystem
from ..system.frequencies import Frequencies, frequencies
from .emit import emit
from .library import FLAGS, load

# Called once for each start, so that what the compiler saves is more than what it costs.
_FLAGS = (*FLAGS, "-O0")


class InitialEstimates(NamedTuple):
    """The frequencies at a start, Baumgarte's α and β with step size control and with fixed steps,
    none where nothing is constrained, and the shares of tolerances.
    """

    frequencies: Frequencies
    controlled: np.ndarray
    fixed: np.ndarray
    shares: np.ndarray


class Beginning:
    """The start of runs of a system, from any state."""

    def __init__(self, system: AbstractSystem) -> None:
        self.system = system
        self._call: Any = None

    def at(self, ts: np.ndarray, x: np.ndarray, dt: float | None = None) -> InitialEstimates:
        """All of it for runs at the times `ts` from the state x = (q, v)."""
        if self._call is None:
            self._call, self._shapes = self._made()
        results = {key: np.zeros(shape) for key, shape in self._shapes.items()}
        x = np.ascontiguousarray(x, float)
        step = 1.0 if dt is None else dt
        self._call(ts[0], ts[-1], step, x.ctypes.data, *(y.ctypes.data for y in results.values()))
        estimates = Frequencies(*results["frequencies"])
        controlled, fixed = (results.get(key, np.zeros(0)) for key in ("controlled", "fixed"))
        shares = results.get("shares", np.ones(self.system.n))
        return InitialEstimates(estimates, controlled, fixed, shares)

    def _made(self) -> tuple[Any, Mapping[str, tuple[int, ...]]]:
        """The function of C, and the shapes of its results."""
        arguments = {"t0": (), "t1": (), "dt": (), "x": (2 * self.system.n,)}
        # Loops stay loops: the power iteration is one around the accelerations.
        made = emit(self._all, "model_beginning", arguments, unrolled=0)
        call = load(f"#include <math.h>\n{made.source}", _FLAGS).model_beginning
        number, pointer = ctypes.c_double, ctypes.c_void_p
        call.argtypes = [number, number, number, pointer, *(len(made.results) * [pointer])]
        call.restype = None
        return call, made.results

    def _all(self, t0: Array, t1: Array, dt: Array, x: Array) -> Mapping[str, Array]:
        system, times = self.system, jnp.stack([t0, t1])
        estimates = frequencies(system, t0, x[: system.n], x[system.n :])
        results = {"frequencies": jnp.stack(estimates[:-1])}
        for name, step in (("controlled", None), ("fixed", dt)):
            terms = default_stabilization(system, times, step, estimates)
            if terms is not None:
                results[name] = jnp.stack([terms.alpha, terms.beta])
        shares = amplitude_shares(system, system.q0)
        return results if shares is None else results | {"shares": shares}
