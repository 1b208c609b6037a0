"""Whether a run resolves its motion."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..common.arrays import namespace
from ..march.tolerances import Extent, Reach, Tolerances
from ..system.base import AbstractSystem
from ..system.structure import Structure
from .adjoint import has_root_finder
from .settings import Settings
from .trajectory import Trajectory

# The size of a motion that given tolerances resolve, in tolerances: a hundredth of that of a motion
# of a metre, or this number, of which the errors of long runs leave some digits.
_SHARE, _ENOUGH = 1e-2, 1e4
# Where tolerances follow the motion, rounding may make an error of so many tolerances of its size;
# or of a share of it that leaves some digits at any tolerance.
_ALLOWED, _FINE = 100.0, 2e-7
# The usual rounding error of a step, as a share of the largest one.
_USUAL = 0.1
# Displacements and velocities below are rounding errors of a mechanism at rest.
_REST = 1e-10
# No relative tolerance is below, in units in the last place: rounding errors of some steps.
_DIGITS = 500


def is_resolved(
    system: AbstractSystem,
    settings: Settings,
    q0: Float[Array, " n"],
    extent: Extent,
    steps: Int[Array, ""],
    seen: Reach | None,
) -> Bool[Array, ""]:
    """Whether the largest motion is much larger than what the step size control tolerates in it, in
    positions and velocities, by `steps` that were accepted, of a run from q0; true at rest.

    Where tolerances follow the motion, that is but for rounding: errors R of N steps that are
    independent change the rate of a motion as a random walk does, and its phase so by R N^(3/2)
    (D. Brouwer, "On the accumulation of errors in numerical integration", Astron. J. 46, 1937).
    There the motion is what the steps have `seen`, where that is known, and not the outputs alone.

    Where bodies move, their translations count alone: a wheel may turn as far as it will while its
    axle moves by less than the tolerance.
    """
    structure = system.full.structure
    motion = _Motion.of(structure, extent)
    # The root finders of implicit methods ask for tolerances in metres, whatever size motions have:
    # at those of rounding a double pendulum takes 1.2 times the steps, in 1.3 times the time.
    follow = settings.follow & (not has_root_finder(settings.solver))
    numbers = settings.rtol, settings.atol, follow
    tolerances = Tolerances.of(structure.is_position, *numbers, structure.is_state)
    reach = tolerances.reached(q0, extent)
    # For infinite steps: rounding, which short steps enlarge in velocities, is counted below.
    by_q, by_v = tolerances.errors_in_run(reach, extent, jnp.asarray(jnp.inf))
    by_position, by_velocity = motion.distance / by_q, motion.speed / by_v
    share = jnp.where(motion.counts, jnp.minimum(by_position, by_velocity), 0.0)
    # Negated, since of numbers that are not finite nothing is known: that they are not is said.
    given = ~(jnp.max(share) < jnp.minimum(_SHARE / tolerances.rtol, _ENOUGH))
    rounding = _USUAL * tolerances.rounding(reach) * steps**1.5
    allowed = allowed_share(tolerances.rtol)
    distance = motion.distance if seen is None else jnp.maximum(motion.distance, seen.sizes[0])
    followed = jnp.any(motion.counts & ~(rounding > allowed * distance))
    return ~jnp.any(motion.counts) | jnp.where(follow, followed, given)


def allowed_share(rtol: Float[Array, ""]) -> Float[Array, ""]:
    """By what share of its size a motion may be wrong before it has a flag."""
    least = _DIGITS * jnp.finfo(rtol.dtype).eps
    return jnp.maximum(_ALLOWED * jnp.maximum(rtol, least), _FINE)


def finer(structure: Structure, settings: Settings, run: Trajectory) -> Settings:
    """Scale the tolerances, which suit motions of about a metre, to the size of a run's motion."""
    # Under `grad` without `jit` the values of a run are known once derivatives are stopped.
    q, v, rtol = (np.asarray(jax.lax.stop_gradient(x)) for x in (run.q, run.v, settings.rtol))
    every = _Motion.of(structure, Extent.of(q, v))
    motion = _Motion(*(x[every.counts] for x in every))
    if not np.any(motion.distance):
        return settings  # of a run so short that no coordinate has changed
    # Positions and velocities share one atol, so that the smaller of both sizes counts.
    size = np.max(np.minimum(motion.distance, motion.speed))
    # In units of the distance that it moves, a motion far from zero has fewer digits.
    far = np.max(motion.farthest) / np.max(motion.distance)
    dtype = run.q.dtype
    least = _DIGITS * np.finfo(dtype).eps
    tighter = np.maximum(rtol / np.maximum(far, 1.0), least)
    smaller = np.maximum(rtol * np.minimum(size, 1.0), least * np.max(motion.farthest))
    return settings._replace(rtol=tighter.astype(dtype), atol=smaller.astype(dtype))


class _Motion(NamedTuple):
    """The reach of a motion: largest distances of coordinates from zero and the start, and rates.

    Those that count are, of the coordinates that move at all, the translations of bodies, or all if
    none of these moves.
    """

    farthest: Any
    distance: Any
    speed: Any
    counts: Any

    @classmethod
    def of(cls, structure: Structure, extent: Extent) -> "_Motion":
        farthest, distance, speed = extent
        xp, metres = namespace(farthest), structure.is_position
        moves = (distance > _REST * (1 + farthest)) | (speed > _REST)
        counts = moves & (metres | ~xp.any(moves & metres))
        counts = counts & ~structure.is_state if structure.states else counts
        return cls(farthest, distance, speed, counts)
