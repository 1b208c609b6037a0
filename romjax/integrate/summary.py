"""A run in words."""

from typing import Any

import numpy as np

from ..system.flags import WORDS
from .status import REMEDIES, Status


def summary(run: Any) -> str:
    """A `Trajectory` in words: of one that failed the status with the remedy; else its steps, how
    well its constraints and its energy hold, what its flags say, and the error that a corrected run
    tells. Of several, how many succeeded, and the first that did not.
    """
    statuses = np.atleast_1d(np.asarray(run.status))
    failed = [i for i, status in enumerate(statuses.tolist()) if status != Status.SUCCESS]
    if run.status.ndim:
        count = f"{len(statuses) - len(failed)} of {len(statuses)} runs succeeded"
        return count + "".join(f"; lane {i}: {_failure(statuses[i])}" for i in failed[:1])
    if failed:
        return _failure(statuses[0])
    steps, method = int(run.stats.num_steps), run.solver_name
    words = [f"success: {steps} steps of {method} to t = {float(run.t[-1]):.4g} s"]
    violation = float(np.max(np.asarray(run.violation), initial=0.0))
    if violation > 0:
        words.append(f"constraints hold to {violation:.1e}")
    balance = run.balance
    if balance is not None and float(balance.extent) > 0:
        share = float(balance.largest) / float(balance.extent)
        words.append(f"energy balances to {share:.1e} of what moves")
    words += [words_of for flag, words_of in WORDS.items() if int(run.flags) & flag]
    if run.bar is not None:
        words.append(run.bar.describe())
    return "; ".join(words)


def _failure(status: Any) -> str:
    known = Status(int(status))
    return f"{known.name}: {REMEDIES[known]}"
