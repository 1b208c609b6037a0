"""A system in joint coordinates at one state."""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time
from ...linalg.dense import multiply
from ...linalg.indexing import take
from ...linalg.kkt import KKT
from ...system.constraints import ConstraintState
from ...system.reduced import Physical, Reduced
from ...system.state import AbstractState, Energy, Power, Solved
from . import rates
from .bodies import biases, inertias, other_forces
from .inertias import Inertias
from .kinematics import TreeMotion, along, tree_motion
from .later import Later, TreeSystem
from .recursion import accelerations
from .redundant import independent_rows
from .screws import of_parents


@dataclasses.dataclass(frozen=True)
class JointState(AbstractState):
    """The equations of motion of a tree of bodies, each part evaluated on demand.

    Forces are those of the full system, seen by twists of the bodies.
    """

    system: TreeSystem
    t: Time
    z: Reduced
    w: Reduced

    @functools.cached_property
    def motion(self) -> TreeMotion:
        tree = self.system.tree
        return tree_motion(tree, self.z, rates.rates_of(tree, self.z, self.w))

    @functools.cached_property
    def bending(self) -> Float[Array, "bodies modes"]:
        """The rates of the amplitudes."""
        return self._bending(rates.rates_of(self.system.tree, self.z, self.w))

    @functools.cached_property
    def q(self) -> Physical:  # type: ignore[override]
        return self.system.lift.at_frames(self.z, self.motion.frames)

    @functools.cached_property
    def v(self) -> Physical:  # type: ignore[override]
        u = rates.rates_of(self.system.tree, self.z, self.w)
        return self.system.lift.velocity(
            self.z, self.motion, self.motion.twists, self._bending(u), self.w
        )

    def _bending(self, u: Float[Array, " rates"]) -> Float[Array, "bodies modes"]:
        tree = self.system.tree
        return tree.motions.take(u)[:, tree.freedoms :]

    def moved(self, u: Float[Array, " rates"]) -> Float[Array, "bodies size"]:
        """The twists of all bodies and the rates of their amplitudes, for rates u."""
        tree, motion = self.system.tree, self.motion
        own = tree.motions.take(u)
        each = jnp.sum(motion.own * own[:, :, None], axis=1)
        if not tree.modes:
            return along(tree, each)
        bending = own[:, tree.freedoms :]
        each += jnp.sum(motion.outer * of_parents(tree, bending)[:, :, None], axis=1)
        return jnp.concatenate([along(tree, each), bending], axis=1)

    @functools.cached_property
    def _own_inertias(self) -> Inertias:
        """The inertias of the bodies about their frames."""
        return inertias(self.system.full, self.system.tree, self)

    @functools.cached_property
    def _inertia(self) -> Float[Array, "bodies size size"]:
        return self._own_inertias.about(self.motion.arms).matrices()

    @functools.cached_property
    def _bias(self) -> Float[Array, "bodies size"]:
        system = self.system
        return biases(system.full, system.tree, self, self._own_inertias)

    @functools.cached_property
    def others(self) -> Float[Array, " N"] | None:
        """Q of all that neither gravity nor invariants of bodies give, nor acts along z."""
        return other_forces(self.system.full, self.system.tree, self)

    @functools.cached_property
    def _along(self) -> Float[Array, " r"] | None:
        """The forces of effects along z; None without any."""
        along = self.system.along
        return along.forces(self) if along.groups else None

    @functools.cached_property
    def _diagonal(self) -> Float[Array, " r"] | None:
        """Return the diagonal of M beside the bodies: the inertias of rotors, and ones of states;
        None where there are neither.
        """
        count, (_, states, _) = self.system.lift.counters, self.system.tree.states.array
        rotors = count is not None and count.rotors
        if not rotors and not states.size:
            return None
        diagonal = jnp.zeros_like(self.z).at[states].set(1)
        if count is not None and rotors:
            places, inertias = count.masses
            diagonal = diagonal.at[places].add(inertias)
        return diagonal

    @property
    def _state_forces(self) -> Float[Array, " states"]:
        """The derivatives of states."""
        columns = self.system.tree.states.array[0]
        if self.others is None:
            return jnp.zeros(len(columns), self.z.dtype)
        return take(self.others, columns)

    def apply_mass(self, x: Float[Array, "r *k"]) -> Float[Array, "r *k"]:
        if x.ndim == 2:
            return jax.vmap(self.apply_mass, in_axes=1, out_axes=1)(x)
        tree = self.system.tree
        # M x = Nᵀ M_b N x: twists of all bodies by the rates, their momenta, and back by the
        # transpose of the same map.
        moved, back = jax.vjp(self.moved, rates.rates_of(tree, self.z, x))
        (forces,) = back(multiply(self._inertia, moved[:, :, None])[:, :, 0])
        momenta = rates.pull_back(tree, self.z, forces)
        if self._diagonal is not None:
            momenta += self._diagonal * x
        return momenta + rates.of_lengths(tree, self.z, x) if tree.spun.rows else momenta

    def jacobian(self) -> Float[Array, "m r"]:
        """C_z; zero in rows that repeat others where the cut joints hold."""
        rows, rank = self.every_row(), self.system.cut.rank
        if rank is None:
            return rows
        return jnp.where(independent_rows(rows, rank)[:, None], rows, 0)

    def every_row(self) -> Float[Array, "m r"]:
        """C_z with the rows that repeat others."""
        system = self.system
        if not system.m:
            return jnp.zeros((0, system.n), self.z.dtype)
        return system.cut.jacobian(self.t, system.tree, self)

    @functools.cached_property
    def pushed(self) -> Float[Array, "r bodies size"]:
        """The motions that unit rates of z give the bodies."""
        tree = self.system.tree
        unit = jnp.eye(self.system.n, dtype=self.z.dtype)
        each: Array = jax.vmap(lambda x: self.moved(rates.rates_of(tree, self.z, x)))(unit)
        return each

    @functools.cached_property
    def still(self) -> Float[Array, "bodies twist"]:
        """The derivatives of the twists where z̈ is zero."""
        tree, bias = self.system.tree, self.motion.bias
        accelerated = along(tree, bias)
        if not tree.spun.rows:
            return accelerated
        change = rates.change_of_rates(tree, self.z, self.w, jnp.zeros_like(self.z))
        return accelerated + self.moved(change)[:, : bias.shape[1]]

    def constraints(self) -> ConstraintState | None:
        system = self.system
        return system.cut.constraints(self.t, system.tree, self) if system.m else None

    def _pushed(self, x: Reduced) -> Physical:
        """The rates of q for those of z."""
        tree = self.system.tree
        u = rates.rates_of(tree, self.z, x)
        moved = self.moved(u)[:, : self.motion.twists.shape[1]]
        return self.system.lift.velocity(self.z, self.motion, moved, self._bending(u), x)

    def force(self) -> Reduced:
        """M z̈ of the motion that the tree would make without its cut joints, and no rate changing,
        less what that motion asks for.
        """
        tree = self.system.tree
        # At rates w whose derivatives are zero, bodies accelerate by centripetal and Coriolis'
        # terms alone.
        still = rates.second_derivative(tree, self.z, self.w, jnp.zeros(tree.rates, self.z.dtype))
        d = self.motion.twists.shape[1]
        lifted = multiply(self._inertia[:, :, :d], along(tree, self.motion.bias)[:, :, None])
        _, back = jax.vjp(self.moved, jnp.zeros(tree.rates, self.z.dtype))
        (forces,) = back(self._bias + lifted[:, :, 0])
        _, states, _ = tree.states.array
        force = (-rates.pull_back(tree, self.z, forces)).at[states].add(self._state_forces)
        force = force if self._along is None else force + self._along
        return force + self.apply_mass(still) if tree.spun.rows else force

    def energy(self) -> Energy:
        # The slope by virtual work, not through the kinematics again.
        system = self.system
        momentum = self.apply_mass(system.structure.without_states(self.w))

        def both(q: Array) -> tuple[Array, tuple[Array, Array]]:
            stored = system.full.stored(self.t, q)
            return stored[0] + stored[1], stored

        (_, (elastic, potential)), slope = jax.value_and_grad(both, has_aux=True)(self.q)
        (slope,) = jax.vjp(self._pushed, jnp.zeros_like(self.w))[1](slope)
        return Energy(0.5 * multiply(self.w, momentum), elastic, potential, momentum, slope)

    def power(self) -> Power | None:
        return self.system.along.power(self)

    def gaps(self) -> Float[Array, " contacts"] | None:
        return self.system.full.gaps(self.q)

    def limits(self) -> Float[Array, " effects"] | None:
        return self.system.full.limits(self.q)

    def mass(self) -> Float[Array, "r r"]:
        """M, from the motions that unit rates give the bodies."""
        tree, dtype = self.system.tree, self.z.dtype
        unit, pushed = jnp.eye(self.system.n, dtype=dtype), self.pushed
        momenta = multiply(self._inertia[None], pushed[..., None])[..., 0]
        flat = pushed.reshape(len(pushed), -1)
        matrix = multiply(flat, momenta.reshape(len(pushed), -1).T)
        if self._diagonal is not None:
            matrix += jnp.diag(self._diagonal)
        if not tree.spun.rows:
            return matrix
        return matrix + jax.vmap(lambda x: rates.of_lengths(tree, self.z, x))(unit)

    def kkt(self) -> KKT:
        return KKT.dense(self.jacobian(), self.mass())

    def solve(self, gamma: Float[Array, " m"]) -> Solved:
        # Trees alone are solved by the recursion, in a time that grows with the number of bodies.
        if self.system.m:
            return super().solve(gamma)
        tree = self.system.tree
        lumped, pushed = (
            None if x is None else rates.by_rates(tree, x) for x in (self._diagonal, self._along)
        )
        rows, _ = accelerations(tree, self.motion, self._inertia, self._bias, lumped, pushed)
        change = rates.flat(tree, rows, self._state_forces)
        a = rates.second_derivative(tree, self.z, self.w, change)
        later: Any = Later(self.system, jnp.asarray(self.t, self.z.dtype), self.z, self.w)
        return Solved(a, gamma, later)

    def physical_acceleration(self, a: Reduced) -> Physical:
        system, motion = self.system, self.motion
        change = rates.change_of_rates(system.tree, self.z, self.w, a)
        moved = self.moved(change)[:, : motion.twists.shape[1]] + along(system.tree, motion.bias)
        return system.lift.acceleration(self.z, motion, moved, self._bending(change), self.v, a)
