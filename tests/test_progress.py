"""Progress of a study in a terminal: the time goes on while a model compiles."""

import io
import time

import pytest

from romjax.trials import progress

pytestmark = pytest.mark.instant
LIMIT = 5.0  # [s] The bar is there at once.


class Terminal(io.StringIO):
    """What is written to a terminal."""

    def isatty(self):
        return True


@pytest.mark.parametrize("kind", [Terminal, io.StringIO])
def test_the_bar_goes_on(kind, monkeypatch):
    """It is written again and again; without a terminal lines stand alone."""
    written = kind()
    monkeypatch.setattr("sys.stderr", written)
    monkeypatch.setattr(progress, "_TICK", 0.01)
    with progress.Progress(True) as told:
        told.doing("full model")
        begin = time.monotonic()
        bar = not told.bar.disable
        while bar and written.getvalue().count("full model") < 4:
            assert time.monotonic() < begin + LIMIT
            time.sleep(0.01)
        told.tell("full: 4 coordinates")
    assert bar == written.isatty()
    assert not told.ticking.is_alive()
    assert "full: 4 coordinates" in written.getvalue()
    assert bar or written.getvalue() == "full: 4 coordinates\n"
