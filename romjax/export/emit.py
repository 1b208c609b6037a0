"""Functions of JAX as functions of C: no heap, no library but that of mathematics, fixed sizes."""

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..common import compat
from .arithmetic import Arithmetic
from .arrays import Arrays, Cells, cells
from .control import Control
from .refuse import refuse
from .terms import Term, Writer, literal

# Operations that straight-line code pays for: beyond them the C compiler takes more than some
# seconds, and JAX's programs, which spread their cost over arrays, are as fast.
MOST_OPERATIONS = 25_000
# Lines that one loop may become, before those are left out that nobody needs; chains of 64 bodies
# have some thousand in each of theirs, and an arm in space nearly as many as this.
UNROLLED = 10_000


@dataclasses.dataclass(frozen=True)
class Emitted:
    """A function of C.

    - `source`, `prototype`: its text and what a header says of it. `operations`: their number.
    - `arguments`, `results`: names and shapes; those of shape () are numbers, or one each.
    """

    name: str
    source: str
    prototype: str
    operations: int
    arguments: Mapping[str, tuple[int, ...]]
    results: Mapping[str, tuple[int, ...]]


def emit(
    function: Callable[..., Mapping[str, Any]],
    name: str,
    arguments: Mapping[str, tuple[int, ...]],
    labels: Mapping[str, Sequence[str]] | None = None,
    summary: str = "",
    *,
    most: int = MOST_OPERATIONS,
    unrolled: int = UNROLLED,
) -> Emitted:
    """A function of arrays of doubles as C.

    **Arguments:**

    - `function`: of the `arguments`, by position, to a mapping of arrays by their names.
    - `name`: what it is called in C. `arguments`: their shapes by names, in order; those of
      shape () are passed as numbers, others as pointers, and none may overlap a result.
    - `labels`: what the entries of an argument or a result are, for comments.
    - `summary`: a sentence above it.
    - `most`: operations that it may have. `unrolled`: lines that a loop may become; a longer one is
      a loop in C as well.

    Raises InputError, with the name and the reason, for what cannot be emitted.
    """
    writer, values = _written(function, name, arguments, most, unrolled)
    written = writer.finish(_numbers(values))
    return _emitted(name, written, arguments, values, labels or {}, summary)


def emit_split(
    function: Callable[..., tuple[Mapping[str, Any], Mapping[str, Any]]],
    names: tuple[str, str],
    arguments: Mapping[str, tuple[int, ...]],
    later: Mapping[str, tuple[int, ...]],
    labels: Mapping[str, Sequence[str]],
    summaries: tuple[str, str],
) -> tuple[Emitted, Emitted]:
    """A function of `arguments` and, after them, of `later` ones as two of C.

    The first returns the first of its two groups of results, which need no later argument, and
    numbers that are `kept`; the second returns the other group, of these and of the later
    arguments. So what does not depend on later arguments is computed once for many of them.
    """
    late: list[str] = []

    def both(*args: Array) -> Mapping[str, Any]:
        first, second = function(*args)
        late[:] = second
        return {**first, **second}

    given = {**arguments, **later}
    writer, values = _written(both, names[0], given, MOST_OPERATIONS, UNROLLED, later)
    results = {key: value for key, value in values.items() if key not in late}
    rest = {key: values[key] for key in late}
    kept, first, second = writer.split(_numbers(results), _numbers(rest), later)
    results["kept"] = cells([Term(name, (name,)) for name in kept])
    held = {"kept": (max(len(kept), 1),)}
    return (
        _emitted(names[0], first, arguments, results, labels, summaries[0]),
        _emitted(names[1], second, held | dict(later), rest, {}, summaries[1]),
    )


def _numbers(values: Mapping[str, Cells]) -> list[Any]:
    return [x for each in values.values() for x in each.flat]


def _written(
    function: Callable[..., Mapping[str, Any]],
    name: str,
    arguments: Mapping[str, tuple[int, ...]],
    most: int,
    unrolled: int,
    later: Collection[str] | None = None,
) -> tuple[Writer, dict[str, Cells]]:
    """The program of a function, written, and its results.

    With `later` arguments, the others are numbers of the program, which can be kept.
    """
    shapes = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in arguments.values()]
    if any(jax.dtypes.canonicalize_dtype(x.dtype) != x.dtype for x in shapes):
        refuse(
            "JAX computes in single precision, and C is made in double precision",
            'call jax.config.update("jax_enable_x64", True) before making any array',
        )
    names: list[str] = []

    def traced(*args: Array) -> list[Array]:
        results = function(*args)
        names[:] = results
        return [jnp.asarray(x, jnp.float64) for x in results.values()]

    try:
        closed = compat.of_plain_operations(jax.make_jaxpr(traced)(*shapes))
    except ValueError as error:
        if "Reverse-mode" not in str(error):  # JAX's words name no function that is emitted
            raise
        refuse(
            f"`{name}` is the derivative in reverse mode of a loop whose end depends on the state",
            "give it a known number of turns by jax.lax.fori_loop or scan, or take romjax.compile, "
            "which has derivatives in forward mode alone",
        )
    writer = Writer(name, most, unrolled)
    arithmetic = Arithmetic(writer)
    program = Control(writer, arithmetic, Arrays(arithmetic))
    given = [_argument(key, shape) for key, shape in arguments.items()]
    if later is not None:
        for key, each in zip(arguments, given, strict=True):
            for at in np.ndindex(each.shape) if key not in later else ():
                each[at] = writer.compute("f", "{}", each[at])
    jaxpr, used = compat.without_unused(closed)
    needed = [x for x, is_used in zip(given, used, strict=True) if is_used]
    return writer, dict(zip(names, program.run(jaxpr, closed.consts, needed), strict=True))


def _emitted(
    name: str,
    written: tuple[list[str], list[str], int],
    arguments: Mapping[str, tuple[int, ...]],
    values: Mapping[str, Cells],
    labels: Mapping[str, Sequence[str]],
    summary: str,
) -> Emitted:
    lines, tables, count = written
    results = {key: each.shape for key, each in values.items()}
    ends = [
        line for key, each in values.items() for line in _assignments(key, each, labels.get(key))
    ]
    head = _head(name, arguments, results)
    comment = _comment(summary, arguments, labels)
    unused = [f"  (void){key};" for key in (*arguments, *results)]
    text = "\n".join([*tables, *comment, head, "{", *unused, *lines, *ends, "}", ""])
    return Emitted(name, text, head + ";", count, dict(arguments), results)


def _argument(name: str, shape: tuple[int, ...]) -> Cells:
    out = np.empty(shape, object)
    for place, at in enumerate(np.ndindex(shape)):
        out[at] = Term(f"{name}[{place}]" if shape else name, (name,))
    return out


def _assignments(name: str, values: Cells, labels: Sequence[str] | None) -> list[str]:
    lines = [f"  {name}[{k}] = {literal(x)};" for k, x in enumerate(values.flat)]
    if labels is None:
        return lines
    return [f"{line}  /* {commented(label)} */" for line, label in zip(lines, labels, strict=True)]


def _head(
    name: str, arguments: Mapping[str, tuple[int, ...]], results: Mapping[str, tuple[int, ...]]
) -> str:
    inputs = [
        f"const double *{key}" if shape else f"double {key}" for key, shape in arguments.items()
    ]
    outputs = [f"double *{key}" for key in results]
    return f"void {name}({', '.join(inputs + outputs)})"


def _comment(
    summary: str, arguments: Mapping[str, Any], labels: Mapping[str, Sequence[str]]
) -> list[str]:
    lines = [summary] if summary else []
    for key in arguments:
        if key in labels:
            lines += [f"{key}[{k}]: {label}" for k, label in enumerate(labels[key])]
    if not lines:
        return []
    safe = [commented(line) for line in lines]
    return ["/* " + safe[0], *(f" * {line}" for line in safe[1:]), " */"]


def commented(words: str) -> str:
    """Words that may stand in a comment of C."""
    return words.replace("*/", "* /")


def constant_table(name: str, values: Any) -> str:
    """An array of numbers as a line of C."""
    numbers = ", ".join(literal(x) for x in cells(values).flat)
    return f"static const double {name}[{max(np.size(values), 1)}] = {{{numbers or '0'}}};"
