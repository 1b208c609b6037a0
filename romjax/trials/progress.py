"""Progress messages of a study."""

import sys
import textwrap
import threading

from tqdm import tqdm

# [s] A model may compile for half a minute: the time that has passed goes on meanwhile.
_TICK = 1.0
_WIDTH = 80  # of lines


class Progress:
    """A line for each thing that is known, and under them, in a terminal, what is being done and
    for how long.
    """

    def __init__(self, shown: bool) -> None:
        # Without a terminal a bar's states would stand one behind the other.
        layout, disabled = "{desc:24} {n_fmt} models, {elapsed}", None if shown else True
        self.shown, self.bar = shown, tqdm(disable=disabled, bar_format=layout)

        self.ended = threading.Event()
        self.ticking = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self) -> "Progress":
        if not self.bar.disable:
            self.ticking.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        if self.ticking.is_alive():
            self.ticking.join()
        self.bar.close()

    def _tick(self) -> None:
        while not self.ended.wait(_TICK):
            self.bar.refresh()

    def doing(self, words: str) -> None:
        """Show what is being done now."""
        self.bar.set_description_str(words)

    def tell(self, words: str, models: int = 0) -> None:
        """A line that stays; of so many models."""
        self.bar.update(models)
        if self.shown:
            tqdm.write(textwrap.fill(words, _WIDTH, subsequent_indent="  "), file=sys.stderr)
