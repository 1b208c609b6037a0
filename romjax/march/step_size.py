"""Step size control by the tolerances of a motion."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix
from jaxtyping import Array, Float

from .steps import chosen
from .tolerances import Tolerances, in_one_chart, next_origin


class StepSizeControl(diffrax.AbstractAdaptiveStepSizeController[Any, Any]):
    """diffrax's control of step sizes, with the tolerances of a motion.

    A step is accepted if the root mean square of the errors of positions and velocities, each
    divided by its tolerance, is below one.
    """

    # Diffrax asks adaptive controls for these, and hands them to root finders.
    rtol: Any
    atol: Any
    norm: Any = eqx.field(static=True)
    tolerances: Tolerances
    steps: diffrax.PIDController  # of a single error, whose tolerance is one

    @classmethod
    def of(cls, tolerances: Tolerances, shortest: Float[Array, ""]) -> "StepSizeControl":
        # A step that would have to be shorter than the least one ends the run.
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
        # States that are not finite are replaced here, since their errors are not finite either.
        y1 = jax.tree.map(lambda a, b: jnp.where(jnp.isfinite(a), a, b), y1_candidate, y0)
        end = in_one_chart(y0, y1)
        longer = self.tolerances.extended(reach, end)
        q, v = (jnp.stack(pair) for pair in zip(y0[:2], end[:2], strict=True))
        by_q, by_v = self.tolerances.errors(longer, q, v, t1 - t0)
        # Each error in units of what is allowed of it, so that one control of a single number with
        # the tolerance one does.
        error = optimistix.rms_norm((y_error[0] / by_q, y_error[1] / by_v))
        none = jnp.zeros_like(error)
        keep, *others, state, result = self.steps.adapt_step_size(
            t0, t1, none, none, args, error, error_order, state
        )
        # How far the motion got counts only for steps that are kept.
        after = longer._replace(origin=next_origin(longer, y0, y1))
        return keep, *others, (state, chosen(jnp.asarray(keep), after, reach)), result
