"""The order in which a study of accuracy tries models and methods."""

import collections
import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import diffrax
import numpy as np

from ...integrate.default import default_method, start_frequencies
from .configuration import Configuration
from .model import Model
from .row import FULL, with_front
from .search import rows_of


def methods_for(
    model: Model, methods: Sequence[diffrax.AbstractSolver[Any]], ts: Any
) -> list[diffrax.AbstractSolver[Any]]:
    """The methods, with that first which `simulate` would choose."""
    system = model.system
    fastest = start_frequencies(system, ts, system.q0, system.v0)
    chosen = type(default_method(system, ts, None, fastest).solver)
    return sorted(methods, key=lambda method: type(method) is not chosen)


def queue(
    full: Model,
    others: Sequence[diffrax.AbstractSolver[Any]],
    models: Iterable[Model],
    methods: Sequence[diffrax.AbstractSolver[Any]],
    ts: Any,
) -> Iterator[tuple[Model, diffrax.AbstractSolver[Any]]]:
    """Each model by the method that `simulate` would choose, then by the others; the full model
    among the first, for all else is measured by it.
    """
    later = [(full, method) for method in others]
    for model in models:
        first, *others = methods_for(model, methods, ts)
        yield model, first
        later += [(model, method) for method in others]
        if later and later[0][0] is full:
            yield later.pop(0)
    yield from later


def promising(configurations: list[Configuration]) -> list[Configuration]:
    """Return the configurations on the front, and on that of the full model alone, by turns.

    What has most digits of a front comes first.
    """
    fronts = []
    full = [one for one in configurations if one.model.name == FULL]
    for group in (configurations, full):
        owners = [one for one in group for _ in one.outcomes]
        digits = collections.Counter[Configuration]()
        for owner, row in zip(owners, with_front(rows_of(group)), strict=True):
            if row.pareto:
                digits[owner] -= np.log10(max(row.error, np.finfo(float).tiny))
        fronts.append([one for one, _ in digits.most_common()])
    turns = itertools.chain.from_iterable(itertools.zip_longest(*fronts))
    return list(dict.fromkeys(one for one in turns if one))
