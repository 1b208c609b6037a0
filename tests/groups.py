"""Which of many cases that are alike run in which group of the tests, and which files run first."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest

# Files of the slow and of the fast tests that take longest, the longest first: those that come last
# leave one of two processes without work.
LONGEST = (
    *("long_notebooks", "notebooks", "pages", "compiled", "published", "gallery", "reduce_over"),
    *("capped", "reduce_to", "sensitivities", "gradients", "singular_positions", "cli"),
    *("every_parameter", "commands"),
    *("reduced_models", "events", "local", "ranks", "bases", "minimal", "tables", "results"),
    *("audit", "hyper", "accuracy", "identities", "program_cache", "reduction", "structure"),
)


def longest_first(items: list[pytest.Item]) -> None:
    """Sort tests by their files."""
    places = {f"test_{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


def one_group_each(items: list[pytest.Item]) -> None:
    """Raise UsageError for tests with several marks of groups, such as a mark above `in_groups`."""
    groups = {"instant", "slow", "exhaustive"}
    marked = {item.nodeid: groups & {mark.name for mark in item.iter_markers()} for item in items}
    if several := {name: sorted(marks) for name, marks in marked.items() if len(marks) > 1}:
        told = "\n".join(f"{name}: {', '.join(marks)}" for name, marks in several.items())
        raise pytest.UsageError(f"tests of several groups; leave each one mark:\n{told}")


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
