"""PID control of the motion of a joint."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...common.arrays import Time, concatenate
from ..fields import Converted, check_numbers, number
from ..limits import check_limits, cut_off
from ..marker import Marker, Poses, Twists, Wrenches
from ..motion import check_motion
from ..signal import AbstractSignal, signal_field
from .along_motion import AbstractMotionEffect
from .base import check_markers
from .state_effect import AbstractStateEffect


class PID(AbstractMotionEffect, AbstractStateEffect):
    """Proportional, integral and derivative control of a motion s of two markers.

    With the error e = target(t) − s, the command is u = P e + z + D e', cut off at `least` and
    `largest`, and the state z is its integral part,

        z' = I e + (cut(u) − u) / T.

    The last term keeps z from winding up while u is cut off, within the tracking time T
    (Åström, Hägglund, PID Controllers, 2nd ed. 1995, section 3.5). An actuator that lags has one
    state more, its force f: τ f' = cut(u) − f; else f = cut(u).

    **Arguments:**

    - `a`, `b`: what it moves, and what carries it.
    - `target`: wanted s over time [rad], [m].
    - `proportional`: P [N m/rad], [N/m]. `integral`: I, per second. `derivative`: D, times seconds.
    - `least`, `largest`: of u [N m], [N]; none unless given.
    - `tracking`: T [s]; the integral part winds up unless it is given.
    - `lag`: τ [s]; none unless given.
    - `start`: of z, and of f where it lags: a force that it holds from the first moment.
    - `motion`: what s is, as in `JointSpring`.
    - `name`: of the controller; "integral" and "force" are its states, `run["name.integral"]`.

    Raises SceneError for times that are not positive.
    """

    a: Marker
    b: Marker
    target: AbstractSignal = signal_field()
    proportional: Converted[Float[Array, ""]] = number(default=0.0)
    integral: Converted[Float[Array, ""]] = number(default=0.0)
    derivative: Converted[Float[Array, ""]] = number(default=0.0)
    least: Converted[Float[Array, ""] | None] = number(default=None)
    largest: Converted[Float[Array, ""] | None] = number(default=None)
    tracking: Converted[Float[Array, ""] | None] = number(default=None)
    lag: Converted[Float[Array, ""] | None] = number(default=None)
    start: Converted[Float[Array, ""]] = number(default=0.0)
    motion: str = eqx.field(static=True, default="angle")
    name: str = eqx.field(static=True, default="")
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def states(self) -> tuple[str, ...]:  # type: ignore[override]
        return ("integral",) if self.lag is None else ("integral", "force")

    def initial(self) -> Float[Array, " k"]:
        return concatenate([self.start] * len(self.states))

    def rates(
        self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists
    ) -> Float[Array, " k"]:
        error, command, cut = self._command(t, states[0], poses, twists)
        rate = self.integral * error
        if self.tracking is not None:
            rate += (cut - command) / self.tracking
        return jnp.stack([rate] if self.lag is None else [rate, (cut - states[1]) / self.lag])

    def driven(self, t: Time, states: Float[Array, " k"], poses: Poses, twists: Twists) -> Wrenches:
        _, _, wrenches = self.displacement(poses, twists)
        lags = self.lag is not None
        return wrenches(states[1] if lags else self._command(t, states[0], poses, twists)[2])

    def _command(
        self, t: Time, integral: Float[Array, ""], poses: Poses, twists: Twists
    ) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
        """The error e, the command u, and what is left of that."""
        value, rate, _ = self.displacement(poses, twists)
        t = jnp.asarray(t, value.dtype)
        target, wanted = jax.jvp(self.target, (t,), (jnp.ones_like(t),))
        error = target - value
        command = self.proportional * error + integral + self.derivative * (wanted - rate())
        return error, command, cut_off(command, self.least, self.largest)

    def check(self) -> None:
        owner = check_markers(self)
        check_motion(owner, self.motion, self.a.dimension)
        self.target.check(owner)
        check_numbers(owner, self, "proportional", "integral", "derivative", "start")
        check_limits(owner, self)
        check_numbers(owner, self, "tracking", "lag", sign="positive")
