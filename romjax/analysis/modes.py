"""Natural frequencies, damping ratios and modes of a mechanism."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Complex, Float

from ..assembly.linear_bodies import warn_of_linear_bodies
from ..assembly.standing import standing
from ..common.arrays import Vector, as_array, concrete
from ..common.checks import as_time, check_finite, check_shape
from ..common.compat import is_outermost
from ..common.errors import InputError
from ..common.extras import data_frame
from ..common.partition import detached
from ..compiling.program import program_once
from ..system.base import AbstractSystem, check_system, refuse_states
from .imbalance import Imbalance, imbalance_of, is_needed, warn_of_imbalance
from .independent import check_turn, independent_constraints
from .tangent import refuse_clocks, refuse_slips, tangent_of
from .turning import turn

# What eigenvalues are rounded by, relative to the largest one: those that are zero twice, of free
# motions, are the roots of rounding errors.
_ROUNDED = 1e-7


class Modes(NamedTuple):
    """The modes of a mechanism with d degrees of freedom.

    - `frequencies` (d,): |s| of each pair of eigenvalues s [rad/s], ascending: of an undamped mode
      its natural frequency; √|s₁ s₂| of two real ones.
    - `damping` (d,): ratios, −Re s / |s|; above one for two real eigenvalues.
    - `values` (2d,): all eigenvalues [1/s], in ascending size.
    - `shapes` (n, d): displacement of the system's coordinates in each mode, complex, of unit
      length in the mass metric.
    - `is_stable`: whether no motion grows exponentially.
    - `at` (n,): the configuration that they are motions about, and `t` the time of it [s].
    """

    frequencies: Float[Array, " d"]
    damping: Float[Array, " d"]
    values: Complex[Array, " two_d"]
    shapes: Complex[Array, "n d"]
    is_stable: Bool[Array, ""]
    at: Float[Array, " n"]
    t: Float[ArrayLike, ""] = 0.0

    def table(self) -> Any:
        """One row for each mode as a pandas data frame (extra `study`): `frequency` [Hz], the
        damping `ratio`, and the `period` [s].
        """
        frequency = np.asarray(self.frequencies) / (2 * np.pi)
        with np.errstate(divide="ignore"):  # of free motions
            period = 1 / frequency
        rows = {"frequency": frequency, "ratio": np.asarray(self.damping), "period": period}
        return data_frame("Modes.table", rows, "the numbers are in .frequencies and .damping")


def modes(
    system: AbstractSystem,
    at: Vector | None = None,
    *,
    v: Vector | None = None,
    t: ArrayLike = 0.0,
    turning: ArrayLike = 0.0,
) -> Modes:
    """The modes of small motions of a mechanism on the tangent space of its constraints.

    Differentiable in both modes with respect to all numbers of the system where eigenvalues do not
    repeat, and batchable; by first-order perturbation, ds = (lᵀ dA r) / (lᵀ r).

    **Arguments:**

    - `system`: full, reduced or a `CustomSystem`.
    - `at` (n,): where, an equilibrium such as `equilibrium(system)`; the start unless given.
    - `v` (n,): its velocity, such as `v=system.v0` at the start; unless given, the mechanism is at
      rest, and drives stand where they are at time `t` [s]. With a velocity, of zeros too, they
      move.
    - `turning`: angular velocity Ω [rad/s] at which the whole mechanism turns about the origin,
      steadily, as seen from a frame that turns with it; instead of `v`. In space about z, or a
      vector (3,). Modes are those in that frame, such as flap, lead-lag and whirl: with gyroscopic
      forces and centrifugal stiffening.

    Warns where the state is not in balance and the frequencies depend on it, unless `v` is given.
    Raises InputError for a wrong shape, a state that the constraints contradict, effects with
    first-order states, or for `turning` of a system without bodies or with a drive that moves at
    another rate.
    """
    check_system("modes", system)
    remedy = "have no frequency; take the eigenvalues of romjax.linearize(system, {}, {}).A"
    refuse_clocks("modes", system)
    refuse_states("modes", system, InputError, remedy)
    q = system.q0 if at is None else as_array(at)
    check_shape("modes", "at", q, (system.n,))
    check_finite("modes", "at", q)
    time = as_time("modes", t, q.dtype)
    generator = None
    if not (isinstance(turning, int | float) and turning == 0.0):
        if v is not None:
            raise InputError("modes: v and turning are given; turning implies the velocity.")
        generator, v = turn("modes", system, turning, time, q)
        check_turn("modes", system, time, q, v)
    if v is None:
        system = standing(system, time)
    velocity = jnp.zeros_like(q) if v is None else as_array(v)
    check_shape("modes", "v", velocity, (system.n,))
    check_finite("modes", "v", velocity)
    known = concrete(velocity)
    refuse_slips("modes", system, v is not None and (known is None or bool(np.any(known))))
    seen = None if generator is not None else velocity
    independent, q = independent_constraints("modes", system, time, q, seen)
    # Where JAX traces, and about what moves, nothing can be told.
    tells = v is None and is_outermost()
    result, imbalance = _modes(system, time, q, velocity, independent, generator, np.asarray(tells))
    warn_of_linear_bodies("modes", system, time, q, velocity)
    if tells and is_needed(imbalance):
        nearer = q + imbalance.step
        there, _ = _modes(
            system, time, nearer, velocity, independent, generator, np.zeros((), bool)
        )
        warn_of_imbalance("modes", imbalance, result.frequencies, there.frequencies)
    return result


@program_once
def _modes(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    independent: int,
    turning: Float[Array, "n n"] | None,
    tells: Bool[Array | np.ndarray, ""],
) -> tuple[Modes, Imbalance]:
    """The modes, and how far the state is from a balance, or none where nobody `tells`."""
    tangent = tangent_of(system, t, q, v, independent, turning)
    values, right = eigenvalues(tangent.matrix)
    frequencies, damping, chosen = _pairs(values)
    d = tangent.basis.shape[1]
    # Coordinates are N z: amplitudes of unit length in the kinetic energy.
    shapes = tangent.basis.astype(right.dtype) @ right[:d, chosen]
    sizes = jnp.sqrt(jnp.sum(jnp.abs(right[:d, chosen]) ** 2, axis=0))
    shapes = shapes / jnp.where(sizes > 0, sizes, 1)[None]
    # Free motions have eigenvalues of zero, which rounding makes a little positive.
    growth = jnp.max(values.real, initial=-jnp.inf)
    is_stable = growth <= _ROUNDED * jnp.max(jnp.abs(values), initial=1.0)
    found = Modes(frequencies, damping, values, shapes, is_stable, q, t)
    still = detached(system, t, q, tangent)
    none = Imbalance.none(q)
    return found, jax.lax.cond(tells, lambda: imbalance_of(*still), lambda: none)


def eigenvalues(
    matrix: Float[Array, "two_d two_d"],
) -> tuple[Complex[Array, " two_d"], Complex[Array, "two_d two_d"]]:
    """The eigenvalues s of A, by size, and the eigenvectors, which are constants.

    Positions are scaled by the frequencies of the undamped system before: A is then nearly skew, so
    that small eigenvalues keep their digits beside large ones.
    """
    constant, d = jax.lax.stop_gradient(matrix), len(matrix) // 2
    stiffness = -constant[d:, :d]
    squares, directions = jnp.linalg.eigh(0.5 * (stiffness + stiffness.T))
    largest = jnp.max(jnp.abs(squares), initial=0.0)
    # Free motions have no frequency to be scaled by; they take a millionth of the largest.
    floor = jnp.where(largest > 0, 1e-12 * largest, 1.0)
    scale = jnp.sqrt(jnp.maximum(jnp.abs(squares), floor))
    # In the modes of the undamped part, scaled by their frequencies, the matrix is nearly skew: its
    # eigenvalues are then well conditioned.
    forth = jax.scipy.linalg.block_diag(scale[:, None] * directions.T, directions.T)
    back = jax.scipy.linalg.block_diag(directions / scale[None], directions)
    values, right = jnp.linalg.eig(forth @ constant @ back)
    left = jnp.linalg.pinv(right)
    # Conjugates have one size but for rounding, and the one with the positive sign comes first.
    order = jnp.lexsort((-values.imag, jnp.round(jnp.abs(values), 12)))
    values, right, left = values[order], right[:, order], left[order]
    products = jnp.sum(left * right.T, axis=1)
    right, left = back.astype(right.dtype) @ right, left @ forth.astype(right.dtype)
    # Eigenvalues that repeat without a vector each have no derivative.
    defined = jnp.abs(products) > 0.5
    change = jnp.einsum("ij,jk,ki->i", left, (matrix - constant).astype(right.dtype), right)
    values = values + jnp.where(defined, change / jnp.where(defined, products, 1), 0)
    return values, right


def _pairs(
    values: Complex[Array, " two_d"],
) -> tuple[Float[Array, " d"], Float[Array, " d"], Array]:
    """Frequencies and damping ratios of pairs, and the number of the first of each pair.

    Complex eigenvalues are pairs with their conjugates, real ones in the order of their size.
    """
    count = len(values)
    rounded = _ROUNDED * jnp.max(jnp.abs(values), initial=0.0)
    real = jnp.abs(values.imag) <= rounded
    odd = jnp.cumsum(real) % 2 == 1
    first = jnp.where(real, odd, values.imag > 0)
    (chosen,) = jnp.nonzero(first, size=count // 2, fill_value=count - 1)
    numbers = jnp.arange(count)
    later = jnp.where(real[None] & (numbers[None] > numbers[:, None]), numbers[None], count - 1)
    partner = jnp.min(later, axis=1, initial=count - 1)
    one = values[chosen]
    other = jnp.where(real[chosen], values[partner[chosen]], jnp.conj(one))
    product = jnp.abs(one * other)
    frequency = jnp.where(product > 0, jnp.sqrt(jnp.where(product > 0, product, 1)), 0)
    ratio = -0.5 * (one + other).real / jnp.where(frequency > 0, frequency, 1)
    # A pair of real ones begins with the smaller, and may be of a higher frequency than the next.
    order = jnp.argsort(jnp.round(frequency, 12), stable=True)
    return frequency[order], ratio[order], chosen[order]
