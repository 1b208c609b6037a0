"""What follows from the rows of a study, of made-up ones: fronts and when a reduction pays."""

import numpy as np
import pytest

from romjax.study.accuracy.result import Accuracy
from romjax.study.accuracy.row import SINGLE_RUN, Row, with_front

pytestmark = pytest.mark.instant


def row(least, error, **more):
    fields = dict.fromkeys(Row._fields, 0) | {"failure": "", "least": least, "error": error}
    fields |= SINGLE_RUN._asdict()
    return Row(**fields | more)


def test_failures_are_not_on_the_front():
    rows = with_front([row(1.0, np.nan, failure="MAX_STEPS"), row(2.0, 1e-3), row(3.0, 1e-3)])
    assert [r.pareto for r in rows] == [False, True, False]


def test_each_condition_has_its_front():
    rows = with_front([row(1.0, 1e-3), row(2.0, 1e-3, lanes=2), row(2.0, 1e-3)])
    assert [r.pareto for r in rows] == [True, True, False]


def test_break_even():
    """(T_offline + T_compile) / (T_full − T_reduced), of the full model's cheapest run at the same
    error.
    """

    def full(least, error):
        return row(least, error, model="full", formulation="full")

    def runs(*rows):
        return Accuracy(rows, np.zeros(0), (), {}, {}, "", np.nan, {}).break_even(rows[-1])

    reduced = row(2.0, 1e-4, formulation="minimal", offline=30.0, compile=6.0)
    every = full(1.0, 1e-3), full(5.0, 1e-4), full(9.0, 1e-6)
    assert runs(*every, reduced) == (30.0 + 6.0) / (5.0 - 2.0)
    assert reduced.first == 30.0 + 6.0 + 2.0
    assert runs(full(2.0, 1e-6), reduced) == np.inf
    assert runs(full(5.0, 1e-3), reduced) is None
    assert runs(full(1.0, 1e-3)) is None
