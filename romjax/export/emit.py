"""Functions of JAX as functions of C: no heap, no library but that of mathematics, fixed sizes."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
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

    closed = jax.make_jaxpr(traced)(*shapes)
    results = {key: tuple(x.shape) for key, x in zip(names, closed.out_avals, strict=True)}
    writer = Writer(name, most, unrolled)
    arithmetic = Arithmetic(writer)
    program = Control(writer, arithmetic, Arrays(arithmetic))
    given = [_argument(key, shape) for key, shape in arguments.items()]
    jaxpr, used = compat.without_unused(closed)
    needed = [x for x, is_used in zip(given, used, strict=True) if is_used]
    values = program.run(jaxpr, closed.consts, needed)
    lines, tables, count = writer.finish([x for each in values for x in each.flat])
    ends = [
        line
        for key, each in zip(names, values, strict=True)
        for line in _assignments(key, each, (labels or {}).get(key))
    ]
    head = _head(name, arguments, results)
    comment = _comment(summary, arguments, labels or {})
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
