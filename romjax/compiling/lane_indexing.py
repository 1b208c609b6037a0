"""Operations that take or change parts of arrays that have the axis of lanes last."""

from collections.abc import Sequence
from typing import Any

from .lane_held import Held, all_moved, bind, first_axis, moved, rotated, shape_of


def part(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    """Return the rule of a slice from where the program says."""
    (x, *starts), sizes, axis = given, equation.params["slice_sizes"], given[0].axis
    if axis is None or sizes[axis] != x.array.shape[-1]:
        return None
    arrays = [x.array, *rotated([start.array for start in starts], axis)]
    return [Held(y, axis) for y in bind(equation, arrays, slice_sizes=rotated(sizes, axis))]


def updated(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    """Return the rule of a slice that is put where the program says."""
    x, new, *starts = given
    axis = first_axis((x, new))
    if shape_of(equation.invars[0])[axis] != shape_of(equation.invars[1])[axis]:
        return None
    firsts = rotated([start.array for start in starts], axis)
    return [Held(y, axis) for y in bind(equation, [x.along(axis), new.along(axis), *firsts])]


def gathered(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    """Return the rule of entries at indices."""
    (x, indices), params = given, equation.params
    numbers, axis = params["dimension_numbers"], x.axis
    sizes, out = params["slice_sizes"], shape_of(equation.outvars[0])
    if axis is None:
        return None
    offsets, after = numbers.offset_dims, None
    batched = numbers.operand_batching_dims
    if axis in batched:
        if axis != batched[-1]:
            return None
        batched = (*all_moved(batched[:-1], axis), len(sizes) - 1)
    elif axis in numbers.start_index_map or sizes[axis] != x.array.shape[-1]:
        return None
    else:
        after = offsets[_window(numbers.collapsed_slice_dims, batched, axis)]
        offsets = (*(moved(k, after) for k in offsets if k != after), len(out) - 1)
        batched = all_moved(batched, axis)
    changed = numbers._replace(
        offset_dims=offsets,
        collapsed_slice_dims=all_moved(numbers.collapsed_slice_dims, axis),
        start_index_map=all_moved(numbers.start_index_map, axis),
        operand_batching_dims=batched,
    )
    settings = {"dimension_numbers": changed, "slice_sizes": rotated(sizes, axis)}
    results = bind(equation, [x.array, indices.as_given()], **settings)
    return [Held(y, after) for y in results]


def _window(collapsed: Sequence[int], batched: Sequence[int], axis: int) -> int:
    """The place of an axis among those that a gather or scatter takes as a window."""
    return axis - sum(k < axis for k in (*collapsed, *batched))


def scattered(equation: Any, given: Sequence[Held]) -> list[Held] | None:
    """Return the rule of entries that are put at indices."""
    (x, indices, new), numbers = given, equation.params["dimension_numbers"]
    windows, batched = numbers.update_window_dims, numbers.operand_batching_dims
    inserted, to = numbers.inserted_window_dims, numbers.scatter_dims_to_operand_dims
    operand, update = (shape_of(equation.invars[i]) for i in (0, 2))
    axis = x.axis
    if axis is None:
        if new.axis not in windows:
            return None
        all_windows = [k for k in range(len(operand)) if k not in (*inserted, *batched)]
        axis = all_windows[windows.index(new.axis)]
    if axis in batched:
        if axis != batched[-1]:
            return None
        after = None
        batched = (*all_moved(batched[:-1], axis), len(operand) - 1)
    else:
        if axis in to or axis in inserted:
            return None
        after = windows[_window(inserted, batched, axis)]
        if update[after] != operand[axis]:
            return None
        windows = (*(moved(k, after) for k in windows if k != after), len(update) - 1)
        batched = all_moved(batched, axis)
    changed = numbers._replace(
        update_window_dims=windows,
        inserted_window_dims=all_moved(inserted, axis),
        scatter_dims_to_operand_dims=all_moved(to, axis),
        operand_batching_dims=batched,
    )
    arrays = [x.along(axis), indices.as_given(), new.along(after)]
    return [Held(y, axis) for y in bind(equation, arrays, dimension_numbers=changed)]
