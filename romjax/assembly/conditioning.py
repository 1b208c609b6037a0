"""Masses so different that rounding in the equations of the joints shows in the motion."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.compat import is_outermost
from ..compiling.program import program_once
from ..scene.body.capped import uncapped
from ..system.base import AbstractSystem
from ..system.structure import without_names
from .assembled import groups_of
from .axial_loads import spread

# Masses that differ by less never matter: a pivot of 1e-6 leaves rounding of 2e-10, which is less
# than the share below of any rtol down to 2e-9. And at how many states is looked.
_DIFFERENT, _STATES = 1e6, 3
# The share of rtol that rounding may take, and that of a row of C_q below which it repeats others.
_SHARE, _REPEATED = 0.1, 1e-6


def conditioning_warning(
    system: AbstractSystem,
    t: Float[Array, " k"],
    q: Float[Array, "k n"],
    v: Float[Array, "k n"],
    rtol: float,
) -> str:
    """Return a warning if rounding in the accelerations is no more small against `rtol`.

    It looks at three states of a run of a full or reduced `system`, in its coordinates. The text is
    empty if all is well, and while JAX traces.

    Joints on a body that is lighter than its neighbours by a factor ε give rows of the scaled Schur
    complement that differ by ε only: its least pivot p is about ε, and the multipliers lose ε⁻¹ of
    their digits. Rows that repeat others have tiny pivots too, and are told apart by the rank of
    C_q, which knows no masses. Singular positions pass; what counts is the best state.
    """
    masses = _masses(system) if is_outermost() else np.zeros(0)
    if not masses.size or np.max(masses) < _DIFFERENT * np.min(masses) or not system.full.m:
        return ""
    states = [np.nan_to_num(x) for x in spread(_STATES, t, q, v)]
    pivots, jacobians = (np.asarray(x) for x in _equations(without_names(system), *states))
    least = 0.0
    for own, jacobian in zip(pivots, jacobians, strict=True):
        sizes = np.linalg.norm(jacobian, axis=1, keepdims=True)
        rank = np.linalg.matrix_rank(jacobian / np.where(sizes > 0, sizes, 1), tol=_REPEATED)
        least = max(least, float(np.sort(own)[len(own) - rank])) if rank else least
    rounding = np.finfo(pivots.dtype).eps / least if least > 0 else np.inf
    if rounding <= _SHARE * rtol:
        return ""
    return (
        f"masses differ by a factor of {np.max(masses) / np.min(masses):.0e}, so that rounding in "
        f"the forces of the joints is {rounding:.0e} of them, beside rtol = {rtol:.0e}; weld the "
        "light body to a neighbour, or make it heavier"
    )


def _masses(system: AbstractSystem) -> np.ndarray:
    masses = [getattr(uncapped(group.bodies), "mass", None) for group in groups_of(system)]
    known = [np.ravel(np.asarray(mass)) for mass in masses if isinstance(mass, jax.Array)]
    return np.concatenate(known) if known else np.zeros(0)


@program_once
def _equations(
    system: AbstractSystem, t: Float[Array, " k"], q: Float[Array, "k n"], v: Float[Array, "k n"]
) -> tuple[Float[Array, "k rows"], Float[Array, "k m n"]]:
    """The pivots and C_q of the full system."""

    def at(now: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        state = system.state(*now)
        full = system.full.state(now[0], state.q, state.v)
        return full.kkt().pivots(), full.jacobian()

    both: tuple[Array, Array] = jax.lax.map(at, tuple(jnp.asarray(x) for x in (t, q, v)))
    return both
