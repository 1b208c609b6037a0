"""Numeric fields of scene elements: always arrays, so that a new number never recompiles."""

import dataclasses
from collections.abc import Sequence
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Real

# What a user may write for a number, a point or a list of numbers.
Number = ArrayLike
Vector = ArrayLike | Sequence[Any]
Time = Real[ArrayLike, ""]  # [s]


class SceneError(ValueError):
    """A scene that cannot be assembled: names the culprit, its value and the remedy."""


def as_array(value: Any) -> Array:
    """`value` as a floating-point array of the precision that JAX is set to."""
    if isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jnp.inexact):
        return value
    return jnp.asarray(value, dtype=jnp.result_type(float))


def _convert(value: Any) -> Array | None:
    return None if value is None else as_array(value)


def number(default: Any = ..., **kwargs: Any) -> Any:
    """A field holding a floating-point array (or None, where the element allows it)."""
    if default is ...:
        return eqx.field(converter=_convert, **kwargs)
    return eqx.field(converter=_convert, default=default, **kwargs)


def concrete(value: Any) -> np.ndarray | None:
    """The value as a NumPy array, or None while JAX traces (then it cannot be judged)."""
    return None if isinstance(value, jax.core.Tracer) else np.asarray(value)


def check_shape(owner: str, field: str, value: Any, shape: tuple[int | None, ...]) -> None:
    """Raise unless `value` has `shape`, where None stands for any length."""
    found = jnp.shape(value)
    fits = len(found) == len(shape) and all(
        want in (None, got) for want, got in zip(shape, found, strict=True)
    )
    if not fits:
        wanted = "(" + ", ".join("any" if s is None else str(s) for s in shape) + ")"
        raise SceneError(f"{owner}: {field} has shape {found}, but it must have shape {wanted}.")


def check_finite(owner: str, field: str, value: Any) -> None:
    known = concrete(value)
    if known is not None and not np.all(np.isfinite(known)):
        raise SceneError(f"{owner}: {field} is {known}; every number must be finite.")


def check_positive(owner: str, field: str, value: Any, remedy: str = "") -> None:
    known = concrete(value)
    if known is not None and not np.all(known > 0):
        raise SceneError(f"{owner}: {field} is {known}, but it must be positive. {remedy}".rstrip())


def check_not_negative(owner: str, field: str, value: Any) -> None:
    known = concrete(value)
    if known is not None and not np.all(known >= 0):
        raise SceneError(f"{owner}: {field} is {known}, but it must not be negative.")


def check_numbers(
    owner: str,
    part: Any,
    *fields: str,
    shape: tuple[int | None, ...] = (),
    sign: Literal["any", "not negative", "positive"] = "any",
    prefix: str = "",
    remedy: str = "",
) -> None:
    """Check shape, finiteness and sign of the fields of `part`; None only where it is the default.

    `prefix` goes before their names in messages, `remedy` after what is said of a sign.
    """
    optional = {field.name for field in dataclasses.fields(part) if field.default is None}
    for field in fields:
        value = getattr(part, field)
        if value is None and field in optional:
            continue
        if value is None:
            raise SceneError(f"{owner}: {prefix}{field} is None; give a number.")
        check_shape(owner, prefix + field, value, shape)
        check_finite(owner, prefix + field, value)
        if sign == "not negative":
            check_not_negative(owner, prefix + field, value)
        elif sign == "positive":
            check_positive(owner, prefix + field, value, remedy)
