"""A system as sources of C, to run elsewhere."""

import os
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..analysis.linearization import Input, Output
from ..common import writing
from ..system.base import AbstractSystem
from ..system.stabilization import Baumgarte
from .emit import Emitted, commented, constant_table, emit
from .equations import words
from .leaving import Model, model_of

_TEMPLATES = ("main.c", "casadi.c", "Makefile", "CMakeLists.txt")


class Exported(NamedTuple):
    """An exported model: the files in their `folder`, and the number of `operations` of each
    function.

    `states`, `inputs`, `outputs`, `parameters`: names of the entries of x, u, y and p, in order.
    """

    folder: Path
    operations: Mapping[str, int]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]


def c(
    system: AbstractSystem | Callable[..., AbstractSystem],
    path: str | os.PathLike[str],
    *,
    inputs: Mapping[str, Input] | None = None,
    outputs: Mapping[str, Output] | Sequence[str] | None = None,
    parameters: Mapping[str, float] | None = None,
    stabilization: Baumgarte | str | None = "default",
    name: str = "model",
) -> Exported:
    """Write a system as C99, without heap and without any library but that of mathematics.

    The functions of the state x = (q, v), inputs u and parameters p:

    - dx = (v, a) by `model_f`, y by `model_outputs`, and the physical coordinates with their rates,
      of a reduced system too, by `model_lift`;
    - J v by `model_f_jvp` and `model_outputs_jvp`, Jᵀ w by `model_f_vjp` and `model_outputs_vjp`,
      where J has the derivatives by x, u and p;
    - tables of numbers, `model_start`, `model_time`, when the start holds, and `model_parameters`.

    Beside them are a header, an example with loops of fixed and of controlled steps, external
    functions for CasADi, a Makefile and a CMakeLists.txt. Results must not overlap arguments; where
    there are no inputs or parameters, NULL will do for them. Numbers are double precision.

    **Arguments:**

    - `system`: full, reduced or a `CustomSystem`, whose numbers are frozen; or a function of the
      parameters by name that makes one, always of the same structure:
      `lambda force: rom.with_full(rj.assemble(rj.gallery.cart_pendulum(force=force)))`.
    - `path`: the folder, made if it is not there; files of the same names in it are replaced.

    **Keyword arguments:**

    - `inputs`: by name, effects as they act with unit strength, or functions (t, q, v) of physical
      coordinates that return generalized forces, as `linearize` takes them.
    - `outputs`: labels of physical coordinates, "cart.x", and of their rates, "cart.x'"; or by
      name, labels, quantities of `romjax.quantity`, or functions (t, q, v) of physical coordinates
      that return a number. All physical coordinates unless given.
    - `parameters`: those of `system`, if it is a function, with the numbers that
      `model_parameters` and the start have.
    - `stabilization`: `Baumgarte(alpha, beta)` in f, or None; unless given, what `simulate` takes
      for a run of one second.
    - `name`: what stands for "model" above.

    Raises InputError, with the reason, for what C cannot be made of, for more than 25 000
    operations in a function, and for a wrong argument; OSError where nothing can be written.
    """
    model = model_of(
        "export.c", system, inputs or {}, outputs, parameters or {}, stabilization, name
    )
    functions = _emitted(model, name)
    folder = Path(path)
    folder.mkdir(parents=True, exist_ok=True)
    texts = {
        f"{name}.c": _source(model, functions, name),
        f"{name}.h": _header(model, functions, name),
    }
    for file in _TEMPLATES:
        text = files(__package__).joinpath("templates", file).read_text()
        texts[file] = text.replace("MODEL", name.upper()).replace("model", name)
    for file, text in texts.items():
        writing.write(folder / file, text)
    return Exported(
        folder,
        {f.name: f.operations for f in functions},
        tuple(words(model.nominal)["x"]),
        tuple(model.inputs),
        tuple(model.outputs),
        tuple(model.parameters),
    )


def _emitted(model: Model, name: str) -> list[Emitted]:
    """All functions in C."""
    sizes = {"x": 2 * model.nominal.n, "u": len(model.inputs), "p": len(model.parameters)}
    point = {"t": (), **{key: (size,) for key, size in sizes.items()}}
    known = words(model.nominal)
    labels = {"x": known["x"], "u": list(model.inputs), "p": list(model.parameters)}
    rates = [f"{label}, rate" for label in known["x"]]
    whole = [
        ("f", model.rates, "dx", rates),
        ("outputs", model.measured, "y", list(model.outputs)),
        ("lift", model.lifted, "z", known["q"] + known["v"]),
    ]
    functions = [
        _one(f"{name}_{stem}", function, point, labels | {result: entries}, result)
        for stem, function, result, entries in whole
    ]
    for stem, function in (("f", model.rates), ("outputs", model.measured)):
        functions += _derivatives(f"{name}_{stem}", function, point)
    return functions


def _one(name: str, function: Any, point: Any, labels: Any, result: str) -> Emitted:
    summary = (function.__doc__ or "").strip()
    return emit(lambda *a: {result: function(*a)}, name, point, labels, summary)


def _derivatives(name: str, function: Any, point: Any) -> list[Emitted]:
    """J v and Jᵀ w, J the derivatives by x, u and p."""
    size = jax.eval_shape(function, *(jnp.zeros(shape) for shape in point.values())).shape

    def forward(t: Array, *args: Array) -> dict[str, Array]:
        x, v = args[:3], args[3:]
        return {"jv": jax.jvp(lambda *x: function(t, *x), x, v)[1]}

    def reverse(t: Array, *args: Array) -> dict[str, Array]:
        back = jax.vjp(lambda *x: function(t, *x), *args[:3])[1](args[3])
        return dict(zip(("wx", "wu", "wp"), back, strict=True))

    along = {f"v{key}": shape for key, shape in point.items() if key != "t"}
    return [
        emit(forward, f"{name}_jvp", {**point, **along}, {}, f"J v of {name}."),
        emit(reverse, f"{name}_vjp", {**point, "w": size}, {}, f"Transposed J times w of {name}."),
    ]


def _tables(model: Model, name: str) -> dict[str, np.ndarray]:
    return {
        f"{name}_start": model.start(),
        f"{name}_time": np.array([model.time]),
        f"{name}_parameters": np.array([*model.parameters.values()]),
    }


def _source(model: Model, functions: list[Emitted], name: str) -> str:
    head = [f'#include "{name}.h"', "", "#include <math.h>", ""]
    tables = [
        constant_table(key, values).removeprefix("static ")
        for key, values in _tables(model, name).items()
    ]
    return "\n".join([*head, *tables, "", *(f.source for f in functions)])


def _header(model: Model, functions: list[Emitted], name: str) -> str:
    """The sizes, what the entries of each array are, and the functions."""
    names = {
        "x": words(model.nominal)["x"],
        "u": list(model.inputs),
        "p": list(model.parameters),
        "y": list(model.outputs),
    }
    counts = {"STATES": "x", "INPUTS": "u", "PARAMETERS": "p", "OUTPUTS": "y"}
    guard = f"{name.upper()}_H"
    lines = [f"#ifndef {guard}", f"#define {guard}", "", "/* In SI units."]
    for key, each in names.items():
        lines += [f" * {key}[{k}]: {commented(label)}" for k, label in enumerate(each)]
    lines += [" */", ""]
    lines += [f"#define {name.upper()}_{what} {len(names[key])}" for what, key in counts.items()]
    lines += ["", "#ifdef __cplusplus", 'extern "C" {', "#endif"]
    lines += [
        f"extern const double {key}[{max(len(values), 1)}];"
        for key, values in _tables(model, name).items()
    ]
    lines += [f.prototype for f in functions]
    return "\n".join([*lines, "#ifdef __cplusplus", "}", "#endif", "", "#endif", ""])
