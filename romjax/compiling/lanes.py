"""Batches of runs with the axis of lanes last, so that a processor computes several lanes at once.

What enters a run is marked, and `jax.vmap` says in the mark where it puts the axis of lanes. Before
a program is compiled, all arrays that come of marked ones are held with that axis last.
"""

import functools
from collections.abc import Sequence
from typing import Any

import jax
from jax import lax
from jax._src import core
from jax.extend.core import ClosedJaxpr

from ..common import compat
from . import jaxprs
from .lane_held import Held
from .lane_marks import axes_of_lanes
from .lane_rules import apply

# Fewer lanes are not worth it.
_FEWEST = 8


def held_last(closed: Any) -> Any:
    """A closed jaxpr in which the runs of batches have lanes last; as it is without any.

    A run begins with its marks: what is around it, such as a loop of the user's own, stays.
    """
    jaxpr = closed.jaxpr
    lanes = max(map(_lanes, jaxpr.eqns), default=0)
    if lanes < _FEWEST:
        if all(_lanes(x) < _FEWEST for x in jaxprs.equations(jaxpr)):
            return closed
        changed = [jaxprs.with_inner(x, held_last) for x in jaxpr.eqns]
        return ClosedJaxpr(jaxpr.replace(eqns=changed), closed.consts)
    inside = _Batch(lanes)

    def flat(*arrays: Any) -> list[Any]:
        return [x.as_given() for x in inside.results(closed, [Held(x) for x in arrays])]

    return jax.make_jaxpr(flat)(*closed.in_avals)


def _lanes(equation: Any) -> int:
    """The number of lanes of a marked array, of the outermost batch; zero without any."""
    axes = axes_of_lanes(equation)
    return equation.invars[0].aval.shape[axes[0]] if axes else 0


def _chosen(go_on: Held, new: Any, old: Any) -> Any:
    """A loop's variable after a step that only some lanes take: its first axes are those of the
    condition, of which that of lanes is last in both.
    """
    places = list(range(go_on.array.ndim))
    if go_on.axis is not None:
        places[-1] = new.ndim - 1
    return lax.select(lax.broadcast_in_dim(go_on.array, new.shape, places), new, old)


class _Batch:
    """Evaluates jaxprs for so many lanes."""

    def __init__(self, lanes: int):
        self._lanes = lanes

    def results(self, closed: Any, given: Sequence[Held]) -> list[Held]:
        """The results of a closed jaxpr."""
        jaxpr, known = closed.jaxpr, dict[Any, Held]()

        def read(x: Any) -> Held:
            return Held(x.val) if isinstance(x, core.Literal) else known[x]

        known.update(zip(jaxpr.constvars, map(Held, closed.consts), strict=True))
        known.update(zip(jaxpr.invars, given, strict=True))
        for equation in jaxpr.eqns:
            own = [read(x) for x in equation.invars]
            known.update(zip(equation.outvars, self._of_equation(equation, own), strict=True))
        return [read(x) for x in jaxpr.outvars]

    def _of_equation(self, equation: Any, given: list[Held]) -> list[Held]:
        axes = axes_of_lanes(equation)
        if axes is not None:
            (x,) = given
            is_batch = bool(axes) and x.axis is None and self._is_first(equation.invars[0], axes[0])
            return [Held(x.along(axes[0]), axes[0]) if is_batch else x]
        match equation.primitive.name:
            case "custom_jvp_call" | "custom_vjp_call":
                # Of what is compiled no derivative is taken any more.
                return self.results(equation.params["call_jaxpr"], given)
        if all(x.axis is None for x in given) and not self._has_marks(equation):
            return apply(equation, given)
        match equation.primitive.name:
            case "jit" | "pjit":
                return self.results(equation.params["jaxpr"], given)
            case "while":
                return self._while(equation, given)
            case "scan":
                return self._scan(equation, given)
            case "cond":
                return self._branches(equation, given)
        plain = jaxprs.plain(equation)
        return apply(equation, given) if plain is None else self.results(plain, given)

    def _is_first(self, x: Any, axis: int) -> bool:
        return bool(x.aval.shape[axis] == self._lanes)

    def _has_marks(self, equation: Any) -> bool:
        return any(axes_of_lanes(each) for each in jaxprs.equations_of(equation))

    def _axis(self, x: Any) -> int | None:
        """Where a loop's variable has lanes: `jax.vmap` puts them first there."""
        return 0 if x.aval.ndim and self._is_first(x, 0) else None

    def _along(self, results: Sequence[Held], axes: Sequence[int | None]) -> list[Any]:
        return [x.along(axis) for x, axis in zip(results, axes, strict=True)]

    def _while(self, equation: Any, given: list[Held]) -> list[Held]:
        params = equation.params
        body, condition = params["body_jaxpr"], params["cond_jaxpr"]
        first, second = params["cond_nconsts"], params["cond_nconsts"] + params["body_nconsts"]
        of_condition, of_body, start = given[:first], given[first:second], given[second:]
        axes = [self._axis(x) for x in equation.outvars]
        of_lanes = self._axis(condition.jaxpr.outvars[0])
        if of_lanes is None and condition.out_avals[0].ndim:
            # The condition is that of another batch, whose axes are the first of all variables.
            axes = [None] * len(axes)

        def holds(carry: list[Any]) -> Held:
            """The condition, of each lane where `jax.vmap` has left it to the lowering."""
            (result,) = self.results(condition, [*of_condition, *map(Held, carry, axes)])
            return Held(result.along(of_lanes), of_lanes)

        def step(carry: list[Any]) -> list[Any]:
            new = self._along(self.results(body, [*of_body, *map(Held, carry, axes)]), axes)
            if not condition.out_avals[0].ndim:
                return new
            go_on = holds(carry)
            return [_chosen(go_on, *pair) for pair in zip(new, carry, strict=True)]

        arrays = self._along(start, axes)
        results = lax.while_loop(lambda carry: holds(carry).array.any(), step, arrays)
        return list(map(Held, results, axes))

    def _scan(self, equation: Any, given: list[Held]) -> list[Held]:
        params = equation.params
        first, count = compat.scan_counts(params)
        second = first + count
        fixed, start, rows = given[:first], given[first:second], given[second:]
        axes = [self._axis(x) for x in equation.outvars[:count]]
        # A row has one axis less, the first one.
        rows = [Held(x.as_given()) if x.axis == 0 else x for x in rows]
        of_rows = [None if x.axis is None else x.axis - 1 for x in rows]
        of_results = list[int | None]()

        def step(carry: list[Any], at: list[Any]) -> tuple[list[Any], list[Any]]:
            own = [*fixed, *map(Held, carry, axes), *map(Held, at, of_rows)]
            results = self.results(params["jaxpr"], own)
            of_results[:] = [x.axis for x in results[count:]]
            return self._along(results[:count], axes), [x.array for x in results[count:]]

        settings = {name: params[name] for name in ("length", "reverse", "unroll")}
        arrays = [x.array for x in rows]
        carry, stacked = lax.scan(step, self._along(start, axes), arrays, **settings)
        after = [None if axis is None else axis + 1 for axis in of_results]
        return [*map(Held, carry, axes), *map(Held, stacked, after)]

    def _branches(self, equation: Any, given: list[Held]) -> list[Held]:
        which, *others = given
        axes = [self._axis(x) for x in equation.outvars]

        def branch(inner: Any, *arrays: Any) -> list[Any]:
            own = [Held(x, known.axis) for x, known in zip(arrays, others, strict=True)]
            return self._along(self.results(inner, own), axes)

        ways = [functools.partial(branch, inner) for inner in equation.params["branches"]]
        results = lax.switch(which.array, ways, *(x.array for x in others))
        return list(map(Held, results, axes))
