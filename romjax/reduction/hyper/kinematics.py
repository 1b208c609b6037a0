"""Poses of a few bodies of a tree as functions of a few of its angles."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from ...compiling.program import program_once
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from ..lift.base import Motion, Reduced
from ..lift.closed_form import ClosedFormLift


class Rotations(eqx.Module):
    """e^{iθ} of all angles as combinations of those of a few: e ≈ T e_K.

    A turn of the whole mechanism multiplies all of them by one number, so that what holds in the
    training holds after any turn.

    - `angles` (J,): numbers of all angles among the independent coordinates; `sampled` (K,).
    - `real`, `imaginary` (J, K): of T.
    """

    angles: tuple[int, ...] = eqx.field(static=True)
    sampled: tuple[int, ...] = eqx.field(static=True)
    real: Float[Array, "J K"]
    imaginary: Float[Array, "J K"]

    @classmethod
    def of(cls, lift: ClosedFormLift, angles: np.ndarray, z: np.ndarray, tol: float) -> "Rotations":
        """Choose rotations by pivoted QR of values and slopes at several z (K, r), up to `tol`."""
        inner = np.asarray(lift.inner)[angles]
        offset = np.asarray(lift.offset)[independent(lift)[angles]]
        rotations = np.exp(1j * (offset + z @ inner.T))
        # The slope of e^{iθ} by z is i ∂θ/∂z times it. The factor i, one for all columns, changes
        # no combination of them; the spread of z makes slopes as large as values.
        slopes = [rotations * own for own in (inner * np.std(z, axis=0)).T]
        r, pivots = scipy.linalg.qr(np.concatenate([rotations, *slopes]), mode="r", pivoting=True)
        size = np.abs(np.diagonal(r))
        count = int(np.sum(size > tol * size[0]))
        weights = np.zeros((len(angles), count), complex)
        weights[pivots] = scipy.linalg.solve_triangular(r[:count, :count], r[:count]).T
        return cls(
            tuple(int(i) for i in angles),
            tuple(int(i) for i in angles[pivots[:count]]),
            jnp.asarray(weights.real),
            jnp.asarray(weights.imag),
        )


class SampledKinematics(eqx.Module):
    """q_B(z) = c + L z + C cos θ_K + S sin θ_K of some bodies, with angles θ_K affine in z.

    - `offset` (p,), `slope` (p, r): c and L. `cosines`, `sines` (p, K): C and S, zero in the rows
      of what is affine in z. `angles` (K,), `turning` (K, r): of θ_K.
    """

    offset: Float[Array, " p"]
    slope: Float[Array, "p r"]
    cosines: Float[Array, "p K"]
    sines: Float[Array, "p K"]
    angles: Float[Array, " K"]
    turning: Float[Array, "K r"]

    def motion(self, z: Reduced, w: Reduced) -> Motion:
        """The motion of the sampled coordinates; see `AbstractLift.motion`."""
        angles, rates = self.angles + multiply(self.turning, z), multiply(self.turning, w)
        c, s, squares = jnp.cos(angles)[None], jnp.sin(angles)[None], (rates**2)[None]
        # Sums over the angles: XLA would compute cosines again for each column of one product.
        waves, slopes = self.cosines * c + self.sines * s, self.sines * c - self.cosines * s
        q = self.offset + multiply(self.slope, z) + jnp.sum(waves, axis=1)
        tangent = self.slope + multiply(slopes, self.turning)
        return Motion(q, multiply(tangent, w), tangent, -jnp.sum(waves * squares, axis=1))


@program_once
def sample_kinematics(
    system: AbstractSystem,
    lift: ClosedFormLift,
    rotations: Rotations,
    columns: tuple[int, ...],
    turned: tuple[tuple[int, int], ...],
) -> "SampledKinematics":
    """Return the kinematics of the coordinates `columns` of q.

    `turned`: those of them that are pairs x, y that turn with angles.

    Positions are affine in all rotations e, so that their slopes by the angles where these are
    zero, i h, hold all there is to know of them: A = h T.
    """
    pairs = np.array(turned, int).reshape(-1, 2)
    r, own = lift.inner.shape[1], np.array(rotations.angles, int)
    turns = np.isin(np.arange(len(lift.inner)), own)
    numbers = independent(lift)
    unit = jnp.eye(len(lift.inner), dtype=lift.inner.dtype)
    free = dataclasses.replace(lift, inner=unit, dual=jnp.asarray(lift.chart.read))
    level = jnp.where(turns, -lift.offset[numbers], 0)
    push: Any
    point, push = jax.linearize(
        lambda s: free.position(system, lift.time, s)[pairs], level
    )  # (bodies, 2)
    along: Any = jax.vmap(push, out_axes=-1)
    all_turn = push(jnp.asarray(turns, level.dtype))
    spread = jnp.zeros((len(rotations.sampled), len(turns)), level.dtype)
    by_real = along(spread.at[:, own].set(rotations.real.T))
    by_imaginary = along(spread.at[:, own].set(rotations.imaginary.T))
    # A slope x + i y is i h times what is pushed: with T = a + i b, A = h T is −i (i h a) + i h b.
    real = by_imaginary[:, 0] + by_real[:, 1]
    imaginary = by_imaginary[:, 1] - by_real[:, 0]
    # All rotations are one here, so that the arms add up to −i times the slope by all angles.
    centre = point - jnp.stack([all_turn[:, 1], -all_turn[:, 0]], axis=1)
    zero, sampled = jnp.zeros(r, level.dtype), np.array(rotations.sampled, int)
    others = jnp.where(turns[:, None], 0, lift.inner)
    none = jnp.zeros((len(columns), len(sampled)), level.dtype)
    at = np.array([columns.index(i) for i in pairs.reshape(-1)], int)

    def position(z: Array) -> Array:
        return lift.position(system, lift.time, z)[np.array(columns, int)]

    def placed(affine: Array, turning: Array) -> Array:
        return affine.at[at].set(turning.reshape(at.size, *affine.shape[1:]))

    slope: Any = jax.jacfwd(position)
    return SampledKinematics(
        placed(position(zero), centre),
        placed(slope(zero), along(others.T)),
        placed(none, jnp.stack([real, imaginary], axis=1)),
        placed(none, jnp.stack([-imaginary, real], axis=1)),
        lift.offset[numbers[sampled]],
        lift.inner[sampled],
    )


def independent(lift: ClosedFormLift) -> np.ndarray:
    """The numbers of the independent coordinates in q."""
    return np.argsort(lift.chart.order)[: len(lift.inner)]
