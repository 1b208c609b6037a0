"""Settings of XLA, the compiler behind JAX, that suit small mechanisms on a CPU."""

import os
import warnings

import jax

_FLAGS = (
    # The newer way of compiling fusions takes twice as long, and loops that hold its results
    # cannot be compiled as one.
    "--xla_cpu_use_fusion_emitters=false",
    # Loops of less than 16 MiB become one function instead of a list of kernels, each of which
    # costs more to start than to run: chains of hundreds of bars, and batches of a thousand lanes.
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=16777216",
    # Sums over small axes stay in the loops around them. A library for large ones would take them
    # out, one call for each: that halves the rate of batches.
    "--xla_cpu_experimental_ynn_fusion_type=",
)


def speed_up_xla() -> None:
    """Make simulations of a few bodies on a CPU compile in 0.7 of the time and run in half of it.

    Adds flags to the environment variable XLA_FLAGS, which XLA reads at JAX's first computation,
    for the whole process; call it before. It does nothing for versions of JAX that are not known
    to know the flags, and nothing to other devices.

    Warns if JAX has computed something already, since the flags then have no effect.
    """
    # XLA ends the process at a flag that it does not know.
    if not (0, 9) <= jax.__version_info__ < (0, 11):
        return
    from jax._src import xla_bridge  # private, and known in these versions

    before = os.environ.get("XLA_FLAGS", "").split()
    missing = [flag for flag in _FLAGS if flag not in before]
    if missing and xla_bridge.backends_are_initialized():
        warnings.warn(
            "speed_up_xla: JAX has computed something already, so its compiler is set up and this "
            "has no effect; call it right after importing romjax.",
            stacklevel=2,
        )
        return
    os.environ["XLA_FLAGS"] = " ".join(before + missing)
