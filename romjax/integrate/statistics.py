"""Numbers about a run: its steps and the settings that it was made with."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..common.described import Described
from ..common.plain import plain
from ..system.stabilization import Stabilization

_COUNTS = ("num_steps", "num_accepted_steps", "num_rejected_steps")


def _count(number: Any) -> Any:
    return number if isinstance(number, jax.Array) else jnp.asarray(number)


class Statistics(eqx.Module):
    """Steps and settings of one run.

    - `num_steps`, `num_accepted_steps`, `num_rejected_steps`: numbers of steps.
    - `rtol`, `atol`: tolerances of the step size control; None for a run in fixed steps. `atol` is
      that of velocities where none was given, since it follows the motion.
    - `fastest_frequency` [rad/s]: of the system at its start; None where the caller has chosen the
      method and the stabilization, so that nobody asked for it.
    - `stabilization`: how the constraints were held, a `Baumgarte`, a `Projection` or None.

    The numbers of steps can also be read as items, `stats["num_steps"]`.
    """

    num_steps: Int[Array, ""] = eqx.field(converter=_count)
    num_accepted_steps: Int[Array, ""] = eqx.field(converter=_count)
    num_rejected_steps: Int[Array, ""] = eqx.field(converter=_count)
    rtol: Float[Array | np.ndarray, ""] | None = None
    atol: Float[Array | np.ndarray, ""] | None = None
    fastest_frequency: Float[Array, ""] | None = None
    stabilization: Stabilization = None

    @staticmethod
    def arrays() -> dict[str, Described]:
        """Return the descriptions of its arrays in files, by their names."""
        return {
            "num_steps": Described((), "1", "steps"),
            "num_accepted_steps": Described((), "1", "steps that were accepted"),
            "num_rejected_steps": Described((), "1", "steps that were rejected"),
            "rtol": Described((), "1", "relative tolerance of the step size control"),
            "atol": Described((), "1", "absolute tolerance of the step size control"),
            "fastest_frequency": Described(
                (), "rad/s", "fastest frequency of the system at its start"
            ),
        }

    def __repr__(self) -> str:
        return plain(self)

    def __getitem__(self, name: str) -> Any:
        if name not in _COUNTS:
            raise KeyError(name)
        return getattr(self, name)

    def __contains__(self, name: object) -> bool:
        return name in _COUNTS

    def get(self, name: str, default: Any = None) -> Any:
        """The number of steps of this name, or `default` where there is none."""
        return getattr(self, name) if name in _COUNTS else default
