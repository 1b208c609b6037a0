"""Arrays of a program that are held with the axis of lanes last."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp

from ..common import compat


class Held(NamedTuple):
    """An array of a program.

    `axis`: the place of the axis of lanes in the program; in `array` that axis is the last one.
    None: there are no lanes, or they are not told apart from other axes, and `array` is as in the
    program.
    """

    array: Any
    axis: int | None = None

    def as_given(self) -> Any:
        """The array as it is in the program."""
        if self.axis is None or self.axis == self.array.ndim - 1:
            return self.array
        return jnp.moveaxis(self.array, -1, self.axis)

    def along(self, axis: int | None) -> Any:
        """The array with this axis of the program last."""
        if axis == self.axis:
            return self.array
        array = jnp.asarray(self.as_given())
        return array if axis is None or axis == array.ndim - 1 else jnp.moveaxis(array, axis, -1)


# The results of an operation, of an equation and what it is given; None where it has to be as it is
# in the program.
Rule = Callable[[Any, Sequence[Held]], list[Held] | None]


def bind(equation: Any, arrays: Sequence[Any], **changed: Any) -> list[Any]:
    """The results of an operation, some of whose parameters are changed."""
    results = compat.bind(equation.primitive, [*arrays], {**equation.params, **changed})
    return list(results) if equation.primitive.multiple_results else [results]


def moved(k: int, axis: int) -> int:
    """Where another axis than that of lanes is, once that is last."""
    return k - (k > axis)


def all_moved(axes: Sequence[int], axis: int) -> tuple[int, ...]:
    """The same of several axes."""
    return tuple(moved(k, axis) for k in axes)


def rotated(x: Sequence[Any], axis: int) -> tuple[Any, ...]:
    """What is given for each axis, with that of lanes last."""
    return (*x[:axis], *x[axis + 1 :], x[axis])


def shape_of(x: Any) -> tuple[int, ...]:
    """The shape of a variable or a number of a program."""
    return tuple(x.aval.shape)


def first_axis(given: Sequence[Held]) -> int:
    """Where the first array with lanes has them."""
    return next(x.axis for x in given if x.axis is not None)
