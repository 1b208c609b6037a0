"""The kinetic energy of free bodies by twists and amplitudes."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import twists


class Inertias(NamedTuple):
    """The kinetic energy of bodies by their angular velocities, velocities and amplitudes:

        T = ½ m v·v + v·(ω × h) + ½ ωᵀ J ω + v·S η + ωᵀ H η + ½ ηᵀ M η.

    By the inertial axes, about the frames of the bodies, or any other point that moves with each.

    - `mass` (bodies,), `arm` h (bodies, d), None where it is zero.
    - `turning` J (bodies, spins, spins).
    - `sliding` Sᵀ (bodies, modes, d), `spinning` Hᵀ (bodies, modes, spins), `modal` M.
    """

    mass: Float[Array, " bodies"]
    arm: Float[Array, "bodies d"] | None
    turning: Float[Array, "bodies spins spins"]
    sliding: Float[Array, "bodies modes d"]
    spinning: Float[Array, "bodies modes spins"]
    modal: Float[Array, "bodies modes modes"]

    def with_arm(self) -> "Inertias":
        """The same with h where it is zero."""
        if self.arm is not None:
            return self
        d = self.sliding.shape[2]
        return self._replace(arm=jnp.zeros((len(self.mass), d), self.mass.dtype))

    def about(self, arms: Float[Array, "bodies d"]) -> "Inertias":
        """The same about points from which the frames are at `arms`: v of a frame is v + ω × a."""
        moved, turning = self.mass[:, None] * arms, self.turning
        # ½ m |ω × a|² and (ω × a)·(ω × h) join ½ ωᵀ J ω, and m a joins h.
        if self.arm is not None:
            turning, moved = turning + _parallel(self.arm, arms), moved + self.arm
        turning = turning + _parallel(arms, moved)
        spinning = self.spinning
        if spinning.shape[1]:
            # (ω × a)·S η = ω·(a × S η).
            spinning = spinning + twists.moment(arms[:, None], self.sliding)
        return self._replace(arm=moved, turning=turning, spinning=spinning)

    def matrices(self) -> Float[Array, "bodies size size"]:
        """The matrices of T by (ω, v, η)."""
        assert self.arm is not None
        d = self.arm.shape[1]
        unit = np.eye(d, dtype=self.mass.dtype)[None]
        moving = self.mass[:, None, None] * unit
        aside = _columns(self.arm)
        across = jnp.swapaxes(aside, 1, 2)
        rigid = [
            jnp.concatenate([self.turning, aside], axis=2),
            jnp.concatenate([across, moving], axis=2),
        ]
        if not self.modal.shape[1]:
            return jnp.concatenate(rigid, axis=1)
        bent = jnp.concatenate([self.spinning, self.sliding], axis=2)
        top = jnp.concatenate(rigid, axis=1)
        upper = jnp.concatenate([top, jnp.swapaxes(bent, 1, 2)], axis=2)
        lower = jnp.concatenate([bent, self.modal], axis=2)
        return jnp.concatenate([upper, lower], axis=1)


def _columns(arm: Float[Array, "bodies d"]) -> Float[Array, "bodies spins d"]:
    """The matrix A with ω·A v = v·(ω × arm), rows by ω."""
    if arm.shape[1] == 2:
        return twists.perpendicular(arm)[:, None]
    (x, y, z), none = (arm[:, i] for i in range(3)), jnp.zeros_like(arm[:, 0])
    entries = [none, -z, y, z, none, -x, -y, x, none]
    return jnp.stack(entries, axis=-1).reshape(-1, 3, 3)


def _parallel(first: Array, second: Array) -> Float[Array, "bodies spins spins"]:
    """Return the share of a moment of inertia that ω × `first` and ω × `second` have."""
    dot = jnp.sum(first * second, axis=1)[:, None, None]
    if first.shape[1] == 2:
        return dot
    unit = np.eye(3, dtype=first.dtype)[None]
    return dot * unit - second[:, :, None] * first[:, None, :]
