"""Operations that move numbers, on NumPy's arrays of what is known and of terms."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .arithmetic import Arithmetic
from .refuse import refuse
from .terms import TYPES, Term, is_known
from .widths import filling, is_whole

Cells = np.ndarray  # of numbers of Python, and of terms
Operands = list[Cells]


def kind_of(aval: Any) -> str:
    """The kind of the numbers of an array, one of `TYPES`."""
    if jnp.issubdtype(aval.dtype, jax.dtypes.prng_key):
        refuse("random numbers", "draw them before, and take what is drawn as an array")
    dtype: Any = np.dtype(aval.dtype)
    if dtype.kind == "f" and dtype != np.float64:
        refuse(
            f"numbers of type {dtype}, since C is made in double precision",
            "ask for dtype=float where they are made",
        )
    kind = str(dtype) if dtype.kind in "iu" else str(dtype.kind)
    if kind not in TYPES:
        refuse(f"numbers of type {dtype}", "use real numbers")
    return kind


def cells(x: Any) -> Cells:
    """An array of numbers of Python."""
    return np.asarray(np.asarray(x).tolist(), dtype=object).reshape(np.shape(x))


def filled(shape: tuple[int, ...], value: Any) -> Cells:
    array = np.empty(shape, object)
    array[...] = value
    return array


def all_known(x: Cells) -> bool:
    return all(is_known(each) for each in x.flat)


def over(function: Any, x: Operands) -> Cells:
    """A function of single numbers over arrays, of which some may be single numbers."""
    return np.asarray(np.frompyfunc(function, len(x), 1)(*x), dtype=object)


class Arrays:
    """The operations by their names, of the operands and the parameters of an equation.

    `kinds` of the operands are those of `TYPES`.
    """

    def __init__(self, arithmetic: Arithmetic) -> None:
        self.arithmetic = arithmetic
        self.operations: dict[str, Callable[[Operands, Any, list[str]], Any]] = {
            "broadcast_in_dim": lambda x, p, _: _broadcast(x[0], p),
            "slice": lambda x, p, _: x[0][_slices(p)],
            "squeeze": lambda x, p, _: np.squeeze(x[0], axis=p["dimensions"]),
            "expand_dims": lambda x, p, _: np.expand_dims(x[0], p["dimensions"]),
            "reshape": lambda x, p, _: x[0].reshape(p["new_sizes"]),
            "tile": lambda x, p, _: np.tile(x[0], p["reps"]),
            "transpose": lambda x, p, _: x[0].transpose(p["permutation"]),
            "concatenate": lambda x, p, _: np.concatenate(x, axis=p["dimension"]),
            "stack": lambda x, p, _: np.stack(x, axis=p["axis"]),
            "unstack": lambda x, p, _: [
                np.take(x[0], i, axis=p["axis"]) for i in range(x[0].shape[p["axis"]])
            ],
            "split": lambda x, p, _: np.split(x[0], np.cumsum(p["sizes"])[:-1], axis=p["axis"]),
            "rev": lambda x, p, _: np.flip(x[0], axis=p["dimensions"]),
            "pad": lambda x, p, _: _padded(x[0], x[1], p["padding_config"]),
            "iota": lambda x, p, _: _counted(p),
            "copy": lambda x, p, _: x[0],
            "copy_p": lambda x, p, _: x[0],
            "stop_gradient": lambda x, p, _: x[0],
            "optimization_barrier": lambda x, p, _: list(x),
            "round": lambda x, p, _: over(self.arithmetic.rounded[int(p["rounding_method"])], x),
            "polynomial": lambda x, p, _: self._polynomial(*x),
            "gather": self._gather,
            "dynamic_slice": self._dynamic_slice,
            "dynamic_update_slice": self._dynamic_update_slice,
            "dot_general": self._dot,
            "argmax": lambda x, p, k: self._first(x[0], p, k[0], "gt"),
            "argmin": lambda x, p, k: self._first(x[0], p, k[0], "lt"),
        }

    def _polynomial(self, x: Cells, *coefficients: Cells) -> Cells:
        """Horner's rule, of coefficients from the lowest on."""
        times, plus = (self.arithmetic.elementwise[name] for name in ("mul", "add"))
        *lower, total = coefficients
        for coefficient in reversed(lower):
            total = over(lambda a, b, c: plus(times(a, b, "f"), c, "f"), [total, x, coefficient])
        return total

    def _first(self, x: Cells, p: Any, kind: str, better: str) -> Cells:
        """The place of the first largest or least number along one axis."""
        (axis,) = p["axes"]
        best = np.array(np.take(x, 0, axis), dtype=object)
        where = filled(best.shape, 0)
        compare = self.arithmetic.elementwise[better]
        for i in range(1, x.shape[axis]):
            for at in np.ndindex(best.shape):
                new = np.moveaxis(x, axis, 0)[(i, *at)]
                takes = compare(new, best[at], kind="b")
                if kind == "f":  # NaN comes before all numbers
                    unlike, like = (self.arithmetic.elementwise[x] for x in ("ne", "eq"))
                    lost = self.arithmetic.both(unlike(new, new), like(best[at], best[at]))
                    takes = self.arithmetic.either(takes, lost)
                best[at] = self.arithmetic.choose(takes, best[at], new, kind)
                where[at] = self.arithmetic.choose(takes, where[at], i, "i")
        return where

    def _dot(self, x: Operands, p: Any, kinds: list[str]) -> Cells:
        (left, right), (left_batch, right_batch) = p["dimension_numbers"]
        a, b = x
        own = [i for i in range(a.ndim) if i not in (*left, *left_batch)]
        others = [i for i in range(b.ndim) if i not in (*right, *right_batch)]
        a = a.transpose([*left_batch, *own, *left])
        b = b.transpose([*right_batch, *right, *others])
        batch, length = len(left_batch), int(np.prod(a.shape[len(left_batch) + len(own) :]))
        shape = a.shape[: batch + len(own)] + b.shape[batch + len(right) :]
        count = int(np.prod(a.shape[:batch]))
        rows = a.reshape(count, int(np.prod(shape[batch : batch + len(own)])), length)
        columns = b.reshape(count, length, int(np.prod(shape[batch + len(own) :])))
        add, mul, kind = self.arithmetic.add, self.arithmetic.mul, kinds[0]
        out = filled((count, rows.shape[1], columns.shape[2]), 0.0 if kind == "f" else 0)
        for h, i, j in np.ndindex(out.shape):
            total = out[h, i, j]
            for k in range(length):
                total = add(total, mul(rows[h, i, k], columns[h, k, j], kind), kind)
            out[h, i, j] = total
        return out.reshape(shape)

    # Places that may depend on the state.

    def _offset(self, start: list[Any], shape: tuple[int, ...]) -> Any:
        """The place of a start in the row of all numbers of an array."""
        strides = [int(np.prod(shape[d + 1 :])) for d in range(len(shape))]
        offset: Any = 0
        for at, stride in zip(start, strides, strict=True):
            offset = self.arithmetic.add(offset, self.arithmetic.mul(at, stride, "i"), "i")
        return offset

    def _part(self, x: Cells, start: list[Any], sizes: Any, kind: str) -> Cells:
        """A part of an array, from a start that may depend on the state."""
        if all(is_known(at) for at in start):
            cut = tuple(slice(at, at + size) for at, size in zip(start, sizes, strict=True))
            return x[cut]
        name = self.arithmetic.writer.array(kind, list(x.flat))
        offset = self._offset(start, x.shape)
        places = np.arange(x.size).reshape(x.shape)[tuple(slice(size) for size in sizes)]
        part = np.empty(places.shape, object)
        for at in np.ndindex(places.shape):
            uses = (name, *offset.uses)
            part[at] = Term(f"{name}[{offset} + {places[at]}]", uses)
        return part

    def _dynamic_slice(self, x: Operands, p: Any, kinds: list[str]) -> Cells:
        sizes = p["slice_sizes"]
        start = start_within(self.arithmetic, [at.item() for at in x[1:]], x[0].shape, sizes)
        return self._part(x[0], start, sizes, kinds[0])

    def _dynamic_update_slice(self, x: Operands, p: Any, kinds: list[str]) -> Cells:
        del p
        operand, update = x[:2]
        start = start_within(
            self.arithmetic, [at.item() for at in x[2:]], operand.shape, update.shape
        )
        if all(is_known(at) for at in start):
            out = operand.copy()
            ends = zip(start, update.shape, strict=True)
            out[tuple(slice(at, at + size) for at, size in ends)] = update
            return out
        writer, offset = self.arithmetic.writer, self._offset(start, operand.shape)
        places = np.arange(operand.size).reshape(operand.shape)
        places = places[tuple(slice(size) for size in update.shape)]
        pairs = zip(places.flat, update.flat, strict=True)
        changes = {f"{offset} + {place}": value for place, value in pairs}
        name = writer.array(kinds[0], list(operand.flat), changes, offset)
        out = np.empty(operand.size, object)
        for k in range(operand.size):
            out[k] = Term(f"{name}[{k}]", (name,))
        return out.reshape(operand.shape)

    def _gather(self, x: Operands, p: Any, kinds: list[str]) -> Cells:
        operand, indices = x
        numbers, sizes = p["dimension_numbers"], p["slice_sizes"]
        fills = "FILL" in str(p["mode"])
        batch = indices.shape[:-1]
        dropped = {*numbers.collapsed_slice_dims, *numbers.operand_batching_dims}
        window = tuple([int(s) for d, s in enumerate(sizes) if d not in dropped])
        out = np.empty(batch + window, object)
        for at in np.ndindex(batch):
            wanted = start_at(
                at,
                indices,
                operand.ndim,
                numbers.start_index_map,
                (numbers.operand_batching_dims, numbers.start_indices_batching_dims),
            )
            start = start_within(self.arithmetic, wanted, operand.shape, sizes)
            part = self._part(operand, start, sizes, kinds[0]).reshape(window)
            if fills:
                part = self._within(part, wanted, start, p.get("fill_value"), kinds[0])
            out[at] = part if window else part.item()
        others = [d for d in range(out.ndim) if d not in numbers.offset_dims]
        return out.transpose(np.argsort([*others, *numbers.offset_dims]))

    def _within(
        self, part: Cells, wanted: list[Any], start: list[Any], fill: Any, kind: str
    ) -> Cells:
        """The part of an array, or what fills it where it would lie outside."""
        same: Any = True
        for a, b in zip(wanted, start, strict=True):
            same = self.arithmetic.both(same, self.arithmetic.elementwise["eq"](a, b, kind="b"))
        if fill is None:
            fill = filling(kind) if is_whole(kind) else {"f": float("nan"), "b": True}[kind]
        pick = np.frompyfunc(lambda x: self.arithmetic.choose(same, fill, x, kind), 1, 1)
        return np.asarray(pick(part), dtype=object)


def start_at(
    batch: tuple[int, ...],
    indices: Cells,
    dims: int,
    index_map: Sequence[int],
    batching: tuple[Sequence[int], Sequence[int]],
) -> list[Any]:
    """The start in an array of so many `dims` that `indices` have for one entry of a batch.

    - `index_map`: which dimensions the indices are of; `batching`: dimensions of the array that go
      along with those of the batch.
    """
    start: list[Any] = [0] * dims
    for d, of in zip(*batching, strict=True):
        start[d] = batch[of]
    for k, d in enumerate(index_map):
        start[d] = indices[(*batch, k)]
    return start


def start_within(arithmetic: Arithmetic, starts: Any, shape: Any, sizes: Any) -> list[Any]:
    """The start of a part of an array, moved so that the part lies within."""
    return [
        arithmetic.clamp(0, at, int(full) - int(size), "i")
        for at, full, size in zip(starts, shape, sizes, strict=True)
    ]


def _slices(p: Any) -> tuple[slice, ...]:
    strides = p["strides"] or (1,) * len(p["start_indices"])
    ends = zip(p["start_indices"], p["limit_indices"], strides, strict=True)
    return tuple(itertools.starmap(slice, ends))


def _broadcast(x: Cells, p: Any) -> Cells:
    shape = [1] * len(p["shape"])
    for d, at in enumerate(p["broadcast_dimensions"]):
        shape[at] = x.shape[d]
    return np.broadcast_to(x.reshape(shape), p["shape"])


def _counted(p: Any) -> Cells:
    shape, along = p["shape"], p["dimension"]
    row = np.arange(shape[along]).reshape([-1 if d == along else 1 for d in range(len(shape))])
    numbers = np.broadcast_to(row, shape)
    return cells(numbers.astype(p["dtype"]))


def _padded(x: Cells, value: Cells, config: Any) -> Cells:
    """Pad each axis before, behind and between its entries; negative numbers cut."""
    for axis, (low, high, inner) in enumerate(config):
        count = x.shape[axis]
        spread = max(0, count + (count - 1) * inner)
        size = low + spread + high
        out = filled((*x.shape[:axis], size, *x.shape[axis + 1 :]), value.item())
        at = low + (inner + 1) * np.arange(count)
        inside = (at >= 0) & (at < size)
        np.moveaxis(out, axis, 0)[at[inside]] = np.moveaxis(x, axis, 0)[np.flatnonzero(inside)]
        x = out
    return x
