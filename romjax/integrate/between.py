"""The motion within a step, by the methods whose own dense output is of a lower order than they."""

from collections.abc import Callable
from typing import Any

import diffrax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .whole_implicit import Still

State = tuple[Float[Array, " n"], Float[Array, " n"]]

# Methods of a lower order are served by diffrax's cubic polynomial, whose error goes with h⁴.
_FIFTH = 5


class QuinticInterpolation(diffrax.AbstractLocalInterpolation):
    r"""Dense output of order 5 for q and 4 for v = q', by a quintic Hermite polynomial.

    It takes $q$, $v$ and $a$ at both ends of a step, which (q, v)' = (v, a) has without another
    evaluation; the error of $q$ is $h^6 q^{(6)} / 46080$ at most.
    """

    t0: Any  # type: ignore[misc]
    t1: Any  # type: ignore[misc]
    y0: State
    y1: State
    k: State  # stages, the first and the last at the ends of the step

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> State:
        del left
        if t1 is not None:
            (q0, v0), (q1, v1) = self.evaluate(t0), self.evaluate(t1)
            return q1 - q0, v1 - v0
        (q0, v0), (q1, v1), (_, k) = self.y0, self.y1, self.k
        h = self.t1 - self.t0
        x = (jnp.where(h == 0, 0.0, (t0 - self.t0) / jnp.where(h == 0, 1.0, h))).astype(q0.dtype)
        h = h.astype(q0.dtype)
        # Mean velocity less that at the start, and the change of velocity, less those of constant
        # acceleration; then coefficients of x³, x⁴ and x⁵ in (q − q0)/h − v0 x − k0 x²/2.
        first, last = k[0], k[-1]
        mean = jnp.where(h == 0, 0.0, (q1 - q0) / jnp.where(h == 0, 1.0, h)) - v0 - first / 2
        change, bend = v1 - v0 - first, last - first
        # Their conditions at x = 1 are c₃ + c₄ + c₅ = mean, 3 c₃ + 4 c₄ + 5 c₅ = change, and
        # 6 c₃ + 12 c₄ + 20 c₅ = bend.
        c3 = 10 * mean - 4 * change + bend / 2
        c4 = -15 * mean + 7 * change - bend
        c5 = 6 * mean - 3 * change + bend / 2
        q = q0 + h * x * (v0 + x * (first / 2 + x * (c3 + x * (c4 + x * c5))))
        v = v0 + x * (first + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))
        # The ends are those of the step, to the last digit.
        return jnp.where(x == 1, q1, q), jnp.where(x == 1, v1, v)


def interpolation_of(
    solver: diffrax.AbstractSolver[Any],
) -> Callable[..., diffrax.AbstractLocalInterpolation]:
    """Return the dense output of a method for (q, v)' = (v, a): its own, but the quintic one for
    methods of order five and more that have diffrax's cubic polynomial (`diffrax.Kvaerno5`).
    """
    own: Callable[..., diffrax.AbstractLocalInterpolation] = solver.interpolation_cls
    if own != diffrax.ThirdOrderHermitePolynomialInterpolation.from_k:
        return own
    order = solver.order(Still())
    return own if order is None or order < _FIFTH else QuinticInterpolation
