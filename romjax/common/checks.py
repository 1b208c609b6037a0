"""Checks of what users pass; each raises an error that names the owner, the field and the value."""

import difflib
from collections.abc import Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .arrays import as_array, concrete
from .errors import InputError
from .identity_cache import IdentityCache

# Names in a message.
_LISTED = 20


def check_kind(
    owner: str,
    field: str,
    value: Any,
    kind: Any,
    remedy: str,
    error: type[InputError] = InputError,
) -> None:
    """Raise unless `value` is an object of a class, or of one of some; `remedy`: what to give."""
    if isinstance(value, kind):
        return
    kind_is = "the class" if isinstance(value, type) else "of type"
    name = (value if isinstance(value, type) else type(value)).__name__
    raise error(f"{owner}: {field} is {kind_is} {name}; give {remedy}.", field=field)


def check_one_run(owner: str, t: Any) -> None:
    """Raise InputError, beginning with `owner`, for output times `t` of several runs at once."""
    shape = np.shape(t)
    if len(shape) != 1:
        raise InputError(
            f"{owner}: the run is a batch of shape {shape[:-1]}; take one out of it, as by "
            "jax.tree.map(lambda x: x[0], run), or map over it, as by jax.vmap.",
            field="run",
        )


def check_order(
    owner: str,
    labels: Sequence[str],
    others: Sequence[str],
    error: type[ValueError] = InputError,
    remedy: str = "give the bodies of both scenes in one order",
) -> None:
    """Raise where the same coordinates are in another order; other names may be those of another
    description of the same mechanism. `remedy`: what to do.
    """
    if tuple(labels) != tuple(others) and sorted(labels) == sorted(others):
        at = next(i for i, pair in enumerate(zip(labels, others, strict=True)) if len({*pair}) > 1)
        raise error(
            f"{owner}: the same coordinates are in another order, '{others[at]}' in the place of "
            f"'{labels[at]}'; {remedy}."
        )


def check_choice(
    owner: str,
    field: str,
    value: Any,
    choices: tuple[str, ...],
    error: type[InputError] = InputError,
) -> None:
    """Raise unless `value` is one of some words."""
    if value not in choices:
        words = f"{owner}: {field} is {value!r}, but it must be one of {', '.join(choices)}."
        raise error(words, field=field)


def check_shape(
    owner: str,
    field: str,
    value: Any,
    shape: tuple[int | None, ...],
    error: type[InputError] = InputError,
) -> None:
    """Raise unless `value` has `shape`, where None stands for any length."""
    actual = value.shape if isinstance(value, np.ndarray | jax.Array) else jnp.shape(value)
    if actual == shape:
        return
    fits = len(actual) == len(shape) and all(
        want in (None, got) for want, got in zip(shape, actual, strict=True)
    )
    if not fits:
        words = f"{owner}: {field} has shape {actual}, but it must {_describe(shape)}."
        raise error(words, field=field)


def _describe(shape: tuple[int | None, ...]) -> str:
    if shape == (None,):
        return "have one axis, of any length"
    if not shape:
        return "be a single number"
    lengths = ("any" if length is None else str(length) for length in shape)
    return f"have shape ({', '.join(lengths)})"


def as_time(owner: str, t: Any, dtype: Any) -> jax.Array:
    """A time `t` [s] as an array; raise InputError, beginning with `owner`, unless it is one finite
    number.
    """
    try:
        time = as_array(t)
    except (TypeError, ValueError) as error:
        raise InputError(f"{owner}: t is {t!r}; give a time in seconds.", field="t") from error
    check_shape(owner, "t", time, ())
    check_finite(owner, "t", time)
    return time.astype(dtype)


_finite = IdentityCache()  # of arrays of JAX, which never change


def check_finite(owner: str, field: str, value: Any, error: type[InputError] = InputError) -> None:
    """Raise where a number is infinite or NaN."""
    if _finite.get(value):
        return
    number = concrete(value)
    if number is not None and not np.all(np.isfinite(number)):
        raise error(f"{owner}: {field} is {number}; every number must be finite.", field=field)
    if number is not None and isinstance(value, jax.Array):
        _finite.put(value, True)


def check_positive(
    owner: str, field: str, value: Any, remedy: str = "", error: type[InputError] = InputError
) -> None:
    """Raise unless all numbers are positive."""
    if isinstance(value, float) and value > 0:
        return
    number = concrete(value)
    if number is not None and not np.all(number > 0):
        words = f"{owner}: {field} is {number}, but it must be positive. {remedy}".rstrip()
        raise error(words, field=field)


def check_not_negative(
    owner: str, field: str, value: Any, error: type[InputError] = InputError
) -> None:
    """Raise where a number is negative."""
    number = concrete(value)
    if number is not None and not np.all(number >= 0):
        raise error(f"{owner}: {field} is {number}, but it must not be negative.", field=field)


def unknown_name(owner: str, what: str, name: Any, known: Iterable[str]) -> InputError:
    """The error about a `what` that does not exist under a name, with those that do."""
    names = list(known)
    close = difflib.get_close_matches(str(name), names, n=3, cutoff=0.5)
    hint = f"Did you mean {' or '.join(repr(match) for match in close)}? " if close else ""
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    listed = ", ".join(names[:_LISTED]) + more if names else "none at all"
    return InputError(f"{owner}: there is no {what} {name!r}. {hint}There are: {listed}.")
