"""Settings of XLA, the compiler behind JAX, that suit small mechanisms on a CPU."""

import os
import warnings

from . import compat


def speed_up_xla() -> None:
    """Make simulations of a few bodies on a CPU compile in 0.7 of the time and run in half of it.

    Adds flags to the environment variable XLA_FLAGS, which XLA reads at JAX's first computation,
    for the whole process; call it before. It does nothing for versions of JAX of which it is
    not tested that they have the flags, and nothing on other devices.

    Warns if JAX has computed something already, since the flags then have no effect.
    """
    before = os.environ.get("XLA_FLAGS", "").split()
    missing = [flag for flag in compat.compiler_flags() if flag not in before]
    if missing and compat.compiler_is_set_up():
        warnings.warn(
            "speed_up_xla: JAX has computed something already, so its compiler is set up and this "
            "has no effect; call it right after importing romjax.",
            stacklevel=2,
        )
        return
    os.environ["XLA_FLAGS"] = " ".join(before + missing)
