"""The balance of energy of a run, and what it says against the run."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...common.described import Described
from ...common.plain import plain
from ...system.flags import Flag
from ...system.state import Power

# What the step size control may do to the energy: so many times the largest error that it accepts
# in one step, and this share of the sum over all steps. Few errors of steps add up with one sign.
_STEPS, _SHARE = 8.0, 0.03
# And so many times the relative tolerance of the work: it comes from the motion within the steps,
# where dense output errs by some twenty tolerances, in positions and in velocities.
_WORK = 200.0
# More than this share of the energy that moves is wrong at any tolerance, and in fixed steps.
_MOST = 0.05
# Rounding errors, in units in the last place of the energy.
_ROUNDING = 1e3


class Momentary(NamedTuple):
    """Energies at one time [J].

    - `energy`: T + V. `kinetic`: T. `least`: what T is at velocities as small as the tolerance.
    - `tolerated`: the error of one step that the step size control accepts, and `rtol`.
    """

    energy: Float[Array, ""]
    kinetic: Float[Array, ""]
    least: Float[Array, ""]
    tolerated: Float[Array, ""]
    rtol: Float[Array, ""]


class EnergyBalance(NamedTuple):
    """The balance of energy E = T + V of a run up to a time.

    - `energy`: E [J]. `imbalance`: what was gained or lost, and not by work [J].
    - `largest`: the largest size of that so far [J]; `time` [s]: when it grew most, and `jump`: by
      how much in that one step [J].
    - `gained`: what dampers gave instead of taking it [J].
    - `extent`: the energy that moves: the largest kinetic energy, or all work that was done,
      whatever its sign [J].
    - `tolerated`: the largest error of one step that the step size control accepts [J], and
      `tolerated_sum`: that of all steps; `tolerated_work`: the relative tolerance of all work.
      `rounding`: of the numbers themselves [J].
    """

    energy: Float[Array, ""]
    imbalance: Float[Array, ""]
    largest: Float[Array, ""]
    jump: Float[Array, ""]
    time: Float[Array, ""]
    gained: Float[Array, ""]
    extent: Float[Array, ""]
    tolerated: Float[Array, ""]
    tolerated_sum: Float[Array, ""]
    tolerated_work: Float[Array, ""]
    rounding: Float[Array, ""]

    @staticmethod
    def arrays() -> dict[str, Described]:
        """Return the descriptions of its arrays in files, by their names."""
        return {
            "energy": Described((), "J", "energy at the end"),
            "imbalance": Described((), "J", "energy gained, and not by work"),
            "largest": Described((), "J", "largest size of the imbalance"),
            "jump": Described((), "J", "largest growth of it in one step"),
            "time": Described((), "s", "when it grew most"),
            "gained": Described((), "J", "energy that dampers gave"),
            "extent": Described((), "J", "energy that moves"),
            "tolerated": Described((), "J", "largest error of a step that was accepted"),
            "tolerated_sum": Described((), "J", "sum of the errors that were accepted"),
            "tolerated_work": Described((), "J", "tolerated error of all work"),
            "rounding": Described((), "J", "rounding error of energies"),
        }

    def __repr__(self) -> str:
        return plain(self)

    def follow(
        self,
        t: Float[Array, ""],
        now: "Momentary",
        work: Power,
    ) -> "EnergyBalance":
        """Return the balance with a step added: the energy at its end, and the work in it [J]."""
        energy, kinetic, least, tolerated, rtol = now
        unit = _ROUNDING * jnp.finfo(energy.dtype).eps
        change = energy - self.energy - work.total
        imbalance = self.imbalance + change
        jumps = jnp.abs(change) > self.jump
        return EnergyBalance(
            energy,
            imbalance,
            jnp.maximum(self.largest, jnp.abs(imbalance)),
            jnp.where(jumps, jnp.abs(change), self.jump),
            jnp.where(jumps, t, self.time),
            self.gained + jnp.maximum(work.dissipation, 0),
            jnp.maximum(self.extent + jnp.abs(work.total), jnp.maximum(kinetic, least)),
            jnp.maximum(self.tolerated, tolerated),
            self.tolerated_sum + tolerated,
            self.tolerated_work + rtol * jnp.abs(work.total),
            jnp.maximum(self.rounding, unit * (kinetic + jnp.abs(energy - kinetic))),
        )

    @property
    def allowed(self) -> Float[Array, ""]:
        """The imbalance that the tolerances explain [J]."""
        explained = _STEPS * self.tolerated + _SHARE * self.tolerated_sum
        explained += _WORK * self.tolerated_work
        # In fixed steps nobody has asked for less.
        explained = jnp.where(self.tolerated > 0, explained, jnp.inf)
        return jnp.minimum(explained, _MOST * self.extent) + self.rounding

    @property
    def flags(self) -> Int[Array, ""]:
        """The reasons not to trust the run, as the number of a `Flag`."""
        flags = (self.largest > self.allowed) * int(Flag.ENERGY)
        return flags + (self.gained > self.allowed) * int(Flag.DISSIPATION)

    def describe(self) -> str:
        """The imbalance in words."""
        return (
            f"by {float(self.largest):.3g} J, {float(self.jump):.3g} J of it in one step at "
            f"t = {float(self.time):.4g} s; the tolerances explain {float(self.allowed):.2g} J"
        )
