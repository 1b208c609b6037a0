"""A more accurate motion from those of two caps, and how accurate they are."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from ...common.arrays import concrete
from ...common.errors import InputError
from ...integrate.derived import LazyQuantities
from ...integrate.trajectory import Trajectory
from ...system.base import AbstractSystem, check_system
from ..compare import Comparison, compare


def extrapolate(
    system: AbstractSystem, coarse: Trajectory, fine: Trajectory, ratio: ArrayLike = 2.0
) -> tuple[Trajectory, Comparison]:
    """The motion that two caps tend to, and how far the coarser one is from the finer one.

    The error of a capped scene falls with the square of its cap (Richardson's extrapolation):
    (r² q_fine − q_coarse) / (r² − 1), where one cap is r times the other. The difference, which is
    1 − 1/r² of the error of the coarser run (three quarters for r = 2), estimates it without any
    full run. Runs of `cap`, whose modes start as their loads ask for, gain 9 to 13 times over the
    finer one on ten cart-pendulums with caps of 40 and 80 Hz; where capped modes start otherwise,
    their vibrations fall with the cap only, and it gains 2.6 to 9 times. Where such vibrations are
    wanted, or in impacts, it gains nothing.

    **Arguments:**

    - `system`: without a cap; errors are measured by its mass.
    - `coarse`, `fine`: runs at the same times from the same start. `ratio`: r, of their caps.

    Raises InputError for what is no system, and a ratio that is not above 1; ValueError if times or
    coordinates do not fit.
    """
    check_system("extrapolate", system)
    known = concrete(ratio)
    if known is not None and not known > 1:
        raise InputError(f"extrapolate: ratio = {float(known):g} must be above 1.")
    full = system.full
    # How far both caps are apart, in the metric of the mechanism.
    difference = compare(fine, coarse, full.mass(full.q0))
    # Errors of a cap are as the inverse square of its frequency: Richardson's extrapolation of
    # second order.
    weight = 1 / (jnp.asarray(ratio) ** 2 - 1)

    def tend(fine: Array, coarse: Array) -> Array:
        return fine + weight * (fine - coarse)

    q, v = tend(fine.q, coarse.q), tend(fine.v, coarse.v)
    residuals = jax.vmap(full.constraint)(fine.t, q)
    derived = fine.derived
    if isinstance(derived, LazyQuantities):
        derived = dataclasses.replace(derived, q=q, v=v)
    return dataclasses.replace(
        fine,
        q=q,
        v=v,
        violation=jnp.max(jnp.abs(residuals), axis=1, initial=0.0),
        derived=derived,
        dense=None,
        states=None,
    ), difference
