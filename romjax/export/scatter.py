"""Numbers that go to places of an array, which may depend on the state."""

import functools
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from .arithmetic import Arithmetic
from .arrays import Cells, Operands, start_at, start_within
from .terms import is_known


class Scatter:
    """The operations by their names, as `Arrays` has them."""

    def __init__(self, arithmetic: Arithmetic, run: Callable[..., list[Cells]]) -> None:
        self.arithmetic, self._run = arithmetic, run
        pairs: dict[str, Callable[[Any, Any, str], Any] | None] = {
            "scatter": None,
            "scatter-add": arithmetic.add,
            "scatter-mul": arithmetic.mul,
            "scatter-min": arithmetic.least,
            "scatter-max": arithmetic.largest,
        }
        self.operations: dict[str, Callable[[Operands, Any, list[str]], Any]] = {
            name: functools.partial(self._scatter, pair) for name, pair in pairs.items()
        }

    def _scatter(
        self, pair: Callable[..., Any] | None, x: Operands, p: Any, kinds: list[str]
    ) -> Cells:
        """All updates, one after the other; each is a window that goes to a place as a whole."""
        operand, indices, updates = x
        pair = functools.partial(self._pair, p) if pair is None else pair
        numbers, out = p["dimension_numbers"], operand.copy()
        dropped = {*numbers.inserted_window_dims, *numbers.operand_batching_dims}
        kept = [d for d in range(operand.ndim) if d not in dropped]
        others = [d for d in range(updates.ndim) if d not in numbers.update_window_dims]
        sizes = [1] * operand.ndim
        for d, of in zip(kept, numbers.update_window_dims, strict=True):
            sizes[d] = updates.shape[of]
        last = [full - size for full, size in zip(operand.shape, sizes, strict=True)]
        for batch in np.ndindex(*[updates.shape[d] for d in others]):
            start = start_at(
                batch,
                indices,
                operand.ndim,
                numbers.scatter_dims_to_operand_dims,
                (numbers.operand_batching_dims, numbers.scatter_indices_batching_dims),
            )
            if "CLIP" in str(p["mode"]):
                start = start_within(self.arithmetic, start, operand.shape, sizes)
            window = updates.transpose([*others, *numbers.update_window_dims])[batch]
            window = np.asarray(window, dtype=object).reshape(sizes)
            self._place(out, start, last, window, kinds[0], pair)
        return out

    def _pair(self, p: Any, old: Any, new: Any, kind: str) -> Any:
        """The new number, or what a function makes of the old one."""
        del kind
        function = p["update_jaxpr"]
        if function is None:
            return new
        return self._run(function, p["update_consts"], [old, new])[0].item()

    def _place(
        self,
        out: Cells,
        start: list[Any],
        last: list[int],
        window: Cells,
        kind: str,
        pair: Callable[..., Any],
    ) -> None:
        """A window at a start that lies within; at each where it may be, if the state says so."""
        starts = [
            [at] if is_known(at) and 0 <= at <= most else range(0 if is_known(at) else most + 1)
            for at, most in zip(start, last, strict=True)
        ]
        same = self.arithmetic.elementwise["eq"]
        for place in itertools.product(*starts):
            here: Any = True
            for at, wanted in zip(place, start, strict=True):
                here = self.arithmetic.both(here, same(wanted, at, kind="b"))
            for offset in np.ndindex(window.shape):
                at = tuple(a + b for a, b in zip(place, offset, strict=True))
                new = pair(out[at], window[offset], kind)
                out[at] = self.arithmetic.choose(here, out[at], new, kind)
