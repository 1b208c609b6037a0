"""Effects with first-order states of their own: controllers, filters, actuators that lag."""

import abc
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import Time, as_jax
from ...common.fields import AbstractClassVar
from ..marker import Poses, Twists, Wrench, Wrenches
from .base import AbstractMarkerEffect


class AbstractStateEffect(AbstractMarkerEffect):
    """An effect with states x' = f(t, x, motion of its markers), which set its wrenches:

        x' = rates(t, x, poses, twists),  wrenches = driven(t, x, poses, twists).

    States are integrated with the motion, by the same steps and tolerances, each relative to its
    own size. A kind sets `states`, their names, and `rates` and `driven`; `units` where they are
    known, and `initial` where they do not begin at zero. Runs have a state as `run["label.name"]`,
    by the label of the effect.
    """

    needs_twists: ClassVar[bool] = True
    states: AbstractClassVar[tuple[str, ...]]

    def initial(self) -> Float[Array, " k"]:
        """The states at the start; zero, unless a kind says otherwise."""
        return as_jax(np.zeros(len(self.states), self.markers[0].point.dtype))

    @abc.abstractmethod
    def rates(
        self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists
    ) -> Float[Array, " k"]:
        """The rates of the states, from the poses and twists of the markers at time t."""

    @abc.abstractmethod
    def driven(self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists) -> Wrenches:
        """Force [N] and torque [N m] on each marker, in their order."""

    def wrenches(self, t: Time, poses: Poses, twists: Twists) -> Wrenches:
        """The wrenches of `driven`, and the rates as forces on the carriers of the states, whose
        poses and twists come after those of the markers.
        """
        states, own = self._told(poses, twists)
        number, zero = len(self.markers), jnp.zeros_like(poses[0].position)
        driven, still = self.driven(t, states, *own), jnp.zeros_like(twists[0].angular_velocity)
        rates = self.rates(t, states, *own) if self.states else ()
        carried = [Wrench(zero.at[0].set(rate), still) for rate in rates]
        idle = [Wrench(zero, still) for _ in own[0][number:]]
        return (*driven[:number], *carried, *idle)

    def power(self, t: Time, poses: Poses, twists: Twists) -> Float[Array, ""]:
        """Power [W] of the wrenches on the markers."""
        states, own = self._told(poses, twists)
        wrenches = self.driven(t, states, *own)
        pairs = zip(wrenches, own[1], strict=False)
        return jnp.asarray(sum(wrench.power(twist) for wrench, twist in pairs))

    def _told(
        self, poses: Poses, twists: Twists
    ) -> tuple[Float[Array, " k"], tuple[Poses, Twists]]:
        """The states, and the poses and twists of the markers, with those of counters of turns."""
        first, number = len(self.markers), len(self.markers) + len(self.states)
        values = [twist.velocity[0] for twist in twists[first:number]]
        # An option of a kind may bring its only state.
        states = jnp.stack(values) if values else jnp.zeros(0, poses[0].position.dtype)
        return states, (poses[:first] + poses[number:], twists[:first] + twists[number:])
