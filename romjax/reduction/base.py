"""What all reduced systems share: the way to physical coordinates and back."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..arrays import Time
from ..basis.basis import Basis
from ..linalg.dense import multiply
from ..system.base import AbstractSystem, Frequencies
from .validity import Training


class AbstractReducedSystem(AbstractSystem):
    """A system in few coordinates z, from which those of the full one follow.

    A reduced system is a system: it simulates, compares and differentiates like any other.
    """

    full: eqx.AbstractVar[AbstractSystem]
    training: eqx.AbstractVar[Training | None]  # what it was made of, if anything was simulated
    reason: eqx.AbstractVar[str]  # what was kept, and what freedom is left, in words

    @abc.abstractmethod
    def reduced(
        self, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
        """The reduced coordinates and velocities nearest to physical ones, in the mass metric."""

    @abc.abstractmethod
    def physical_acceleration(
        self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"], a: Float[Array, " r"]
    ) -> Float[Array, " n"]:
        """The acceleration of the physical coordinates where z̈ = a."""

    def lost_energy(
        self, ts: Float[Array, " k"], q: Float[Array, "k r"], v: Float[Array, "k r"]
    ) -> Float[Array, ""] | None:
        """The share of the kinetic energy's range that no force has worked; None if it cannot be
        any, by the way the equations are made.
        """
        return None

    def judge(
        self,
        ts: Float[Array, " k"],
        q: Float[Array, "k r"],
        v: Float[Array, "k r"],
        violation: Float[Array, " k"],
    ) -> Int[Array, ""]:
        if self.training is None:
            return super().judge(ts, q, v, violation)
        return self.training.judge(q, violation, self.lost_energy(ts, q, v))

    @property
    def degrees_of_freedom(self) -> int:
        """Coordinates that the constraints leave free, r − m."""
        return self.n - self.m

    def coordinate_labels(self) -> tuple[str, ...]:
        return self.full.coordinate_labels()

    def physical_metric(self) -> Float[Array, "n n"]:
        return self.full.physical_metric()

    def physical_constraint(self, t: Time, q: Float[Array, " n"]) -> Float[Array, " M"]:
        return self.full.physical_constraint(t, q)

    def frequencies(self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]) -> Frequencies:
        """Its own fastest frequency, and for the stabilisation of its constraints, if it has any,
        the rigid one of the full system: z knows no bodies.
        """
        own = super().frequencies(t, q, v)
        if self.m == 0:
            return own
        full = self.full.frequencies(t, *self.physical(t, q, v))
        return Frequencies(full.rigid, own.fastest)


class AbstractSubspaceSystem(AbstractReducedSystem):
    """A system in the coordinates z of an affine subspace, q = q̄ + Φ z."""

    modes: eqx.AbstractVar[Float[Array, "n r"]]
    offset: eqx.AbstractVar[Float[Array, " n"]]

    def lift(self, q: Float[Array, " r"]) -> Float[Array, " n"]:
        """Physical coordinates q̄ + Φ z."""
        return self.offset + multiply(self.modes, q)

    def mass(self, q: Float[Array, " r"]) -> Float[Array, "r r"]:
        """ΦᵀMΦ."""
        return multiply(self.modes.T, self.full.momentum(self.lift(q), self.modes))

    def force(self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]) -> Float[Array, " r"]:
        """ΦᵀQ."""
        return multiply(self.modes.T, self.full.force(t, self.lift(q), multiply(self.modes, v)))

    def physical(
        self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        return self.lift(q), multiply(self.modes, v)

    def physical_acceleration(
        self, t: Time, q: Float[Array, " r"], v: Float[Array, " r"], a: Float[Array, " r"]
    ) -> Float[Array, " n"]:
        return multiply(self.modes, a)

    def reduced(
        self, q: Float[Array, " n"], v: Float[Array, " n"]
    ) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
        return project(self.full.mass(q), self.modes, q - self.offset, v)


def project(
    metric: Float[Array, "n n"],
    modes: Float[Array, "n r"],
    moved: Float[Array, " n"],
    v: Float[Array, " n"],
) -> tuple[Float[Array, " r"], Float[Array, " r"]]:
    """Coordinates of a displacement and of a velocity in a basis, nearest in a metric."""
    weighted = metric @ modes
    gram = modes.T @ weighted
    z = jnp.linalg.solve(gram, weighted.T @ jnp.stack([moved, v], axis=1))
    return z[:, 0], z[:, 1]


def start(system: AbstractSystem, basis: Basis) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Where a reduced model starts: with the snapshots, or where there are none, as the system."""
    if basis.decomposition is None:
        return system.q0, system.v0
    return basis.snapshots.q[0], basis.snapshots.v[0]
