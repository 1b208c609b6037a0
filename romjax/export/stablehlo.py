"""Runs of a system as programs of XLA, for other processes and other tools."""

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import diffrax
import jax
import jax.export
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..common import writing
from ..common.arrays import Vector, as_jax, as_number
from ..common.extras import extra
from ..compiling.xla import tracing_with_options
from ..integrate.default import default_method, default_stabilization, start_frequencies
from ..integrate.settings import check_numbers, check_times
from ..integrate.simulate import simulate
from ..system.base import AbstractSystem
from ..system.stabilization import Stabilization
from ..system.structure import without_names
from .leaving import model_of

_VERB = "export.stablehlo"


class ExportedRun(NamedTuple):
    """An exported run: the file at `path`, and what is fixed in it, the method and the
    stabilization.
    """

    path: Path
    solver: diffrax.AbstractSolver[Any]
    stabilization: Stabilization


def stablehlo(
    system: AbstractSystem | Callable[..., AbstractSystem],
    path: str | os.PathLike[str],
    ts: Vector,
    *,
    parameters: Mapping[str, float] | None = None,
    solver: diffrax.AbstractSolver[Any] | None = None,
    rtol: float = 1e-6,
    atol: float | None = None,
    dt: float | None = None,
    stabilization: Stabilization | str = "default",
    max_steps: int | None = 100_000,
    platforms: Sequence[str] = ("cpu",),
) -> ExportedRun:
    """Write the run of a system as a program of XLA, whose source is not needed any more.

    The program takes q0 and v0 (n,), and of a system with parameters a mapping of their numbers by
    name; it returns a mapping: `q`, `v` (k, n) of physical coordinates, `violation` (k,), `status`
    and `flags`, as a `Trajectory` has them. Method, tolerances and stabilization are chosen and
    fixed when it is written, so that it does what `simulate` does with them.

    **Arguments:**

    - `system`: full or reduced, with the numbers that it has; or a function of the `parameters` by
      name that makes one, always of the same structure.
    - `path`: the file. With the ending ".mlir" it is StableHLO as text, for compilers other than
      JAX; else what `jax.export.deserialize` reads, which needs the package flatbuffers (extra
      `stablehlo`). JAX reads it for half a year at least, whatever its version.
    - `ts` (k,): the output times [s].

    **Keyword arguments:**

    - `parameters`: those of `system`, if it is a function, with the numbers by which the method is
      chosen.
    - `solver`, `rtol`, `atol`, `dt`, `stabilization`, `max_steps`: as `simulate` has them.
    - `platforms`: what the program runs on, of "cpu", "cuda", "rocm" and "tpu".

    ```python
    run = jax.export.deserialize(bytearray(open("cart.run", "rb").read()))
    run.call(system.q0, system.v0)["q"]
    ```

    Raises InputError for a wrong argument; ImportError without flatbuffers; OSError where nothing
    can be written.
    """
    target = Path(path)
    if target.suffix != ".mlir":
        extra(_VERB, "flatbuffers", "stablehlo", "a path that ends in .mlir needs none")
    model = model_of(_VERB, system, {}, None, parameters or {}, None, "run")
    check_numbers(max_steps, 0, rtol=rtol, atol=atol, dt=dt)
    nominal = model.nominal
    times = check_times(_VERB, ts, nominal.q0.dtype)
    solver, held = _chosen(nominal, times, dt, solver, stabilization)
    names = tuple(model.parameters)

    def run(q0: Array, v0: Array, *numbers: Mapping[str, Array]) -> dict[str, Array]:
        p = jnp.stack([numbers[0][name] for name in names]) if names else jnp.zeros(0)
        steps: Any = {"rtol": rtol, "atol": atol, "dt": dt, "max_steps": max_steps}
        choice: Any = {"solver": solver, "stabilization": held, "throw": False, "audit": False}
        trajectory = simulate(model.system(p), times, q0=q0, v0=v0, **steps, **choice)
        fields = ("q", "v", "violation", "status", "flags")
        return {field: jnp.asarray(getattr(trajectory, field)) for field in fields}

    number = jax.ShapeDtypeStruct((), nominal.q0.dtype)
    given = [nominal.q0, nominal.v0] + ([dict.fromkeys(names, number)] if names else [])
    with tracing_with_options():
        exported = jax.export.export(jax.jit(run), platforms=tuple(platforms))(*given)
    text = target.suffix == ".mlir"
    writing.write(target, exported.mlir_module() if text else bytes(exported.serialize()))
    return ExportedRun(target, solver, held)


def _chosen(
    system: AbstractSystem,
    ts: Array | np.ndarray,
    dt: float | None,
    solver: diffrax.AbstractSolver[Any] | None,
    stabilization: Any,
) -> tuple[diffrax.AbstractSolver[Any], Stabilization]:
    """The method and the stabilization, by the numbers that the system has."""
    bare = without_names(system)
    frequencies = start_frequencies(bare, ts, system.q0, system.v0)
    step = None if dt is None else as_number(dt, system.q0.dtype)
    times = as_jax(ts)
    method = solver or default_method(system, times, step, frequencies).solver
    if stabilization == "default":
        stabilization = default_stabilization(bare, times, step, frequencies)
    return method, stabilization
