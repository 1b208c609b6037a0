"""Runs in C within programs of JAX."""

import ctypes
import hashlib
import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from ..common import compat
from ..common.errors import InputError
from ..common.outside import outside_of_traces
from .native import NativeRuns

# Programs with functions of this name are not kept on disk: another process does not have them.
_NAME = "romjax_native"
_FORWARD = (
    "compile: runs of compiled models have derivatives in forward mode alone; use jax.jvp or "
    "jax.jacfwd, or romjax.simulate, which has reverse mode too."
)


class Rows(NamedTuple):
    """The result of a run: rows at the output times, and numbers as `model_run` returns them."""

    q: Array
    v: Array
    x: Array
    violation: Array
    told: Any


class Inside:
    """The runs of a model by one method as a function of arrays, batchable by threads, with
    derivatives in forward mode by the start and the parameters.
    """

    def __init__(self, native: NativeRuns, stiff: bool) -> None:
        self.native, self.stiff = native, stiff
        self._targets: dict[bool, str] = {}
        self.run = jax.custom_jvp(self._run)
        self.run.defjvp(self._along, symbolic_zeros=True)

    def _run(self, x0: Array, given: Array, ts: Array, numbers: Array, counts: Array) -> Rows:
        shapes = self._shapes(ts)
        told = jax.ShapeDtypeStruct((4,), jnp.int64)
        call = jax.ffi.ffi_call(self._target(False), (*shapes, told), vmap_method="expand_dims")
        return Rows(*call(x0, given, ts, numbers, counts))

    def _shapes(self, ts: Array) -> list[jax.ShapeDtypeStruct]:
        system, k = self.native.model.nominal, ts.shape[-1]
        widths = ((system.full.n,), (system.full.n,), (2 * system.n,), ())
        return [jax.ShapeDtypeStruct((k, *width), jnp.float64) for width in widths]

    def _along(self, primals: Sequence[Array], tangents: Sequence[Any]) -> tuple[Rows, Rows]:
        if not all(isinstance(x, SymbolicZero) for x in tangents[2:4]):
            raise InputError(
                "compile: runs of compiled models have derivatives by the start and the "
                "parameters, and not by output times and tolerances; leave these to "
                "romjax.simulate."
            )
        dx0, dgiven = (
            jnp.zeros_like(x) if isinstance(dx, SymbolicZero) else dx
            for x, dx in zip(primals[:2], tangents[:2], strict=True)
        )
        dx0, dp = compat.forward_only(_FORWARD, dx0, dgiven[2:])
        *rows, dq, dv, dx = self._with_derivatives(0)(*primals, dx0, dp)
        # What is judged by a whole run has no derivative.
        none = np.zeros(rows[-1].shape, jax.dtypes.float0)
        return Rows(*rows), Rows(dq, dv, dx, jnp.zeros_like(rows[3]), none)

    def _with_derivatives(self, axes: int) -> Any:
        """A run and its derivative, with axes of a batch before those of every array: each as long
        as the batch, or one.

        Along axes that only the directions have, there is one run, whose rows have one entry there.
        """

        def call(*args: Array) -> Any:
            ts, lead = args[2], [x.shape[:axes] for x in args]
            own, all_ = (np.broadcast_shapes(*lead[:end]) for end in (-2, None))
            rows, told = self._shapes(ts), jax.ShapeDtypeStruct((4,), jnp.int64)
            shapes = [*((own, x) for x in (*rows, told)), *((all_, x) for x in rows[:3])]
            results = [jax.ShapeDtypeStruct((*lead, *x.shape), x.dtype) for lead, x in shapes]
            return jax.ffi.ffi_call(self._target(True), results)(*args)

        def batched(size: int, has: list[bool], *args: Array) -> Any:
            del size
            each = [x if own else x[None] for own, x in zip(has, args, strict=True)]
            results = self._with_derivatives(axes + 1)(*each)
            if any(has[:-2]):
                return results, [True] * len(results)
            several = [False] * (len(results) - 3) + [True] * 3
            return [x if y else x[0] for x, y in zip(results, several, strict=True)], several

        function = jax.custom_batching.custom_vmap(call)
        function.def_vmap(batched)
        return function

    def _target(self, along: bool) -> str:
        """The name by which XLA knows the function, which it is told once."""
        if along not in self._targets:
            library = outside_of_traces(lambda: self.native.library(self.stiff, along))
            handler = library.model_handler
            address = ctypes.cast(handler, ctypes.c_void_p).value
            name = f"{_NAME}_{hashlib.sha256(str(address).encode()).hexdigest()[:16]}"
            capsule: Any = jax.ffi.pycapsule(handler)
            jax.ffi.register_ffi_target(name, capsule, platform="cpu")
            self._targets[along] = name
        return self._targets[along]


def threads() -> int:
    """How many threads lanes are given to: the processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
