"""How wrong a run is, as far as another one tells."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..system.flags import Flag

# Beyond it an estimate says no more than that a run is wrong.
_USABLE = 0.05


class ErrorBar(eqx.Module):
    """The estimated error of a reduced run, which the run that it belongs to has corrected.

    - `error`: of the reduced run, as `Comparison.error`. `by`: what estimates it, in words.
    """

    error: Float[Array, ""]
    by: str = eqx.field(static=True)

    @property
    def flags(self) -> Array:
        """`Flag.ESTIMATE` beyond the errors up to which a run is of use."""
        return jnp.where(self.error <= _USABLE, 0, int(Flag.ESTIMATE))

    def describe(self) -> str:
        """The estimate in words, such as "5.2e-3 estimated (local, 8 modes)"."""
        if not np.all(np.asarray(self.error) <= _USABLE):
            return f"more than {_USABLE:.0%}: not to be used ({self.by})".replace("%", " %")
        digits, power = f"{float(self.error):.1e}".split("e")
        return f"{digits}e{int(power)} estimated ({self.by})"
