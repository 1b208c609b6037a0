"""Step size control: how large errors may be in a motion, of whatever size it is."""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Bool, Float

from ..system.structure import Structure
from .steps import chosen

# What rounding leaves of positions in a step, in units in the last place of the farthest, or of
# these [m, and rad or 1]: zero is as far from the numbers that forces depend on.
_ROUNDING, _NEAREST = 20, (1e-3, 1.0)


class Reach(NamedTuple):
    """How far a motion has got. Pairs are of the positions of bodies [m], and of all other
    coordinates: angles, amplitudes, and those of systems of which no bodies are known.

    - `origin`: from where distances count, the first positions in the chart of the state.
    - `distance`: the largest of them. `speed`: the largest rate.
    - `farthest`: the largest position itself, of which rounding is a share; at least `_NEAREST`.
    """

    origin: Float[Array, " n"]
    distance: Float[Array, "2"]
    speed: Float[Array, "2"]
    farthest: Float[Array, "2"]


class Tolerances(eqx.Module):
    """The errors that the steps of a run may have.

    Given tolerances are atol + rtol |q| in positions, and atol + rtol |v| in velocities.

    Others `follow` the motion, so that one of a micrometre is as accurate as one of a metre, and as
    it is at any distance from the origin. They are rtol max(min(D, 1), |q − q(0)|) + R in
    positions, and rtol max(min(S, 1), |v|) + R / h in velocities, with the largest distance D and
    the largest speed S so far among the positions of bodies [m, m/s], or among all other
    coordinates. R is what rounding leaves of positions, and R / h has as much of an effect in a
    step h.
    """

    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    follow: Bool[Array, ""]
    positions: tuple[bool, ...] = eqx.field(static=True)  # whether coordinates are those of bodies

    @classmethod
    def of(cls, structure: Structure, rtol: Any, atol: Any, follow: Any) -> "Tolerances":
        positions = tuple(structure.is_position.tolist())
        return cls(jnp.asarray(rtol), jnp.asarray(atol), jnp.asarray(follow), positions)

    def start(self, y: Any) -> Reach:
        """Before the first step."""
        q, zero = jax.lax.stop_gradient(y[0]), jnp.zeros(2, y[0].dtype)
        return self.extended(Reach(q, zero, zero, jnp.asarray(_NEAREST, q.dtype)), y)

    def extended(self, reach: Reach, y: Any) -> Reach:
        """With a state in the same chart."""
        q, v, *_ = (jax.lax.stop_gradient(x) for x in y)
        return Reach(
            reach.origin,
            jnp.maximum(reach.distance, self._largest(q - reach.origin)),
            jnp.maximum(reach.speed, self._largest(v)),
            jnp.maximum(reach.farthest, self._largest(q)),
        )

    def errors(
        self, reach: Reach, y: Any, h: Float[Array, ""]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """In positions and velocities, of a step h to or from the state `y`."""
        q, v, *_ = (jax.lax.stop_gradient(x) for x in y)
        rounding = _ROUNDING * jnp.finfo(q.dtype).eps * reach.farthest
        far, fast = (self._each(jnp.minimum(x, 1)) for x in (reach.distance, reach.speed))
        noise = self._each(rounding)
        by_q = self.rtol * jnp.maximum(far, jnp.abs(q - reach.origin)) + noise
        by_v = self.rtol * jnp.maximum(fast, jnp.abs(v)) + noise / h
        return (
            jnp.where(self.follow, by_q, self.atol + self.rtol * jnp.abs(q)),
            jnp.where(self.follow, by_v, self.atol + self.rtol * jnp.abs(v)),
        )

    def largest(
        self, q: Float[Array, "k n"], v: Float[Array, "k n"]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """The largest errors in any of the states of a run, but for rounding in velocities."""
        each = jax.vmap(self.extended, in_axes=(None, 0))(self.start((q[0], v[0])), (q, v))
        reach = jax.tree.map(lambda x: jnp.max(x, axis=0), each)
        errors = jax.vmap(lambda *y: self.errors(reach, y, jnp.asarray(jnp.inf)))(q, v)
        by_q, by_v = (jnp.max(rows, axis=0) for rows in errors)
        return by_q, by_v

    def _largest(self, x: Float[Array, " n"]) -> Float[Array, "2"]:
        """Of a pair."""
        sizes, which = jnp.abs(x), np.array(self.positions, bool)
        both = (jnp.max(sizes, where=own, initial=0.0) for own in (which, ~which))
        return jnp.stack(list(both))

    def _each(self, pair: Float[Array, "2"]) -> Float[Array, " n"]:
        """What of a pair is for each coordinate."""
        own: Array = jnp.where(np.array(self.positions, bool), pair[0], pair[1])
        return own


class StepSizeControl(diffrax.AbstractAdaptiveStepSizeController[Any, Any]):
    """diffrax's control of step sizes, with the tolerances of a motion.

    A step is accepted if the root mean square of the errors of positions and velocities, each
    divided by its tolerance, is below one.
    """

    # What diffrax asks of a control that is adaptive, and hands to root finders.
    rtol: Any
    atol: Any
    norm: Any = eqx.field(static=True)
    tolerances: Tolerances
    steps: diffrax.PIDController  # of a single error, whose tolerance is one

    @classmethod
    def of(cls, tolerances: Tolerances, shortest: Float[Array, ""]) -> "StepSizeControl":
        steps = diffrax.PIDController(rtol=0.0, atol=1.0, dtmin=shortest, force_dtmin=False)
        return cls(tolerances.rtol, tolerances.atol, optimistix.rms_norm, tolerances, steps)

    def wrap(self, direction: Any) -> "StepSizeControl":
        del direction
        return self

    def init(self, terms: Any, t0: Any, t1: Any, y0: Any, dt0: Any, *others: Any) -> Any:
        single = jnp.zeros((), y0[0].dtype)
        first, state = self.steps.init(terms, t0, t1, single, dt0, *others)
        return first, (state, self.tolerances.start(y0))

    def adapt_step_size(
        self,
        t0: Any,
        t1: Any,
        y0: Any,
        y1_candidate: Any,
        args: Any,
        y_error: Any,
        error_order: Any,
        controller_state: Any,
    ) -> Any:
        state, reach = controller_state
        # What is not finite has an error that is not.
        y1 = jax.tree.map(lambda a, b: jnp.where(jnp.isfinite(a), a, b), y1_candidate, y0)
        # The coordinates of another chart do not compare with those before.
        changes = y0[2] != y1[2] if len(y0) == 3 else jnp.zeros((), bool)
        ends = y0, chosen(changes, y0, y1)
        longer = self.tolerances.extended(reach, ends[1])
        allowed = (self.tolerances.errors(longer, y, t1 - t0) for y in ends)
        error = optimistix.rms_norm(
            jax.tree.map(lambda e, a, b: e / jnp.maximum(a, b), tuple(y_error[:2]), *allowed)
        )
        none = jnp.zeros_like(error)
        keep, *others, state, result = self.steps.adapt_step_size(
            t0, t1, none, none, args, error, error_order, state
        )
        longer = longer._replace(origin=jnp.where(changes, y1[0], longer.origin))
        return keep, *others, (state, chosen(jnp.asarray(keep), longer, reach)), result
