"""A run in words."""

from typing import Any

import equinox as eqx
import numpy as np

from ..common.arrays import concrete
from ..system.flags import WORDS, Flag
from .status import REMEDIES, Status

_SHOWN = 4  # coordinates, of which Python's prompt shows the names


def summary(run: Any) -> str:
    """A `Trajectory` in words: of one that failed the status with the remedy; else its steps, how
    well its constraints and its energy hold, what its flags say, and the error that a corrected run
    tells. Of several, how many succeeded, and the first that did not.
    """
    status = np.asarray(run.status)
    failed = np.argwhere(status != Status.SUCCESS)
    if status.ndim:
        count = f"{status.size - len(failed)} of {status.size} runs succeeded"
        for lane in failed[:1].tolist():
            count += f"; lane {', '.join(map(str, lane))}: {_failure(status[tuple(lane)])}"
        return count
    if len(failed):
        return _failure(status)
    steps, method = int(run.stats.num_steps), run.solver_name
    words = [f"success: {steps} steps of {method} to t = {float(run.t[-1]):.4g} s"]
    violation = float(np.max(np.asarray(run.violation), initial=0.0))
    if violation > 0:
        words.append(f"constraints hold to {violation:.1e}")
    balance = run.balance
    if balance is not None and float(balance.extent) > 0:
        share = float(balance.largest) / float(balance.extent)
        words.append(f"energy balances to {share:.1e} of what moves")
    flags = int(run.flags)
    if run.bar is not None:
        flags &= ~Flag.ESTIMATE  # which its own words say
    words += [words_of for flag, words_of in WORDS.items() if flags & flag]
    if run.bar is not None:
        words.append(run.bar.describe())
    return "; ".join(words)


def shown(run: Any) -> str:
    """A `Trajectory` in a line, which Python shows at its prompt; with types where JAX traces."""
    needed = (run.t, run.violation, run.status, run.flags, run.stats.num_steps)
    if not all(eqx.is_array_like(x) and concrete(x) is not None for x in needed):
        return str(eqx.tree_pformat(run))
    labels = run.labels
    names = ", ".join(labels[:_SHOWN]) + ", …" * (len(labels) > _SHOWN)
    size = f"{run.t.shape[-1]} times, {len(labels)} coordinates: {names}"
    return f"Trajectory({size}; {summary(run)})"


def _failure(status: Any) -> str:
    known = Status(int(status))
    return f"{known.name}: {REMEDIES[known]}"
