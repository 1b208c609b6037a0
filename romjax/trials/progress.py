"""Progress messages of a study."""

import sys

from tqdm import tqdm


class Progress:
    """A line for each thing that is known, and under them, in a terminal, what is being done."""

    def __init__(self, shown: bool) -> None:
        # Without a terminal a bar's states would stand one behind the other.
        layout, disabled = "{desc:24} {n_fmt} models, {elapsed}", None if shown else True
        self.shown, self.bar = shown, tqdm(disable=disabled, bar_format=layout)

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        self.bar.close()

    def doing(self, words: str) -> None:
        """Show what is being done now."""
        self.bar.set_description_str(words)

    def tell(self, words: str, models: int = 0) -> None:
        """A line that stays; of so many models."""
        self.bar.update(models)
        if self.shown:
            tqdm.write(words, file=sys.stderr)
