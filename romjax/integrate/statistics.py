"""Numbers about a run: its steps and the settings that it was made with."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..common.plain import plain
from ..deprecated import warn_once
from ..system.stabilization import Baumgarte, Stabilization

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

    def __repr__(self) -> str:
        return plain(self)

    def __getitem__(self, name: str) -> Any:
        items = self._items()
        if name not in items:
            raise KeyError(name)
        if name not in _COUNTS:
            inner = "stabilization." if name in ("alpha", "beta") else ""
            warn_once(f'Trajectory.stats["{name}"]', f"Trajectory.stats.{inner}{name}")
        return items[name]

    def __contains__(self, name: object) -> bool:
        return name in self._items()

    def get(self, name: str, default: Any = None) -> Any:
        """The item of this name, or `default` where the run has none."""
        try:
            return self[name]
        except KeyError:
            return default

    def _items(self) -> dict[str, Any]:
        """What was in `stats` when it was a dict: only what applies to the run."""
        names = (*_COUNTS, "rtol", "atol", "fastest_frequency")
        items = {name: getattr(self, name) for name in names}
        if isinstance(self.stabilization, Baumgarte):
            items |= {"alpha": self.stabilization.alpha, "beta": self.stabilization.beta}
        return {name: value for name, value in items.items() if value is not None}
