"""How motions change with the parameters of a box."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ...basis.snapshots import Sensitivity
from ...common.arrays import as_number
from ...common.errors import SimulationError
from ...compiling.program import program
from ...integrate.adjoint import forward_mode
from ...integrate.settings import check_times
from ...integrate.simulate import simulate
from .box import Box


def sensitivities(
    box: Box, ts: ArrayLike, *, rtol: float = 1e-8, solver: Any = None, **parameters: float
) -> list[Sensitivity]:
    """The derivatives of a full run by each parameter of a box, times half of its range.

    They are snapshots beside those of motions, `rj.pod([run, *sensitivities])`. All are computed in
    one run, forwards (Zahr, Farhat 2015, arXiv:1407.7618).

    **Arguments:**

    - `box`: it must make scenes of traced numbers, as `jax.grad` asks. `ts` (k,): times [s].
    - `rtol`, `solver`: as of `simulate`. `parameters`: where; those that are not given are in the
      middle.

    Raises InputError outside of the box, SimulationError if the run fails.
    """
    box.system(**parameters)
    times, where = check_times("sensitivities", ts, jnp.result_type(float)), box.center | parameters
    point = {name: as_number(x, times.dtype) for name, x in where.items()}
    with forward_mode():
        q, v, success = _tangents(box, solver, point, times, as_number(rtol, times.dtype))
    if not bool(success):
        raise SimulationError(f"sensitivities: the run at {where} has failed; simulate it alone.")
    return [Sensitivity(times, q[name], v[name]) for name in box.ranges]


@program
def _tangents(
    box: Box, solver: Any, point: dict[str, Any], times: Float[Array, " k"], rtol: Any
) -> tuple[dict[str, Array], dict[str, Array], Array]:
    """∂q/∂p and ∂v/∂p by parameter, times half of its range, and whether the run has succeeded."""

    def motion(shares: dict[str, Array]) -> tuple[tuple[Array, Array], Array]:
        moved = {name: box.ranges[name].moved(point[name], x) for name, x in shares.items()}
        run = simulate(box.system_anywhere(moved), times, rtol=rtol, solver=solver, throw=False)
        return (run.q, run.v), run.success

    middle = {name: jnp.zeros((), times.dtype) for name in box.ranges}
    (q, v), success = jax.jacfwd(motion, has_aux=True)(middle)
    return q, v, success
