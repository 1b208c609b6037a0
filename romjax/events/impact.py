"""Impacts: velocities that change at an instant, by Newton's law of restitution."""

from collections.abc import Callable
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..common.checks import check_finite, check_shape
from ..common.errors import InputError
from ..common.fields import Converted, number
from ..compiling.program import program_once
from ..linalg.dense import multiply
from ..system.base import AbstractSystem
from ..system.mobility import moves
from ..system.reduced import AbstractReducedSystem, Physical, Reduced, reduced_of
from .base import AbstractEvent, Direction, Quantity

__all__ = ["Impact"]


class Impact(AbstractEvent):
    """A gap that closes, and opens again with `restitution` times the speed (Newton's law).

    The velocities change by the impulse p along ∂g/∂q that the law asks for, and by those of the
    joints, which hold during the impact:

        M Δv + C_qᵀ Λ = (∂g/∂q)ᵀ p,  C_q Δv = 0,  ġ⁺ = −e ġ⁻.

    Where gaps of several impacts are closed at one instant, they collide one after the other, the
    fastest first, until none closes any more (for Newton's cradle, what is seen). Instants only: a
    contact that lasts needs a force, as `romjax.Contact` is one.

    **Arguments:**

    - `of`: the gap [m], a `romjax.quantity` of positions, or any function of (system, t, q, v) that
      uses no velocities.
    - `restitution`: e, from 0 (nothing of the speed is left) to 1 (no energy is lost).
    - `level`: of the gap at which it closes [m], such as the sum of two radii.
    """

    of: Quantity
    restitution: Converted[Float[Array, ""]] = number(default=1.0)
    level: Converted[Float[Array, ""]] = number(default=0.0)
    direction: Direction = eqx.field(static=True, default="falling", init=False)
    stops: ClassVar[bool] = False
    resets: ClassVar[bool] = True

    def check(self) -> None:
        super().check()
        check_shape("Impact", "restitution", self.restitution, ())
        check_finite("Impact", "restitution", self.restitution)
        value = self.restitution
        if not isinstance(value, jax.core.Tracer) and not 0 <= float(value) <= 1:
            raise InputError(f"Impact: restitution = {float(value):g} must be from 0 to 1.")


class Collision(NamedTuple):
    """The outcome of a collision, which takes no time.

    - `v` (n,): after it. `impulses` (impacts,) [N s], `rates` (impacts,): of the gaps, after it.
    - `work`: of all impulses, those of the joints included [J].
    - `closing`: whether gaps still close: more collisions than were looked at.
    """

    v: Float[Array, " n"]
    impulses: Float[Array, " impacts"]
    rates: Float[Array, " impacts"]
    work: Float[Array, ""]
    closing: Bool[Array, ""]


def collide(
    system: AbstractSystem,
    t: Float[Array, ""],
    q: Float[Array, " n"],
    v: Float[Array, " n"],
    gaps: Callable[[Array, Array], Float[Array, " impacts"]],
    restitution: Float[Array, " impacts"],
    closed: Bool[Array, " impacts"],
    least: Float[Array, " impacts"],
) -> Collision:
    """The collisions at the time `t` of those `gaps` that are `closed`: functions of (t, q).

    Speeds below the `least` are none.
    """
    values, transpose = jax.vjp(gaps, t, q)
    moved, rows = jax.vmap(transpose)(jnp.eye(len(values), dtype=q.dtype))
    # Each column is the Δv by a unit impulse in one gap, with the impulses of the joints then.
    response, joints = system.state(t, q, v).kkt().solve(rows.T, jnp.zeros((system.m, len(rows))))
    compliance, before = multiply(rows, response), multiply(rows, v) + moved
    count = len(rows)

    def one(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
        rates, impulses = carry
        closing = closed & (rates < -least)
        # The fastest closing gap first, one at a time: Newton's law of impact for each, so that a
        # row of bodies hands an impulse on.
        i = jnp.argmin(jnp.where(closing, rates, jnp.inf))
        # ṡ⁺ = −e ṡ⁻, by the compliance of the gap to its own impulse.
        impulse = -(1 + restitution[i]) * rates[i] / compliance[i, i]
        impulse = jnp.where(jnp.any(closing), impulse, 0.0)
        return (rates + impulse * compliance[:, i], impulses.at[i].add(impulse)), None

    # In a row of N equal bodies, each impulse is handed on along the row, as if each body passed
    # each other one: N (N − 1) / 2 collisions.
    length = 1 if count == 1 else 2 * count * (count + 1)
    (rates, impulses), _ = jax.lax.scan(one, (before, jnp.zeros_like(before)), None, length)
    after = v + multiply(response, impulses)
    # ΔT = v̄ᵀ M Δv with the mean v̄ of the velocities before and after.
    mean = 0.5 * (v + after)
    work = multiply(impulses, multiply(rows, mean))
    if system.m:
        _, along = jax.jvp(lambda q: system.constraint(t, q), (q,), (mean,))
        work -= multiply(multiply(joints, impulses), along)
    if reduced_of(system) is not None and moves(system.full):
        # Coordinates in which drives are solved for leave out what these do: at v = 0 the bodies
        # have the momentum of the drives' speed.
        carried = system.state(t, q, jnp.zeros_like(v)).energy().momentum
        work += multiply(carried, multiply(response, impulses))
    return Collision(after, impulses, rates, work, jnp.any(closed & (rates < -least)))


@program_once
def struck(
    model: AbstractReducedSystem,
    t: Float[Array, ""],
    z: Reduced,
    w: Reduced,
    impact: tuple[Physical, Physical, Physical],
) -> Reduced:
    """The velocities of a model after an `impact` of its full system, at q, v before and v after.

    The impulse acts where it does in the full system, and is as large as the law of restitution
    asks of the model: it changes the speed along the impulse by as much.
    """
    q, before, after = impact
    change = after - before
    impulse = model.full.state(t, q, before).apply_mass(change)

    def lift(z: Array) -> Array:
        return model.reconstruct(t, z, jnp.zeros_like(z))[0]

    _, pull = jax.vjp(lift, z)
    none = jnp.zeros((model.m, 1), z.dtype)
    (jump,), _ = (x.T for x in model.state(t, z, w).kkt().solve(pull(impulse)[0][:, None], none))
    seen = multiply(impulse, jax.jvp(lift, (z,), (jump,))[1])
    ratio = jnp.where(seen > 0, multiply(impulse, change) / jnp.where(seen > 0, seen, 1), 0)
    velocities: Reduced = w + ratio * jump
    return velocities
