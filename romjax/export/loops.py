"""The loops of a run around the functions of a system, as one source of C."""

from importlib.resources import files
from typing import Any

import diffrax
import numpy as np

from ..integrate import rodas5p_tableau as rodas5p
from ..reduction.system import has_charts
from ..system.base import AbstractSystem
from ..system.flags import Flag
from ..system.schedule import Schedule
from ..system.validity import TrainingBox
from . import equations
from .emit import Emitted, constant_table, emit
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


def functions_of(system: AbstractSystem, stiff: bool) -> list[Emitted]:
    """The functions that the loops call; `stiff`: with the derivatives that Rodas5P takes."""
    state, words = {"t": (), "x": (2 * system.n,)}, equations.words(system)
    stabilized = {**state, "s": (2,)}

    def of(function: Any, name: str, arguments: Any, summary: str) -> Emitted:
        known = {key: words[key] for key in words if key in ("x", *_RESULTS[name])}
        whole = lambda *args: function(system, *args)  # noqa: E731
        return emit(whole, f"model_{name}", arguments, known, summary)

    found = [
        of(equations.rate, "rate", stabilized, "Accelerations; s: Baumgarte's alpha and beta."),
        of(
            equations.physical_output,
            "output",
            state,
            "Physical coordinates, rates, and violations.",
        ),
        of(equations.start, "start", state, "Whether the constraints and their rates hold."),
    ]
    if stiff:
        summary = "Accelerations and their derivatives."
        found.append(of(equations.linear, "linear", stabilized, summary))
    if judges_states(system):
        summary = "What speaks against one state."
        found.append(of(equations.flags, "flags", {**state, "rtol": ()}, summary))
    schedule = Schedule.of(system)
    if schedule.limits_steps:
        limit = lambda t, s: equations.longest(schedule, t)  # noqa: E731
        given = {"t": (), "s": (2,)}
        found.append(emit(limit, "model_longest", given, {}, "The longest step."))
    return found


# Results whose entries are coordinates.
_RESULTS = {"rate": ("a",), "linear": ("a",), "output": ("q", "v"), "start": (), "flags": ()}


def judges_states(system: AbstractSystem) -> bool:
    """Whether the region of validity of a model is one of single states, which C can judge."""
    return isinstance(system.validity, TrainingBox) and system.full.validity is None


def source_of(system: AbstractSystem, functions: list[Emitted], stiff: bool) -> str:
    """The functions of a system with the loops around them."""
    kinds = {"KIND": system.structure, "FULL_KIND": system.full.structure}
    tables = [
        f"static const int {name}[] = {{{', '.join(str(int(x)) for x in each.is_position)}}};"
        for name, each in kinds.items()
    ]
    defined = {
        "N": system.n,
        "FULL": system.full.n,
        "HOLDS": int(system.m > 0),
        "RESOLUTION": int(Flag.RESOLUTION),
        **({"STIFF": 1} if stiff else {}),
        **({"FLAGS": 1} if judges_states(system) else {}),
        **({"LIMITED": 1} if Schedule.of(system).limits_steps else {}),
    }
    numbers = [f"#define {name} {value}" for name, value in defined.items()]
    texts = [text_of("steps.c"), text_of("loops.c")]
    head = ["#include <math.h>", "#include <stddef.h>", "#include <stdint.h>"]
    return "\n".join([*head, *numbers, *tables, *coefficients(), *internal(functions), *texts])


def text_of(file: str) -> str:
    """A text of C that is the same for all models."""
    return files(__package__).joinpath(file).read_text()


def internal(functions: list[Emitted]) -> list[str]:
    """Functions that no other source sees, and before them what they are."""
    heads = ["static " + f.prototype for f in functions]
    bodies = [f.source.replace(f"void {f.name}(", f"static void {f.name}(", 1) for f in functions]
    return heads + bodies


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
        "D_DENSE": dense,
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
