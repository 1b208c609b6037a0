"""Static equilibria."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ..assembly.linear_bodies import warn_of_linear_bodies
from ..assembly.standing import standing
from ..common.arrays import Vector, as_array, concrete
from ..common.checks import as_time, check_finite, check_shape
from ..common.compat import is_outermost
from ..common.errors import SimulationError
from ..common.partition import detached
from ..compiling.program import program_once
from ..linalg.dense import multiply
from ..system import unit_length
from ..system.base import AbstractSystem, check_system
from .displacements import displacements
from .statics import Linear, Statics
from .tangent import refuse_clocks

# Newton steps for one load, and load steps in all.
_STEPS, _LOADS = 12, 1000
# How far a load step may move bodies, and how far a Newton step does, in lengths of the mechanism
# and radians.
_FAR, _STRIDE = 0.5, 0.1
# The least step of the load.
_LEAST = 1e-6
_SINGLE = (
    " In single precision, stiff parts leave too few digits for it: call "
    'jax.config.update("jax_enable_x64", True) before making any array.'
)


class _Reached(NamedTuple):
    """The state of the continuation: the load so far, and the equilibrium under it."""

    q: Float[Array, " n"]
    multipliers: Float[Array, " M"]
    load: Float[Array, ""]  # the share of it
    step: Float[Array, ""]
    count: Any


class _Manner(NamedTuple):
    """How the continuation goes: whether Newton's steps are strides, how far `most` a load step may
    move bodies, and whether drives, and whatever else does not hold at the start, go their way with
    the load, or are in their places from the first step on.
    """

    strides: Bool[Array, "*manners"]
    most: Float[Array, "*manners"]
    drives: Bool[Array, "*manners"]

    @classmethod
    def each(cls, dtype: Any) -> "_Manner":
        """Return them in turn: each is for what those before it do not follow.

        A drive may be further off its start than a load step goes. Shapes whose stiffness differs
        by many orders of magnitude may ask for steps of any length; of a motion so long that less
        than half of the digits of an angle are left, no balance can be told.
        """
        any_length = float(jnp.finfo(dtype).eps) ** -0.5
        rows = [(True, _FAR, False), (True, _FAR, True), (False, any_length, False)]
        strides, most, drives = (jnp.array(column) for column in zip(*rows, strict=True))
        return cls(strides, most.astype(dtype), drives)


def equilibrium(
    system: AbstractSystem, q0: Vector | None = None, *, t: ArrayLike = 0.0
) -> Float[Array, " n"]:
    """A static equilibrium of a mechanism: q (n,) with C_qᵀ λ = Q(t, q, 0) and C(t, q) = 0.

    Newton's method in (q, λ) with continuation: forces that balance the start are taken away step
    by step, so that the solution follows from the start, and steps are shorter where Newton's
    method does not converge, or moves bodies by more than half of the mechanism's length or half a
    radian. Drives that are further from their start than that go there with the load; steps of any
    length are the last resort. What forces push and nothing resists yet, as a
    contact that just touches, moves along them. States of effects are found with it, and are in
    their places in q, so that `linearize` and `simulate` begin there with them. Neutral motions,
    which no force resists, stay as they are at the start, as do lengths of quaternions and states
    that nothing changes, such as the integral part of a controller without one; joints may repeat
    each other. Wheels roll there in a few steps along their tangents, so that how far they
    have turned is known roughly, to some thousandths. Moments of inertia play no part. Whether the
    equilibrium is stable says `modes(system, q).is_stable`.

    Differentiable with respect to all numbers of the system, by the implicit function theorem, and
    batchable.

    **Arguments:** the `system`, full or reduced; `q0` (n,), from where, its own start unless given;
    time `t` [s], at which loads act as they do then, and drives stand where they are.

    Raises InputError for controllers with a clock, whose laws no equation of motion has, and
    SimulationError if the continuation ends (a snap-through, or no equilibrium at all), with
    the share of the load that was reached and the coordinate that is least balanced.
    """
    check_system("equilibrium", system)
    q = system.q0 if q0 is None else as_array(q0)
    check_shape("equilibrium", "q0", q, (system.n,))
    check_finite("equilibrium", "q0", q)
    refuse_clocks("equilibrium", system)
    time = as_time("equilibrium", t, q.dtype)
    system = standing(system, time)
    reached = _solve(*detached(system, time, q))
    load = concrete(reached.load)
    if load is None:
        solution = eqx.error_if(
            reached.q, reached.load < 1, "equilibrium: the continuation ended before the full load."
        )
    elif load < 1:
        raise SimulationError(_ended(system, time, q, reached))
    else:
        solution = reached.q
    position: Float[Array, " n"] = solution
    if not is_outermost():
        begun = q[np.array(system.structure.states, int)]
        position = _differentiable(system, time, solution, reached.multipliers, begun)
    still = jnp.zeros_like(position)
    warn_of_linear_bodies("equilibrium", system, time, position, still)
    return position


def _ended(
    system: AbstractSystem, t: Float[Array, ""], q0: Float[Array, " n"], reached: _Reached
) -> str:
    """Return the words for a continuation that has ended too early."""
    residual = np.asarray(_unbalanced(system, t, q0, reached))
    worst = int(np.argmax(np.abs(residual)))
    return (
        f"equilibrium: from the start the solution was followed to {float(reached.load):.4g} of "
        f"the load, and no further: {system.structure.labels[worst]} is unbalanced by "
        f"{residual[worst]:.3g}. The mechanism snaps through there, "
        "or has no equilibrium; start from another q0."
        f"{_SINGLE if q0.dtype == jnp.float32 else ''}"
    )


@program_once
def _solve(system: AbstractSystem, t: Float[Array, ""], q0: Float[Array, " n"]) -> _Reached:
    n = system.n
    statics, sizes = Statics(system, t, q0), displacements(system, t, q0)
    given, rows = -statics.force(q0), unit_length.jacobian(system, t, q0)
    multipliers = _balancing(given, rows, sizes)
    # That the start needs to be in balance.
    needed = given + multiply(rows.T, multipliers)
    closed = statics.constraint(q0)
    terms = jnp.stack([needed, given])
    largest = jnp.max(jnp.abs(terms) * sizes[None], initial=0.0)
    zero, one = jnp.zeros_like(t), jnp.ones_like(t)

    def newton(
        q: Array, multipliers: Array, load: Array, how: _Manner
    ) -> tuple[Array, Array, Array]:
        forces = jnp.concatenate([needed, jnp.where(how.drives, closed, 0)])

        # The matrix at the last point only tells what rounding leaves. It is that of one step more,
        # whose result nobody takes, so that the program contains it once.
        def step(x: tuple[Array, Array, Array, Array, Array], _: None) -> tuple[Any, None]:
            at = x[:2]
            matrix, residual = statics.linearized(*at)
            linear = Linear.of(matrix, sizes, system.structure.states)
            unbalanced = residual - (1 - load) * forces
            change = linear.solve(unbalanced)
            balanced = linear.balances(unbalanced, *at, largest)
            free = jnp.where(balanced, 0, linear.unresisted(unbalanced, change, forces))
            change = jnp.where(how.strides, _strode(system, change, free, sizes), change)
            return (at[0] - change[:n], at[1] - change[n:], *at, balanced), None

        begin = q, multipliers, q, multipliers, jnp.zeros((), bool)
        return jax.lax.scan(step, begin, None, length=_STEPS + 1)[0][2:]

    def advance(now: _Reached, how: _Manner) -> _Reached:
        load = jnp.minimum(now.load + now.step, 1.0)
        q, multipliers, balanced = newton(now.q, now.multipliers, load, how)
        far = _moved(system, q - now.q, sizes)
        good = balanced & (far <= how.most)
        return _Reached(
            jnp.where(good, q, now.q),
            jnp.where(good, multipliers, now.multipliers),
            jnp.where(good, load, now.load),
            # Load steps double after each success, and are a quarter after a failure, from the last
            # equilibrium.
            jnp.where(good, 2 * now.step, 0.25 * now.step),
            now.count + 1,
        )

    def unfinished(now: _Reached) -> Array:
        going: Array = (now.load < 1) & (now.step > _LEAST) & (now.count < _LOADS)
        return going

    begin = _Reached(q0, multipliers, zero, one, jnp.zeros((), int))

    def follow(now: _Reached, how: _Manner) -> tuple[_Reached, None]:
        now = jax.tree.map(lambda x, y: jnp.where(now.load < 1, x, y), begin, now)
        return jax.lax.while_loop(unfinished, lambda now: advance(now, how), now), None

    end: _Reached = jax.lax.scan(follow, begin, _Manner.each(q0.dtype))[0]
    return end


def _moved(
    system: AbstractSystem, change: Float[Array, " n"], sizes: Float[Array, " n"]
) -> Float[Array, ""]:
    """How far a change of q moves bodies, in lengths of the mechanism and radians."""
    frames = system.structure.positions, system.structure.turns
    moved = np.concatenate([np.ravel(x) for x in frames]).astype(int)
    return jnp.max(jnp.abs(change[moved] / sizes[moved]), initial=0.0)


def _strode(
    system: AbstractSystem,
    change: Float[Array, " n_plus_M"],
    free: Float[Array, " n_plus_M"],
    sizes: Float[Array, " n"],
) -> Float[Array, " n_plus_M"]:
    """A Newton step, of at most one stride, with one stride along what is `free`.

    Where a contact just touches, nothing is stiff, or nearly nothing, and the step is none, or out
    of all proportion: from within the contact Newton's method comes back.
    """
    longest = jnp.max(jnp.abs(free[: len(sizes)] / sizes))
    change += jnp.where(longest > 0, _STRIDE / jnp.where(longest > 0, longest, 1), 0) * free
    return change * _STRIDE / jnp.maximum(_moved(system, change[: len(sizes)], sizes), _STRIDE)


@program_once
def _unbalanced(
    system: AbstractSystem, t: Float[Array, ""], q0: Float[Array, " n"], reached: _Reached
) -> Float[Array, " n"]:
    """Return the residual forces where the continuation ended."""
    return Statics(system, t, q0).residual(reached.q, reached.multipliers)[: system.n]


def _balancing(
    given: Float[Array, " n"], rows: Float[Array, "M n"], sizes: Float[Array, " n"]
) -> Float[Array, " M"]:
    """The multipliers that leave least of the `given` forces at the start, |D (C_qᵀ λ − Q)| for D
    the `sizes`: those of a mechanism with the mass D⁻².
    """
    n, count = len(sizes), len(rows)
    none = jnp.zeros((count, count), rows.dtype)
    # The least multipliers and forces, each by the displacement that is large for its coordinate.
    upper = jnp.concatenate([jnp.diag(sizes**-2), rows.T], axis=1)
    matrix = jnp.concatenate([upper, jnp.concatenate([rows, none], axis=1)])
    unbalanced = jnp.concatenate([given, jnp.zeros(count, given.dtype)])
    return -Linear.of(matrix, sizes).solve(unbalanced)[n:]


@program_once
def _differentiable(
    system: AbstractSystem,
    t: Float[Array | np.ndarray, ""],
    q: Float[Array | np.ndarray, " n"],
    multipliers: Float[Array | np.ndarray, " M"],
    begun: Float[Array, " k"],
) -> Float[Array, " n"]:
    """The same q, with the derivative −J⁺ ∂F of the residual F and Newton's matrix J; of states
    that stay, that of what they have `begun` with.
    """
    position, held = (jnp.asarray(jax.lax.stop_gradient(x)) for x in (q, multipliers))
    (fixed,) = detached(Statics(system, jnp.asarray(t), position))
    matrix, _ = fixed.linearized(position, held)
    sizes = displacements(fixed.system, fixed.t, position)
    linear = Linear.of(matrix, sizes, system.structure.states)
    right = Statics(system, jnp.asarray(t), position).residual(position, held)
    # Zero in value, with the derivative −K⁻¹ ∂r of the implicit function theorem in both modes.
    right, moved = (x - jax.lax.stop_gradient(x) for x in (right, begun))
    change = linear.solve(right, -moved)
    corrected: Float[Array, " n"] = position - change[: system.n]
    return corrected
