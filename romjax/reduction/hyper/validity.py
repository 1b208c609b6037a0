"""Flags of the result of a hyper-reduced model."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...compiling.program import program_once
from ...system.base import AbstractSystem, AbstractValidity, Run
from ...system.flags import Flag
from ...system.reduced import AbstractReducedSystem, reduced_of
from ...system.state import Energy
from ...system.validity import TrainingBox

# How many times the training's difference of energies is too much.
_TIMES = 10.0
# Where all bodies are sampled, energies differ by rounding: so many units of it are none.
_ROUNDING = 1e3


class SampledBox(AbstractValidity):
    """A training box, and how well the sampled bodies stand for all in it.

    Weights belong to the masses that they were trained with. So the energy of the sampled bodies is
    compared with that of all bodies wherever a run comes out, whatever the numbers are then.

    - `box`: of the snapshots.
    - `difference`: the largest one of both energies in the training, relative to their extent.
    - `error`: estimated error of a run, relative in the energy norm; NaN if nobody estimated it.
    """

    box: TrainingBox
    difference: Float[Array, ""]
    error: Float[Array, ""]

    @classmethod
    def of_training(
        cls, box: TrainingBox, system: AbstractReducedSystem, z: Array, w: Array
    ) -> "SampledBox":
        """Make it from the `box` of the snapshots, and the states z, w (K, r) of the training."""
        return cls(box, _trained(system, z, w), box.error)

    def including(self, run: Run) -> "SampledBox":
        return SampledBox(self.box.including(run), self.difference, self.error)

    @property
    def of_states(self) -> TrainingBox:
        # Energies are compared with their extent, which a single state does not tell.
        return self.box

    def flags(self, system: AbstractSystem, run: Run) -> Int[Array, ""]:
        rom = reduced_of(system)
        assert rom is not None
        least = _ROUNDING * jnp.finfo(run.q.dtype).eps
        allowed = jnp.maximum(_TIMES * self.difference, least)
        worse = _difference(rom, run.t, run.q, run.v) > allowed
        return self.box.flags(system, run) + worse * int(Flag.WEIGHTS)


def _difference(system: AbstractReducedSystem, t: Array, z: Array, w: Array) -> Array:
    """Largest difference of the energies of the sampled bodies and of all at several states,
    relative to their extent: kinetic energies, and changes of potential ones.
    """

    def energies(t: Array, z: Array, w: Array) -> Array:
        sampled, own = system.state(t, z, w), system.full
        every = own.state(t, *system.reconstruct(t, z, w))
        return jnp.stack([_two(sampled.energy()), _two(every.energy())])

    sampled, every = jnp.moveaxis(jax.vmap(energies)(t, z, w), 1, 0)
    # Each has a level of its own of potential energy.
    level = jnp.array([0.0, 1.0])
    sampled, every = (each - (level * each[0])[None] for each in (sampled, every))
    extent = jnp.max(jnp.abs(every))
    error: Array = jnp.max(jnp.abs(sampled - every)) / jnp.where(extent > 0, extent, 1)
    return jax.lax.stop_gradient(error)


def _two(energy: Energy) -> Float[Array, "2"]:
    return jnp.stack([energy.kinetic, energy.elastic + energy.potential])


@program_once
def _trained(system: AbstractReducedSystem, z: Array, w: Array) -> Array:
    return _difference(system, jnp.full(len(z), system.time), z, w)
