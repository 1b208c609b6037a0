"""A system at one state: the parts of its equations of motion, each evaluated on demand."""

import abc
import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..linalg.dense import multiply
from ..linalg.implicit import Slopes
from ..linalg.indexing import take
from ..linalg.inverse_mass import InverseMass
from ..linalg.kkt import KKT
from ..linalg.pattern import Pattern
from .constraints import ConstraintState
from .stabilization import Baumgarte


class Energy(NamedTuple):
    """The energy of a motion [J], and its derivatives by the state.

    - `kinetic`: T = ½ vᵀ M v. V of all forces that have one: `elastic`, of bodies that deform, and
      `potential`, of gravity, springs and the like.
    - `momentum` (n,): ∂T/∂v. `slope` (n,): ∂V/∂q.
    """

    kinetic: Float[Array, ""]
    elastic: Float[Array, ""]
    potential: Float[Array, ""]
    momentum: Float[Array, " n"]
    slope: Float[Array, " n"]

    @property
    def total(self) -> Float[Array, ""]:
        """E = T + V."""
        return self.kinetic + self.elastic + self.potential

    def by_coordinates(self, tangent: Float[Array, "n r"]) -> "Energy":
        """Return the energy with derivatives by coordinates z of q(z), `tangent` = ∂q/∂z."""
        momentum, slope = multiply(tangent.T, self.momentum), multiply(tangent.T, self.slope)
        return self._replace(momentum=momentum, slope=slope)


class Power(NamedTuple):
    """The power [W] of the forces that have no potential energy.

    - `dissipation`: of dampers, which take energy: not positive.
    - `supply`: of loads, motors and all others.
    """

    dissipation: Float[Array, ""]
    supply: Float[Array, ""]

    @property
    def total(self) -> Float[Array, ""]:
        return self.dissipation + self.supply


class Solved(NamedTuple):
    """The solution of the equations of motion at one state."""

    acceleration: Float[Array, " n"]
    multipliers: Float[Array, " m"]
    kkt: KKT  # the extended mass matrix, for more right-hand sides


class AbstractState(abc.ABC):
    """M, C_q and Q at one (t, q, v), and the physical motion that the state stands for.

    Quantities that share intermediate results, such as the tangent of a reduced system, share them
    here; what nobody asks for is not traced.
    """

    q: Float[Array, " N"]  # physical coordinates
    v: Float[Array, " N"]  # and their rates

    @abc.abstractmethod
    def apply_mass(self, x: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        """M x, for one or several x."""

    @abc.abstractmethod
    def jacobian(self) -> Float[Array, "m n"]:
        """Constraint Jacobian C_q."""

    @abc.abstractmethod
    def force(self) -> Float[Array, " n"]:
        """Generalized force Q."""

    def slow_force(self) -> Float[Array, " n"]:
        """Q without quadratic velocity forces where the system knows them: all of it at rest."""
        return self.force()

    @abc.abstractmethod
    def energy(self) -> Energy:
        """The energy of the physical motion, with its derivatives in the system's coordinates."""

    @abc.abstractmethod
    def power(self) -> Power | None:
        """The power of all forces that have no potential energy, but for those of the constraints;
        None where there are none.
        """

    def gaps(self) -> Float[Array, " contacts"] | None:
        """Return how far effects that may begin are from that; None where there are none."""
        return None

    def limits(self) -> Float[Array, " effects"] | None:
        """Return numbers that change sign where the laws of effects cease to hold.

        None where all hold everywhere.
        """
        return None

    def has_mass(self) -> Bool[Array, ""] | None:
        """Return whether M is positive definite; None where nobody asks."""
        return None

    def residual(self, a: Float[Array, " n"]) -> Float[Array, " n"]:
        """M a − Q."""
        return self.apply_mass(a) - self.force()

    def slopes(
        self,
        a: Float[Array, " n"],
        multipliers: Float[Array, " m"],
        stabilization: Baumgarte | None,
    ) -> Slopes | None:
        """The derivatives of M a + C_qᵀ λ − Q and C_q a − γ with a and λ held, part by part.

        None where the whole has to be differentiated, or where that is as fast.
        """
        del a, multipliers, stabilization
        return None

    def constraints(self) -> ConstraintState | None:
        """Return C, Ċ, and C̈ without its part C_q a; None where they follow by autodiff."""
        return None

    @abc.abstractmethod
    def kkt(self) -> KKT:
        """The extended mass matrix [[M, C_qᵀ], [C_q, 0]], factored."""

    def solve(self, gamma: Float[Array, " m"]) -> Solved:
        """M a + C_qᵀ λ = Q and C_q a = γ."""
        kkt = self.kkt()
        return Solved(*kkt.solve(self.force(), gamma), kkt)

    @abc.abstractmethod
    def physical_acceleration(self, a: Float[Array, " n"]) -> Float[Array, " N"]:
        """The acceleration of the physical coordinates, for that of the system's own."""


@dataclasses.dataclass(frozen=True)
class FullState(AbstractState):
    """The state of a system whose coordinates are the physical ones.

    - `pattern`: where the blocks sit; `mass_blocks`, `jacobian_blocks`: those of M and of C_q, as
      `KKT` takes them; `force_vector`: Q. Functions, so that only what is asked for is traced.
    - `slow_force_vector`: Q without quadratic velocity forces; None where these are not known.
    - `inverse_mass`: M⁻¹; gives None where it is not known in closed form.
    - `stored`: the elastic and the potential energy as a function of q; `work_rate`: the power of
      the other forces. `contact_gaps`: of all contacts. `effect_limits`: of all effects.
    - `part_slopes`: the derivatives by parts, of a, λ and the stabilisation.
    - `moving`: the velocities of what has kinetic energy; None: all.
    """

    q: Float[Array, " n"]
    v: Float[Array, " n"]
    pattern: Pattern
    mass_blocks: Callable[[], Float[Array, "bodies size *size"]]
    jacobian_blocks: Callable[[], Float[Array, "sides height size"]]
    force_vector: Callable[[], Float[Array, " n"]]
    stored: Callable[[Float[Array, " n"]], tuple[Float[Array, ""], Float[Array, ""]]]
    work_rate: Callable[[], Power | None]
    slow_force_vector: Callable[[], Float[Array, " n"]] | None = None
    inverse_mass: Callable[[], InverseMass | None] = lambda: None
    contact_gaps: Callable[[], Float[Array, " contacts"] | None] = lambda: None
    effect_limits: Callable[[], Float[Array, " effects"] | None] = lambda: None
    part_slopes: Callable[[Array, Array, Baumgarte | None], Slopes | None] = lambda *_: None
    moving: Float[Array, " n"] | None = None

    @functools.cached_property
    def _mass(self) -> Float[Array, "bodies size *size"]:
        return self.mass_blocks()

    def apply_mass(self, x: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        return self.pattern.apply_mass(self._mass, x)

    def jacobian(self) -> Float[Array, "m n"]:
        return self.pattern.dense_jacobian(self.jacobian_blocks())

    def force(self) -> Float[Array, " n"]:
        return self.force_vector()

    def energy(self) -> Energy:
        moving = self.v if self.moving is None else self.moving
        momentum = self.apply_mass(moving)

        def both(q: Array) -> tuple[Array, tuple[Array, Array]]:
            stored = self.stored(q)
            return stored[0] + stored[1], stored

        (_, (elastic, potential)), slope = jax.value_and_grad(both, has_aux=True)(self.q)
        return Energy(0.5 * multiply(moving, momentum), elastic, potential, momentum, slope)

    def slow_force(self) -> Float[Array, " n"]:
        return self.force() if self.slow_force_vector is None else self.slow_force_vector()

    def power(self) -> Power | None:
        return self.work_rate()

    def gaps(self) -> Float[Array, " contacts"] | None:
        return self.contact_gaps()

    def limits(self) -> Float[Array, " effects"] | None:
        return self.effect_limits()

    def has_mass(self) -> Bool[Array, ""]:
        blocks = jax.lax.stop_gradient(self._mass)
        if blocks.ndim == 2:
            return jnp.all(blocks > 0)
        # The factor of a block that is not positive definite has NaN.
        return jnp.all(jnp.isfinite(jnp.linalg.cholesky(blocks)))

    def slopes(
        self,
        a: Float[Array, " n"],
        multipliers: Float[Array, " m"],
        stabilization: Baumgarte | None,
    ) -> Slopes | None:
        return self.part_slopes(a, multipliers, stabilization)

    def kkt(self, free: Float[Array, " n"] | None = None) -> KKT:
        """Return the KKT system of the state.

        With `free`, ones for some coordinates and zeros elsewhere, it is that of motions of only
        those coordinates: all others stay, whatever the constraints ask for.
        """
        sides, mass = self.jacobian_blocks(), self._mass
        if free is None:
            return KKT(self.pattern, mass, sides, self.inverse_mass())
        own = self.pattern.split(free)
        sides *= take(own, self.pattern.bodies)[:, None]
        if mass.ndim == 2:
            return KKT(self.pattern, own * mass + (1 - own), sides)
        ones = jax.vmap(jnp.diag)(1 - own)
        return KKT(self.pattern, own[:, :, None] * mass * own[:, None] + ones, sides)

    def physical_acceleration(self, a: Float[Array, " n"]) -> Float[Array, " n"]:
        return a
