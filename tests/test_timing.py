"""What the time of calls is: that of the processor, or of the device that works."""

import itertools
import time
import types

import jax
import numpy as np
import pytest
from comparison import assert_close
from tolerances import IDENTITY

from romjax.study import timing

pytestmark = pytest.mark.instant
# Of two calls in turn, twice for their least times and then in eight rounds, of which the first
# five seem to agree.
NEAR_BY_CHANCE = tuple(np.repeat([1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 2.0, 2.0, 0.5, 2.0], 2))


class Machine:
    """Clocks of a machine that gives a `share` of itself, and go on while it works; by each call in
    turn for one of `paces` as long.
    """

    def __init__(self, share, paces=(1.0,)):
        self.share, self.work, self.passed = share, 0.0, 0.0
        self.paces = itertools.cycle(paces)

    def call(self, work):
        """A function that works so long [s], and counts its calls."""

        def function():
            function.count += 1
            taken = work * next(self.paces)
            self.work += taken
            self.passed += taken / self.share

        function.count = 0
        return function

    def clocks(self):
        return types.SimpleNamespace(
            process_time=lambda: self.work, perf_counter=lambda: self.passed
        )


@pytest.mark.parametrize("share", [1.0, 0.1])
@pytest.mark.parametrize(("paces", "rounds"), [((1.0,), 6), (NEAR_BY_CHANCE, 8)])
def test_as_many_rounds_on_a_busy_machine(share, paces, rounds, monkeypatch):
    """What is spent is work: two calls for the least of once, and rounds of turns, eight by their
    least times, or as many as agree twice.
    """
    machine = Machine(share, paces)
    monkeypatch.setattr(timing, "time", machine.clocks())
    calls = [machine.call(0.1), machine.call(0.1)]
    found = timing.alternating(calls, 1.6)
    assert [call.count for call in calls] == [2 + rounds, 2 + rounds]
    if len(paces) == 1:
        assert_close(found.times, np.array([0.1, 0.1]), IDENTITY)
        assert_close(found.speed_ups, np.array([1.0, 1.0]), IDENTITY)


def test_short_calls_are_repeated(monkeypatch):
    machine = Machine(1.0)
    monkeypatch.setattr(timing, "time", machine.clocks())
    calls = [machine.call(0.1), machine.call(0.001)]
    found = timing.alternating(calls, 1.25)
    assert [call.count for call in calls] == [2 + 6, 2 + 6 * 10]
    assert_close(found.times, np.array([0.1, 0.001]), IDENTITY)
    assert_close(found.speed_ups, np.array([1.0, 100.0]), IDENTITY)


@pytest.mark.parametrize("backend", ["cpu", "gpu"])
def test_the_work_of_a_device_is_counted(backend, monkeypatch):
    """Of a device the processor sees nothing, but that time passes."""
    monkeypatch.setattr(jax, "default_backend", lambda: backend)
    begin = time.process_time()
    _, found = timing.worked(lambda: time.sleep(0.05))
    assert (found >= 0.05) if backend == "gpu" else (found <= time.process_time() - begin)
