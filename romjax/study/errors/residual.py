"""The error of a reduced run by the error equation of the full system, in residual form."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.errors import InputError
from ...common.partition import Partitioned
from ...integrate.derived import EagerQuantities, metric_of
from ...integrate.simulate import simulate
from ...integrate.trajectory import Trajectory
from ...reduction.system import has_charts
from ...system.base import AbstractSystem, beginning_at
from ...system.consistent import project
from ...system.custom import CustomSystem
from ...system.dynamics import constraint_state, gamma, solve
from ...system.reduced import AbstractReducedSystem
from ...system.stabilization import Baumgarte
from ...system.structure import without_names

# Errors are integrated in this unit, so that the step size control sees them beside the motion.
_UNIT = 1e-2
# The rate at which violated constraints decay [rad/s]; the true motion satisfies the stabilised
# equations with any.
DECAY = 20.0
# The rank of the normal equations of balance is told by this relative tolerance: joints may repeat
# each other.
_DEPENDENT = 1e-13
_SWEEPS = 3
# A run in fixed steps has no tolerance; the error beside it takes that of `simulate`.
_USUAL = 1e-6

Physical = Float[Array, " n"]


def by_residual(
    rom: AbstractReducedSystem, run: Trajectory, q: Physical, v: Physical
) -> tuple[Trajectory, AbstractSystem]:
    """The reduced run with the error that is linear in its residual, from the true start q, v.

    With the residuals r₁ = M ã − Q + C_qᵀ λ̃ and r₂ = C̈ + α Ċ + β C at the lifted motion, whose own
    accelerations ã and the multipliers λ̃ that balance its rigid-body rows are held fixed,

        [M C_qᵀ; C_q 0] (ë, ℓ) = −(r₁ + ∂r₁[e, ė], r₂ + ∂r₂[e, ė]),

    one ODE with the reduced run. About the accelerations that the full system would have there it
    grows without bound: the joint forces of a lifted state are wrong. Projected on C = 0.
    """
    full = rom.full
    reason = nonlinear(rom)
    if reason:
        raise InputError(
            f"corrected: {reason}, of which no linear estimate is known; leave out "
            'by="residual", so that a richer model tells.'
        )
    own = rom.starting_at(run.q[0], run.v[0], run.t[0])
    lifted = own.reconstruct(run.t[0], own.q0, own.v0)
    unit = jnp.asarray(_UNIT, run.q.dtype)
    # The error at the start is what the basis misses of the true start.
    first, rate = ((x - y) / unit for x, y in zip((q, v), lifted, strict=True))
    pair = CustomSystem(
        mass=_unit_mass,
        force=_Pair(without_names(own), unit),
        q0=jnp.concatenate([own.q0, first]),
        v0=jnp.concatenate([own.v0, rate]),
    )
    rtol = _USUAL if run.stats.rtol is None else run.stats.rtol
    both = simulate(pair, run.t, rtol=rtol, throw=False, audit=False)
    start = beginning_at(full, q, v)
    q, v = _lifted(without_names(own), unit, both.t, both.q, both.v)
    return with_motion(full, start, both, q, v), start


def nonlinear(rom: AbstractReducedSystem) -> str:
    """The reason why no linear estimate is known of a model's errors, in words; "" if one is."""
    structure = rom.full.structure
    if structure.quaternions:
        return "the mechanism moves in space"
    if structure.contacts:
        return "the mechanism has contacts"
    return "the model changes its chart" if has_charts(rom) else ""


def with_motion(
    full: AbstractSystem,
    start: AbstractSystem,
    run: Trajectory,
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
) -> Trajectory:
    """A run of a full system by what an error adds to it, on the constraints."""
    q, v, violation, multipliers = _on_constraints(without_names(full), run.t, q, v)
    return dataclasses.replace(
        run,
        q=q,
        v=v,
        violation=violation,
        derived=EagerQuantities(multipliers, metric_of(full), Partitioned.of(start)),
        coordinates=full.structure.coordinates,
    )


def _unit_mass(y: Array) -> Array:
    return jnp.eye(len(y), dtype=y.dtype)


class _Pair(eqx.Module):
    """The accelerations of a reduced model and of the error, in a unit, at both states."""

    rom: AbstractReducedSystem
    unit: Float[Array, ""]

    def __call__(self, t: Array, y: Array, rate: Array) -> Array:
        rom, r = self.rom, self.rom.n
        stabilization = Baumgarte.critical(DECAY)
        state = rom.state(t, y[:r], rate[:r])
        # The reduced model moves by its own equations; the error beside it sees that motion, not
        # itself.
        own = state.solve(gamma(rom, t, y[:r], rate[:r], stabilization)).acceleration
        a = state.physical_acceleration(own)
        error = _error(rom.full, t, (state.q, state.v, a), (y[r:], rate[r:]), self.unit)
        return jnp.concatenate([own, error])


def _error(full: AbstractSystem, t: Array, motion: Any, error: Any, unit: Array) -> Array:
    """The acceleration of the error, in the unit, along a lifted motion (q, v, a)."""
    q, v, a = motion
    values, slopes = jax.jvp(residual_about(full, t, q, v, a), (q, v), error)
    force, kept = (-(x / unit + dx) for x, dx in zip(values, slopes, strict=True))
    return full.state(t, q, v).kkt().solve(force, kept)[0]


def residual_about(
    full: AbstractSystem, t: Array, q: Array, v: Array, a: Array
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """The residuals r₁, r₂ as functions of q and v, with the accelerations `a` and the multipliers
    that balance them at (q, v) held fixed.
    """
    stabilization, multipliers = Baumgarte.critical(DECAY), _balance(full, t, q, v, a)

    def residual(q: Array, v: Array) -> tuple[Array, Array]:
        unbalanced = full.state(t, q, v).residual(a)
        if not full.m:
            return unbalanced, jnp.zeros(0, q.dtype)
        reaction = jax.grad(lambda q: multipliers @ full.constraint(t, q))(q)
        along = constraint_state(full, t, q, v, a)
        return unbalanced + reaction, along.curvature + stabilization.term(
            along.violation, along.rate
        )

    return residual


def _balance(full: AbstractSystem, t: Array, q: Array, v: Array, a: Array) -> Array:
    """The multipliers that balance the rigid-body rows, by normal equations: no call of LAPACK's
    decompositions in each stage of a step.
    """
    if not full.m:
        return jnp.zeros(0, q.dtype)
    state, rigid = full.state(t, q, v), jnp.array(full.structure.rigid)
    weight = jnp.where(rigid, 1 / jnp.sqrt(jnp.diagonal(full.mass(q))), 0)
    rows = state.jacobian().T * weight[:, None]
    gram = rows.T @ rows
    # Redundant constraints make the matrix singular; shifted by a little more than rounding, it
    # gives each of them a share.
    gram += _DEPENDENT * jnp.trace(gram) * jnp.eye(full.m, dtype=q.dtype)
    right = -rows.T @ (weight * state.residual(a))
    return jax.scipy.linalg.solve(gram, right, assume_a="pos")


@eqx.filter_jit
def _lifted(
    rom: AbstractReducedSystem, unit: Array, t: Array, y: Array, rate: Array
) -> tuple[Array, Array]:
    """Q and v of the reduced motion and the error, at all outputs."""
    r = rom.n

    def one(t: Array, y: Array, rate: Array) -> tuple[Array, Array]:
        q, v = rom.reconstruct(t, y[:r], rate[:r])
        return q + unit * y[r:], v + unit * rate[r:]

    return jax.vmap(one)(t, y, rate)


@eqx.filter_jit
def _on_constraints(
    full: AbstractSystem, t: Array, q: Array, v: Array
) -> tuple[Array, Array, Array, Array]:
    """Q and v on the constraints, their violation and the multipliers, at all outputs."""

    def one(t: Array, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        if full.m:
            # The lifted error is linear, and leaves the constraints by its square.
            q, v = project(full, t, q, v, _SWEEPS)
        violation = jnp.max(jnp.abs(full.constraint(t, q)), initial=0.0)
        return q, v, violation, solve(full, t, q, v, None).multipliers

    return jax.vmap(one)(t, q, v)
