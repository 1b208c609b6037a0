"""Operations on numbers that are known, whose results are too."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np


def folded(function: Callable[..., Any], *numbers: Any) -> Any:
    """The result of NumPy for numbers that are known, with infinities and NaN as C has them."""
    with np.errstate(all="ignore"):
        value = function(*numbers)
    return value.item() if isinstance(value, np.generic) else value


def log_gamma(a: float) -> float:
    pole = a <= 0 and float(a).is_integer()
    return math.inf if pole or math.isinf(a) else math.lgamma(a)


def before(a: Any, b: Any) -> bool:
    """Whether a comes before b, where NaN comes last."""
    return bool(a < b or (np.isnan(b) and not np.isnan(a)))
