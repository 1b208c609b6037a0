"""A system as a functional mock-up unit of FMI 3.0."""

import hashlib
import io
import os
import platform
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..analysis.linearization import Input, Output
from ..common import writing
from ..integrate.amplitudes import amplitude_shares
from ..integrate.default import default_method
from ..integrate.rodas5p import Rodas5P
from ..system.base import AbstractSystem
from ..system.schedule import Schedule
from ..system.stabilization import Baumgarte
from . import equations
from .description import Variables, build_description, model_description
from .emit import Emitted, constant_table, emit
from .leaving import TIMES, Model, frequencies_of, model_of
from .library import compiled
from .loops import check_runs, coefficients, internal, text_of

# The standard has these names of platforms.
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}
_ENDS = {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}


class ExportedFMU(NamedTuple):
    """An exported FMU: the file at `path`, and the number of `operations` of each function.

    `states`, `inputs`, `outputs`, `parameters`: names of variables. `platform`: that of the
    binary, as "x86_64-linux"; None where there are sources alone.
    """

    path: Path
    operations: Mapping[str, int]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    platform: str | None


def fmu(
    system: AbstractSystem | Callable[..., AbstractSystem],
    path: str | os.PathLike[str],
    *,
    inputs: Mapping[str, Input] | None = None,
    outputs: Mapping[str, Output] | Sequence[str] | None = None,
    parameters: Mapping[str, float] | None = None,
    stabilization: Baumgarte | str | None = "default",
    name: str = "model",
    binary: bool = True,
) -> ExportedFMU:
    """Write a system as an FMU, by the Functional Mock-up Interface 3.0 (fmi-standard.org).

    One file for both kinds: model exchange, whose steps are the importer's, and co-simulation,
    whose steps between communication points are those of `simulate`, by `diffrax.Dopri8` or
    `Rodas5P`, whichever suits the start, at the importer's tolerance, 1e-6 unless it gives one.
    States q and v have the names of their coordinates, "cart.x" and "cart.x'"; they and
    their derivatives, inputs, parameters and outputs are variables, with units and starts. The
    state can be saved, restored and turned into bytes; derivatives by states, inputs and
    parameters are exact, along directions and their adjoints. Corners of signals are time events.
    Sources and a binary for this machine are inside.

    Parameters are tunable. Before the run a state that the importer has not set follows them,
    as the start of a new scene does; one that violates the constraints is refused. Leaving the
    region of a reduced model is an fmi3Warning, as far as single states tell: that modes above a
    cap vibrate, or that weights belong to other masses, is left to runs of `simulate`. The default
    experiment begins when the start of the system holds.

    **Arguments:**

    - `system`, `inputs`, `outputs`, `parameters`, `stabilization`: as `romjax.export.c` takes them.
    - `path`: the file, whose name should end in ".fmu".

    **Keyword arguments:**

    - `name`: of the model and its binary.
    - `binary`: False for sources alone, which need no C compiler here; importers that build FMUs
      take them so.

    Raises InputError, with the reason, for what C cannot be made of, for contacts, charts and
    loads that do not say when they change, for more than 25 000 operations in a function, for two
    variables of one name, for a wrong argument, and where there is no C compiler; OSError
    where nothing can be written.
    """
    model = model_of(
        "export.fmu", system, inputs or {}, outputs, parameters or {}, stabilization, name
    )
    check_runs(model.nominal)
    variables = Variables.of(model, name)
    own = dict(variables.computed)
    functions = _functions(model._replace(outputs=own))
    told = repr((variables.variables, [f.source for f in functions]))
    token = "{" + hashlib.sha256(told.encode()).hexdigest()[:32] + "}"
    source = _source(model._replace(outputs=own), functions, token)
    target = _platform()
    files: dict[str, str | bytes] = {
        "modelDescription.xml": model_description(variables, token),
        "sources/buildDescription.xml": build_description(name),
        f"sources/{name}.c": source,
    }
    if binary:
        files[f"binaries/{target}/{name}{_ENDS.get(target.split('-')[1], '.so')}"] = compiled(
            source
        )
    writing.write(path, _zipped(files))
    return ExportedFMU(
        Path(path),
        {f.name: f.operations for f in functions},
        variables.states,
        tuple(model.inputs),
        tuple(model.outputs),
        tuple(model.parameters),
        target if binary else None,
    )


def _platform() -> str:
    machine = platform.machine().lower()
    return f"{_MACHINES.get(machine, machine)}-{platform.system().lower()}"


def _zipped(files: Mapping[str, str | bytes]) -> bytes:
    """An archive that depends on the files alone, and not on when it is made."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def _is_stiff(model: Model) -> bool:
    nominal = model.nominal
    return isinstance(
        default_method(nominal, jnp.asarray(TIMES), None, frequencies_of(nominal)).solver, Rodas5P
    )


def _functions(model: Model) -> list[Emitted]:
    """The functions of the source, of (t, x, s) with s the inputs and then the parameters."""
    count, given = len(model.inputs), len(model.inputs) + len(model.parameters)
    states, outputs = 2 * model.nominal.n, len(model.outputs)
    point = {"t": (), "x": (states,), "s": (given,)}
    known = equations.words(model.nominal)
    labels = {key: known[key] for key in ("x", "a")}
    labels |= {"s": [*model.inputs, *model.parameters], "y": list(model.outputs)}

    def both(x: Array, s: Array, t: Array) -> tuple[Array, Array]:
        at = t, x, s[:count], s[count:]
        return model.rates(*at), model.measured(*at)

    def rate(t: Array, x: Array, s: Array) -> Mapping[str, Array]:
        return {"a": both(x, s, t)[0][model.nominal.n :]}

    def forward(t: Array, x: Array, s: Array, vx: Array, vs: Array) -> Mapping[str, Array]:
        along = jax.jvp(lambda x, s: both(x, s, t), (x, s), (vx, vs))[1]
        return dict(zip(("dx", "dy"), along, strict=True))

    def reverse(t: Array, x: Array, s: Array, wx: Array, wy: Array) -> Mapping[str, Array]:
        back = jax.vjp(lambda x, s: both(x, s, t), x, s)[1]((wx, wy))
        return dict(zip(("bx", "bs"), back, strict=True))

    def linear(t: Array, x: Array, s: Array) -> Mapping[str, Array]:
        slopes = model.linear(t, x, s[:count], s[count:])
        return dict(zip(("a", "by_q", "by_v", "by_t"), slopes, strict=True))

    along, across = {"vx": (states,), "vs": (given,)}, {"wx": (states,), "wy": (outputs,)}
    measured = lambda t, x, s: {"y": both(x, s, t)[1]}  # noqa: E731
    functions = [
        emit(rate, "model_rate", point, labels, "Accelerations."),
        emit(measured, "model_outputs", point, labels, "Outputs."),
        emit(forward, "model_jvp", point | along, {}, "Derivatives along (vx, vs)."),
        emit(reverse, "model_vjp", point | across, {}, "Adjoint derivatives of (wx, wy)."),
    ]
    if _is_stiff(model):
        functions.append(
            emit(linear, "model_linear", point, labels, "Accelerations and derivatives.")
        )
    return functions + _of_runs(model, point)


def _of_runs(model: Model, point: dict[str, tuple[int, ...]]) -> list[Emitted]:
    """Starts, corners, and what is judged."""
    count, schedule = len(model.inputs), Schedule.of(model.nominal)

    def initial(s: Array) -> Mapping[str, Array]:
        return equations.own_start(model.system(s[count:]))

    def check(t: Array, x: Array, s: Array) -> Mapping[str, Array]:
        system, q, _ = model.at(x, s[count:])
        start = equations.start(system, t, x, jnp.zeros(2))
        worst = jnp.max(jnp.abs(system.constraint(t, q)), initial=0.0)
        numbers = jnp.stack([worst, start["size"]])
        return {"good": jnp.concatenate([start["good"].astype(float), numbers])}

    def corners(s: Array) -> Mapping[str, Array]:
        return equations.corners(model.system(s[count:]))

    def flags(t: Array, x: Array, s: Array, rtol: Array) -> Mapping[str, Array]:
        return equations.flags(model.system(s[count:]), t, x, rtol)

    def longest(t: Array, s: Array) -> Mapping[str, Array]:
        return equations.longest(Schedule.of(model.system(s[count:])), t)

    given = {"s": point["s"]}
    functions = [
        emit(initial, "model_initial", given, {}, "The start of some parameters."),
        emit(
            check, "model_check", point, {}, "Whether constraints and rates hold; violation, size."
        ),
        emit(corners, "model_corners", given, {}, "Times at which steps have to end."),
    ]
    if equations.judged_by_states(model.nominal):
        summary = "What speaks against one state."
        functions.append(emit(flags, "model_flags", point | {"rtol": ()}, {}, summary))
    if schedule.limits_steps:
        functions.append(emit(longest, "model_longest", {"t": ()} | given, {}, "The longest step."))
    return functions


def _source(model: Model, functions: list[Emitted], token: str) -> str:
    """One source of C."""
    names = {f.name: f for f in functions}
    stiff = "model_linear" in names
    defined: dict[str, Any] = {
        "N": model.nominal.n,
        "U": len(model.inputs),
        "P": len(model.parameters),
        "Y": len(model.outputs),
        "CORNERS": names["model_corners"].results["times"][0],
        "METHOD": "RODAS5P" if stiff else "DOPRI8",
        "TOKEN": f'"{token}"',
        **({"STIFF": 1} if stiff else {}),
        **({"FLAGS": 1} if "model_flags" in names else {}),
        **({"LIMITED": 1} if "model_longest" in names else {}),
    }
    heads = ["math.h", "stdbool.h", "stddef.h", "stdint.h", "stdio.h", "stdlib.h", "string.h"]
    kinds = ", ".join(str(int(x)) for x in model.nominal.structure.is_position)
    start = np.array([*model.parameters.values()], float)
    return "\n".join(
        [
            *(f"#include <{head}>" for head in heads),
            *(f"#define {key} {value}" for key, value in defined.items()),
            f"static const int KIND[] = {{{kinds}}};",
            _shares(model.nominal),
            constant_table("PARAMETERS", start),
            *coefficients(),
            *internal(functions),
            *(text_of(f"{x}.c") for x in ("steps", "fmi3_types", "fmi3", "fmi3_runs", "fmi3_rest")),
        ]
    )


def _shares(system: AbstractSystem) -> str:
    """The table of the shares that coordinates have of the tolerances of their kind."""
    shares = eqx.filter_jit(amplitude_shares)(system, system.q0)
    return constant_table("SHARE", np.ones(system.n) if shares is None else np.asarray(shares))
