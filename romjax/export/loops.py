"""The loops of a run around the functions of a system, as one source of C."""

from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..integrate import rodas5p_tableau as rodas5p
from ..reduction.system import has_charts
from ..system.base import AbstractSystem
from ..system.flags import Flag
from ..system.schedule import Schedule
from . import equations
from .emit import Emitted, constant_table, emit, emit_split
from .leaving import Model
from .refuse import refuse


def check_runs(system: AbstractSystem) -> None:
    """Raise InputError for a system whose runs do more than step from one time to the next."""
    if not system.n:
        refuse("a system without coordinates has no motion", "leave it to romjax.simulate")
    if system.full.structure.states:
        refuse(
            "effects with first-order states have tolerances that compiled loops do not know",
            "leave it to romjax.simulate, or export the right-hand side by romjax.export.c",
        )
    if has_charts(system):
        refuse(
            "a reduced model with several charts changes its coordinates between steps",
            "reduce with one chart, by a shorter training, or leave it to romjax.simulate",
        )
    if system.structure.contacts:
        refuse(
            "steps must end where contacts begin, which compiled loops do not look for",
            "leave contacts to romjax.simulate, or export the right-hand side by romjax.export.c",
        )
    if not Schedule.of(system).is_known:
        refuse(
            "a load that is no signal of romjax, or a function of your own of the time, does not "
            "say when it changes, which compiled loops do not look for",
            "give the signal `corners` and `longest_step`, or leave it to romjax.simulate",
        )


def functions_of(model: Model, stiff: bool, along: bool = False) -> list[Emitted]:
    """The functions that the loops call, of (t, x, s) with s Baumgarte's α, β and the parameters.

    `stiff`: with the derivatives that Rodas5P takes. `along`: with the derivatives of all along
    directions of the state and the parameters.
    """
    nominal, words = model.nominal, equations.words(model.nominal)
    point = {"t": (), "x": (2 * nominal.n,), "s": (2 + len(model.parameters),)}
    start, summaries = {"s": point["s"]}, dict(_SUMMARIES)
    functions: dict[str, tuple[Any, dict[str, tuple[int, ...]]]] = {
        "rate": (lambda t, x, s: equations.rate(model.system(s[2:]), t, x, s[:2]), point),
        "output": (lambda t, x, s: equations.physical_output(model.system(s[2:]), t, x), point),
        "start": (lambda t, x, s: equations.start(model.system(s[2:]), t, x, s[:2]), point),
        "initial": (lambda s: equations.own_start(model.system(s[2:])), start),
        "corners": (lambda s: equations.corners(model.system(s[2:])), start),
        "linear": (lambda t, x, s: equations.linear(model.system(s[2:]), t, x, s[:2]), point),
        "flags": (
            lambda t, x, s, rtol: equations.flags(model.system(s[2:]), t, x, rtol),
            point | {"rtol": ()},
        ),
        "longest": (
            lambda t, s: equations.longest(Schedule.of(model.system(s[2:])), t),
            {"t": ()} | start,
        ),
    }
    left_out = {"linear": not stiff, "flags": not judges_states(nominal)}
    left_out["longest"] = not Schedule.of(nominal).limits_steps
    emitted: list[Emitted] = []
    for name, (function, arguments) in functions.items():
        if left_out.get(name):
            continue
        known = {key: words[key] for key in words if key in ("x", *_RESULTS.get(name, ()))}
        if along and name in _DERIVED:
            emitted.extend(_with_derivatives(name, function, arguments, known, summaries[name]))
        else:
            # What is asked for once is short rather than fast: its loops stay loops.
            own = {"unrolled": 0} if name == "start" else {}
            emitted.append(
                emit(function, f"model_{name}", arguments, known, summaries[name], **own)
            )
    return emitted


def _with_derivatives(
    name: str,
    function: Any,
    arguments: dict[str, tuple[int, ...]],
    labels: Mapping[str, list[str]],
    summary: str,
) -> tuple[Emitted, Emitted]:
    """A function and its derivative along a direction of x, where it has one, and of parameters."""
    directions = {"vx": arguments["x"]} if "x" in arguments else {}
    directions["vp"] = (arguments["s"][0] - 2,)

    def both(*args: Array) -> tuple[Mapping[str, Array], Mapping[str, Array]]:
        *given, s = args[: len(arguments)]
        *vx, vp = args[len(arguments) :]
        # The stabilization is no parameter.
        vs = jnp.concatenate([jnp.zeros(2), vp])
        # The time is not differentiated.
        head, rest = (given[:1], given[1:]) if vx else ([], given)
        # In the order of the results, which JAX sorts by their names.
        names: list[str] = []

        def values(*z: Array) -> list[Array]:
            results = function(*head, *z)
            names[:] = results
            return list(results.values())

        results, along = jax.jvp(values, (*rest, s), (*vx, vs))
        derived = {f"d{key}": x for key, x in zip(names, along, strict=True)}
        for key in _NOT_ALONG:
            derived.pop(f"d{key}", None)
        return dict(zip(names, results, strict=True)), derived

    titles = f"model_{name}", f"model_{name}_jvp"
    summaries = summary, f"Derivatives of model_{name} along (vx, vp)."
    return emit_split(both, titles, arguments, directions, labels, summaries)


# Called once for each run: a compiler that leaves them as they are saves up to a third of its time.
_ONCE = ("model_start", "model_initial", "model_corners", "model_initial_jvp")
_UNOPTIMIZED = """#if defined(__clang__)
#define ONCE __attribute__((optnone, noinline))
#elif defined(__GNUC__)
#define ONCE __attribute__((optimize("O0"), noinline))
#else
#define ONCE
#endif"""
# Results whose entries are coordinates, and one that nobody differentiates.
_RESULTS = {"rate": ("a",), "linear": ("a",), "output": ("q", "v")}
_DERIVED = ("rate", "output", "initial", "linear")
_NOT_ALONG = ("violation",)
_SUMMARIES = {
    "rate": "Accelerations.",
    "output": "Physical coordinates, rates, and violations.",
    "start": "Whether the constraints and their rates hold; the size, and how fast bodies turn.",
    "initial": "The start of some parameters.",
    "corners": "Times at which steps have to end.",
    "linear": "Accelerations and their derivatives.",
    "flags": "What speaks against one state.",
    "longest": "The longest step.",
}


def judges_states(system: AbstractSystem) -> bool:
    """Whether single states tell all of the region of validity of a model, so that C judges it."""
    region = system.validity
    return region is not None and region.of_states is region and system.full.validity is None


def source_of(system: AbstractSystem, functions: list[Emitted], shares: np.ndarray) -> str:
    """The functions of a system with the loops around them, and the `shares` of tolerances."""
    names = {f.name: f for f in functions}
    kinds = {"KIND": system.structure, "FULL_KIND": system.full.structure}
    tables = [
        f"static const int {name}[] = {{{', '.join(str(int(x)) for x in each.is_position)}}};"
        for name, each in kinds.items()
    ]
    tables.append(constant_table("SHARE", shares))
    defined = {
        "N": system.n,
        "FULL": system.full.n,
        "HOLDS": int(system.m > 0),
        "RESOLUTION": int(Flag.RESOLUTION),
        "CORNERS": names["model_corners"].results["times"][0],
    }
    parts = {"STIFF": "linear", "FLAGS": "flags", "LIMITED": "longest", "ALONG": "rate_jvp"}
    defined |= {key: 1 for key, name in parts.items() if f"model_{name}" in names}
    for name in _DERIVED:
        if f"model_{name}_jvp" in names:
            size = names[f"model_{name}_jvp"].arguments["kept"][0]
            defined[f"KEPT_{name.upper()}"] = size
    numbers = [f"#define {name} {value}" for name, value in defined.items()]
    loops = text_of("loops.c").replace("/* ALONG */", text_of("along.c"))
    texts = [text_of("steps.c"), loops, text_of("lanes.c")]
    heads = [f"#include <{head}.h>" for head in ("math", "pthread", "stddef", "stdint", "stdlib")]
    return "\n".join([*heads, *numbers, *tables, *coefficients(), *internal(functions), *texts])


def text_of(file: str) -> str:
    """A text of C that is the same for all models."""
    return files(__package__).joinpath(file).read_text()


def internal(functions: list[Emitted]) -> list[str]:
    """Functions that no other source sees, and before them what they are."""
    heads = [("ONCE " if f.name in _ONCE else "") + "static " + f.prototype for f in functions]
    bodies = [f.source.replace(f"void {f.name}(", f"static void {f.name}(", 1) for f in functions]
    return [_UNOPTIMIZED, *heads, *bodies]


def coefficients() -> list[str]:
    """The coefficients of both methods, those of diffrax and of romjax."""
    tableau = diffrax.Dopri8.tableau
    stages = len(tableau.b_sol)
    lower = np.zeros((stages, stages))
    for row, values in enumerate(tableau.a_lower, 1):
        lower[row, : len(values)] = values
    dense = np.asarray(getattr(diffrax.Dopri8.interpolation_cls, "eval_coeffs"))  # noqa: B009
    tables = {
        "D_A": lower,
        "D_C": np.concatenate([[0.0], tableau.c]),
        "D_E": tableau.b_error,
        "D_DENSE": dense.T,
        "R_A": rodas5p.A,
        "R_C": rodas5p.C,
        "R_TIMES": rodas5p.TIMES,
        "R_SLOPES": rodas5p.SLOPES,
        "R_DENSE": rodas5p.DENSE,
    }
    numbers = {"D_STAGES": stages, "STAGES": max(stages, 8), "D_DEGREE": dense.shape[1]}
    lines = [f"#define {name} {value}" for name, value in numbers.items()]
    lines.append(f"#define R_GAMMA {rodas5p.GAMMA!r}")
    return lines + [constant_table(name, values) for name, values in tables.items()]
