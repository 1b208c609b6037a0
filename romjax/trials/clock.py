"""The time that a search has."""

import time
from typing import Any

import numpy as np


class Clock:
    """The processor's time that there is to `spend` [s]; `with clock:` measures a step of it."""

    def __init__(self, spend: float) -> None:
        self.deadline, self.begin = time.process_time() + spend, 0.0
        self.taken = list[float]()

    def __enter__(self) -> None:
        self.begin = time.process_time()

    def __exit__(self, *_: Any) -> None:
        self.taken.append(time.process_time() - self.begin)

    def has_time(self, known: bool) -> bool:
        """Whether another step is likely to come to its end: it takes as long as others did, or
        hardly anything where its programs are `known`.
        """
        expected = 0.0 if known else float(np.mean(self.taken or [0.0]))
        return time.process_time() + expected <= self.deadline
