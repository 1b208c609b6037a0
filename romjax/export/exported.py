"""A system as sources of C, to run elsewhere."""

import os
import re
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..analysis.linearization import Input, Output, force_of, value_of
from ..common import writing
from ..common.checks import check_kind
from ..common.errors import InputError
from ..integrate.default import default_stabilization, start_frequencies
from ..measure.quantity import AbstractQuantity
from ..scene.effect.base import AbstractMarkerEffect
from ..system.base import AbstractSystem, check_system
from ..system.dynamics import gamma
from ..system.stabilization import Baumgarte
from ..system.structure import without_names
from .emit import Emitted, commented, constant_table, emit
from .equations import words
from .refuse import refuse

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_TEMPLATES = ("main.c", "Makefile", "CMakeLists.txt")


class Exported(NamedTuple):
    """What was written: the files in their `folder`, and how many `operations` each function has.

    `states`, `inputs`, `outputs`, `parameters`: names of the entries of x, u, y and p, in order.
    """

    folder: Path
    operations: Mapping[str, int]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]


class _Model(NamedTuple):
    """The functions of (t, x, u, p) that leave."""

    make: Callable[..., AbstractSystem]
    nominal: AbstractSystem
    inputs: Mapping[str, Input]
    outputs: Mapping[str, Output]
    parameters: Mapping[str, float]
    stabilization: Baumgarte | None

    def at(self, x: Array, p: Array) -> tuple[AbstractSystem, Array, Array]:
        system, n = self.nominal, self.nominal.n
        if self.parameters:
            system = self.make(**{name: p[i] for i, name in enumerate(self.parameters)})
        return system, x[:n], x[n:]

    def rates(self, t: Array, x: Array, u: Array, p: Array) -> Array:
        """The rates of the state, (v, a)."""
        system, q, v = self.at(x, p)
        if not self.inputs:
            return jnp.concatenate([v, system.acceleration(t, q, v, self.stabilization)[0]])
        state = system.state(t, q, v)
        each = [force_of(system, what, t, state.q, state.v) for what in self.inputs.values()]
        force = jnp.sum(u[:, None] * jnp.stack(each), axis=0)
        if system.full is not system:
            force = jax.vjp(lambda q: system.state(t, q, v).q, q)[1](force)[0]
        right = gamma(system, t, q, v, self.stabilization)
        return jnp.concatenate([v, state.kkt().solve(state.force() + force, right)[0]])

    def measured(self, t: Array, x: Array, u: Array, p: Array) -> Array:
        """The outputs."""
        del u
        system, q, v = self.at(x, p)
        state = system.state(t, q, v)
        values = [
            value_of(system.full, what, t, state.q, state.v) for what in self.outputs.values()
        ]
        return jnp.stack([jnp.reshape(x, ()) for x in values])

    def lifted(self, t: Array, x: Array, u: Array, p: Array) -> Array:
        """The physical coordinates and their rates."""
        del u
        system, q, v = self.at(x, p)
        state = system.state(t, q, v)
        return jnp.concatenate([state.q, state.v])

    def emitted(self, name: str) -> list[Emitted]:
        """All functions in C."""
        sizes = {"x": 2 * self.nominal.n, "u": len(self.inputs), "p": len(self.parameters)}
        point = {"t": (), **{key: (size,) for key, size in sizes.items()}}
        known = words(self.nominal)
        labels = {"x": known["x"], "u": list(self.inputs), "p": list(self.parameters)}
        rates = [f"{label}, rate" for label in known["x"]]
        found = [
            self._one(name, "f", self.rates, point, labels | {"dx": rates}, "dx"),
            self._one(
                name, "outputs", self.measured, point, labels | {"y": list(self.outputs)}, "y"
            ),
            self._one(
                name, "lift", self.lifted, point, labels | {"z": known["q"] + known["v"]}, "z"
            ),
        ]
        for stem, function in (("f", self.rates), ("outputs", self.measured)):
            found += self._derivatives(f"{name}_{stem}", function, point)
        return found

    def _one(
        self, name: str, stem: str, function: Any, point: Any, labels: Any, result: str
    ) -> Emitted:
        summary = (function.__doc__ or "").strip()
        return emit(lambda *a: {result: function(*a)}, f"{name}_{stem}", point, labels, summary)

    def _derivatives(self, name: str, function: Any, point: Any) -> list[Emitted]:
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
            emit(
                reverse, f"{name}_vjp", {**point, "w": size}, {}, f"Transposed J times w of {name}."
            ),
        ]


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
    - tables of numbers, `model_start` and `model_parameters`.

    Beside them are a header, an example with loops of fixed and of controlled steps, a Makefile and
    a CMakeLists.txt. Results must not overlap arguments; where there are no inputs or
    parameters, NULL will do for them. Numbers are double precision.

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
    model = _model(system, inputs or {}, outputs, parameters or {}, stabilization, name)
    functions = model.emitted(name)
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


def _model(
    system: Any,
    inputs: Mapping[str, Input],
    outputs: Mapping[str, Output] | Sequence[str] | None,
    parameters: Mapping[str, float],
    stabilization: Any,
    name: str,
) -> _Model:
    """The functions to write; raise InputError for wrong arguments."""
    if not _NAME.fullmatch(name):
        raise InputError(f"export.c: name={name!r}; give letters, digits and _, a letter first.")
    for key, value in parameters.items():
        if np.ndim(value) or not np.isfinite(value):
            raise InputError(f"export.c: parameter {key}={value}; give a finite number.")
    makes = callable(system)
    if parameters and not makes:
        refuse(
            f"parameters {', '.join(parameters)} of a system whose numbers are frozen",
            "give a function of these parameters that makes the system",
        )
    nominal = system(**parameters) if makes else system
    check_system("export.c", nominal)
    acting, measured = (AbstractMarkerEffect, Callable), (str, AbstractQuantity, Callable)
    for key, force in inputs.items():
        check_kind(
            "export.c", f"input {key!r}", force, acting, "an effect or a function of t, q, v"
        )
    if outputs is None:
        outputs = [coordinate.label for coordinate in nominal.full.structure.coordinates]
    named = outputs if isinstance(outputs, Mapping) else {label: label for label in outputs}
    if not named:
        raise InputError("export.c: outputs are empty; leave them out for all coordinates.")
    for key, what in named.items():
        remedy = "a label, a quantity or a function"
        check_kind("export.c", f"output {key!r}", what, measured, remedy)
    if stabilization == "default":
        ts, bare = np.array([0.0, 1.0]), without_names(nominal)
        found = start_frequencies(bare, ts, nominal.q0, nominal.v0)
        stabilization = default_stabilization(bare, jnp.asarray(ts), None, found)
    if not isinstance(stabilization, Baumgarte | None):
        refuse(
            f"{type(stabilization).__name__} is a change of the state between steps",
            "take romjax.Baumgarte(alpha, beta) or None",
        )
    return _Model(system, nominal, inputs, named, parameters, stabilization)


def _tables(model: _Model, name: str) -> dict[str, np.ndarray]:
    start = np.concatenate([np.asarray(model.nominal.q0), np.asarray(model.nominal.v0)])
    return {f"{name}_start": start, f"{name}_parameters": np.array([*model.parameters.values()])}


def _source(model: _Model, functions: list[Emitted], name: str) -> str:
    head = [f'#include "{name}.h"', "", "#include <math.h>", ""]
    tables = [
        constant_table(key, values).removeprefix("static ")
        for key, values in _tables(model, name).items()
    ]
    return "\n".join([*head, *tables, "", *(f.source for f in functions)])


def _header(model: _Model, functions: list[Emitted], name: str) -> str:
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
