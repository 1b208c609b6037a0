"""Which of many cases that are alike run in which group of the tests."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def in_groups(
    cases: Iterable[Any], *, fast: Collection[Any] = (), slow: Collection[Any] = ()
) -> list[Any]:
    """Parameters of a test, in a tuple where it has several: those in `fast` run always, those in
    `slow` with `-m slow`, and all others with `-m exhaustive`.
    """

    def param(case: Any) -> Any:
        values = case if isinstance(case, tuple) else (case,)
        mark = pytest.mark.slow if case in slow else pytest.mark.exhaustive
        return pytest.param(*values, marks=() if case in fast else mark)

    return [param(case) for case in cases]
