"""The inverse of the mass matrix of a body in space, in rates by its own axes."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ....linalg import quaternions
from ....linalg.dense import multiply
from ....linalg.inverse_mass import AbstractBodyInverse, Rows

_FRAME = 7  # coordinates x, y, z, and the quaternion


class FrameInverse(AbstractBodyInverse):
    """The inverse mass matrix of a body with the coordinates x, y, z, p and q_f.

    With r = pᵀṗ/s, the rate of the length of p, is ṗ = ½ Gᵀ ω + p r, since G Gᵀ = s I and G p = 0.
    In the rates ẋ, ω and r the inertia of a rigid body is diag(m I, J, μ). Of a flexible one with
    M_ff = I, T = ½ uᵀ R u + uᵀ Y q̇_f + ½ q̇_fᵀ q̇_f, where u is ω, and by the axes of the body the
    velocity of the frame where it couples: in u and η = q̇_f + Yᵀ u that is the sum of
    ½ uᵀ (R − Y Yᵀ) u and ½ ηᵀ η.

    **Arguments:**

    - `lightness`: 1/m, of x, y, z where they do not couple.
    - `core`: inverse inertia of u, (c, c) or its diagonal (c,); c is 3, or 6 where x, y, z couple.
    - `length`: 1/μ, of r.
    - `spin`: ṗ by ω and r.
    - `turn`: A(p) where x, y, z couple; `coupling`: Yᵀ of a flexible body.
    """

    lightness: Float[Array, ""]
    core: Float[Array, "c *c"]
    length: Float[Array, ""]
    spin: Float[Array, "4 4"]
    turn: Float[Array, "3 3"] | None = None
    coupling: Float[Array, "modes c"] | None = None

    def to_rates(self, x: Rows) -> Rows:
        moving, turning, bent = self._parts(x)
        if self.turn is not None:
            moving = multiply(moving, self.turn)
        rates = jnp.concatenate([moving, multiply(turning, self.spin), bent], axis=1)
        if self.coupling is None:
            return rates
        before, own, after = self._around(rates)
        own -= multiply(bent[:, : len(self.coupling)], self.coupling)
        return jnp.concatenate([before, own, after], axis=1)

    def weigh(self, x: Rows) -> Rows:
        before, own, after = self._around(x)
        own = own * self.core[None] if self.core.ndim == 1 else multiply(own, self.core)
        weighed = [before * self.lightness, own, after[:, :1] * self.length, after[:, 1:]]
        return jnp.concatenate(weighed, axis=1)

    def from_rates(self, x: Rows) -> Rows:
        moving, turning, bent = self._parts(x)
        if self.coupling is not None:
            across = multiply(self._around(x)[1], self.coupling.T)
            bent -= jnp.pad(across, ((0, 0), (0, bent.shape[1] - across.shape[1])))
        if self.turn is not None:
            moving = multiply(moving, self.turn.T)
        return jnp.concatenate([moving, multiply(turning, self.spin.T), bent], axis=1)

    def _parts(self, x: Rows) -> tuple[Rows, Rows, Rows]:
        """Columns of x, y, z, of p, and of q_f."""
        return x[:, :3], x[:, 3:_FRAME], x[:, _FRAME:]

    def _around(self, x: Rows) -> tuple[Rows, Rows, Rows]:
        """Columns before the rates u, theirs, and those after, from r on."""
        end = _FRAME - 1
        first = end - self.core.shape[0]
        return x[:, :first], x[:, first:end], x[:, end:]


def spin_of(p: Float[Array, "4"]) -> Float[Array, "4 4"]:
    """[½ Gᵀ, p]: ṗ by the angular velocity by the axes of the body, and by the rate of ln |p|."""
    return jnp.concatenate([0.5 * quaternions.body_matrix(p), p[None]]).T
