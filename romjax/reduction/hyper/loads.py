"""Effects whose forces in reduced coordinates are linear: exact, whatever their number."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...assembly.part import part
from ...common import compat
from ...compiling.program import program_once
from ...linalg.dense import multiply
from ...system.state import Power
from ..lift.base import Reduced
from ..lift.closed_form import ClosedFormLift

# Slopes that differ by less are equal.
_EQUAL = 1e-9


class LinearLoads(eqx.Module):
    """Q = f − K z − D w of springs and dampers between parts that turn with z, such as hinges'.

    - `energy`: V at z = 0 [J]. `stiffness` K, `damping` D (r, r): symmetric. `force` f (r,).
    """

    energy: Float[Array, ""]
    force: Float[Array, " r"]
    stiffness: Float[Array, "r r"]
    damping: Float[Array, "r r"] | None

    @classmethod
    def of(
        cls, system: AssembledSystem, lift: ClosedFormLift, effects: tuple[int, ...]
    ) -> "LinearLoads | None":
        """Return the loads of the groups of `effects`, which are linear; None if there are none."""
        if not effects:
            return None
        return _linearized(_alone(system, effects), lift, system)

    def at(self, z: Reduced, w: Reduced) -> Reduced:
        """Q."""
        force = self.force - multiply(self.stiffness, z)
        return force if self.damping is None else force - multiply(self.damping, w)

    def stored(self, z: Reduced) -> Float[Array, ""]:
        """V [J]."""
        return self.energy - multiply(z, self.force - 0.5 * multiply(self.stiffness, z))

    def power(self, w: Reduced) -> Power | None:
        """Return the power of the dampers [W]."""
        if self.damping is None:
            return None
        taken = multiply(w, multiply(self.damping, w))
        return Power(-taken, jnp.zeros_like(taken))


def linear_effects(
    system: AssembledSystem, lift: ClosedFormLift, z: Float[Array, "K r"]
) -> tuple[int, ...]:
    """Numbers of the groups of effects that are linear, judged at zero and at all given z.

    Effects that may begin are not, since those z may all lie where they do not act; of the user's
    own, which may act at some of these only, nobody says so.
    """
    # At zero they are linearized; friction that is saturated at all others is not linear there.
    z = jnp.concatenate([jnp.zeros_like(z[:1]), z])
    return tuple(i for i in range(len(system.effects)) if _is_linear(system, lift, i, z))


def _is_linear(system: AssembledSystem, lift: ClosedFormLift, number: int, z: Array) -> bool:
    effects, loads = system.effects[number].effects, _alone(system, (number,))
    q, v = system.q0, system.v0
    if effects.begins or effects.supplies or effects.stores == effects.dissipates:
        return False
    if compat.depends_on_first(loads.force, jnp.zeros((), q.dtype), q, v):
        return False

    stiffness, damping = map(np.asarray, _slopes(loads, lift, system, z))
    used, none = (stiffness, damping) if effects.stores else (damping, stiffness)
    size = np.max(np.abs(used))
    unequal = max(np.max(np.ptp(used, axis=0)), np.max(np.abs(none)))
    return bool(unequal <= _EQUAL * size)


def _alone(system: AssembledSystem, effects: tuple[int, ...]) -> AssembledSystem:
    """The system with these effects and nothing else; all coordinates stay."""
    every = [range(len(group.coordinates.rows)) for group in system.bodies]
    ones = [jnp.ones(len(own), system.q0.dtype) for own in every]
    loads = part(system, every, ones, effects)
    return dataclasses.replace(loads, bodies=(), fields=())


def _force(
    loads: AssembledSystem, lift: ClosedFormLift, system: AssembledSystem, z: Array, w: Array
) -> Float[Array, " r"]:
    motion = lift.motion(system, 0.0, z, w)
    order = _order(system)
    force = loads.force(0.0, motion.q[order], motion.v[order])
    return multiply(motion.tangent[order].T, force)


@program_once
def _slopes(
    loads: AssembledSystem, lift: ClosedFormLift, system: AssembledSystem, z: Float[Array, "K r"]
) -> tuple[Float[Array, "K r r"], Float[Array, "K r r"]]:
    """∂Q/∂z and ∂Q/∂w at several z."""

    def one(z: Array) -> tuple[Array, Array]:
        # Linear laws have the same slopes at any velocities; sin z differs from one z to the next.
        both: tuple[Array, Array] = jax.jacfwd(_force, argnums=(3, 4))(
            loads, lift, system, z, jnp.sin(z)
        )
        return both

    slopes: tuple[Array, Array] = jax.lax.map(one, z)
    return slopes


@program_once
def _linearized(
    loads: AssembledSystem, lift: ClosedFormLift, system: AssembledSystem
) -> LinearLoads:
    zero = jnp.zeros(lift.inner.shape[1], lift.inner.dtype)
    stiffness, damping = jax.jacfwd(_force, argnums=(3, 4))(loads, lift, system, zero, zero)
    return LinearLoads(
        loads.stored(0.0, lift.position(system, 0.0, zero)[_order(system)])[1],
        _force(loads, lift, system, zero, zero),
        -stiffness,
        -damping if any(group.effects.dissipates for group in loads.effects) else None,
    )


def _order(system: AssembledSystem) -> np.ndarray:
    """Coordinates in the order of the groups of bodies."""
    return np.concatenate([group.coordinates.array.reshape(-1) for group in system.bodies])
