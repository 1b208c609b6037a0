"""Paths of the frames of a mechanism with one or two freedoms, its bodies undeformed."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import concrete
from ...common.errors import UnsuitedError
from ...compiling.program import program_once
from ...linalg.dense import multiply
from ...system.base import AbstractSystem
from ...system.dynamics import jacobian
from ..charts.survey import survey

# Steps of Newton's method, each of which doubles the number of correct digits.
_NEWTON = 4
# Steps of a block, which is one call.
BLOCK = 64


class Frames(eqx.Module):
    """The coordinates that the constraints determine up to one or two freedoms.

    - `numbers`: of these coordinates in q; `rows`: of the constraints that do not repeat others.
    - `metric` (n, n): the mass matrix M₀ at the start.
    - `freedoms`: one or two. `time` [s]: at which constraints are evaluated.
    """

    freedoms: int = eqx.field(static=True)
    numbers: tuple[int, ...] = eqx.field(static=True)
    rows: tuple[int, ...] = eqx.field(static=True)
    metric: Float[Array, "n n"]
    time: Float[Array, ""]

    @classmethod
    def of(cls, system: AbstractSystem, t: Float[Array, ""], q: Float[Array, " n"]) -> "Frames":
        """Return the frames near q (n,); raise UnsuitedError unless there are 1 or 2 freedoms."""
        if concrete(q) is None:
            raise ValueError(
                "reduce: a table is made outside of jit, grad and vmap; inside, take the same one "
                "of another system by rom.with_full(system)."
            )
        numbers = np.flatnonzero(system.structure.rigid)
        seen = survey(system, t[None], q[None], 1)
        full = seen.jacobians[0] @ seen.root
        rank = np.linalg.matrix_rank(full[:, numbers]) if system.m else 0
        freedoms = len(numbers) - rank
        if rank < len(seen.rows) or freedoms not in (1, 2):
            why = f"the frames of its undeformed bodies have {freedoms} freedoms"
            if rank < len(seen.rows):
                why = f"{len(seen.rows) - rank} of its constraints hold by deformation alone"
            raise UnsuitedError(
                f"reduce: a table is for mechanisms of one or two freedoms, but {why}."
            )
        metric = np.asarray(seen.root.T @ seen.root)
        names = tuple(int(i) for i in numbers)
        return cls(int(freedoms), names, seen.rows, jnp.asarray(metric), t)

    def violation(self, system: AbstractSystem, q: Float[Array, " n"]) -> Float[Array, " m"]:
        """C of the constraints that do not repeat others."""
        return system.constraint(self.time, q)[np.array(self.rows)]

    def slice(
        self, system: AbstractSystem, q: Float[Array, " n"], along: Float[Array, "n d"]
    ) -> tuple[Float[Array, "n m"], Float[Array, "n d"]]:
        """Return X and the tangents T that the constraints allow.

        Δq = X c has C_q Δq = c and no part `along` the directions A in the mass metric; T is such
        that Aᵀ M₀ T = 1.
        """
        own = np.array(self.numbers)
        rows = jacobian(system, self.time, q)[np.array(self.rows)][:, own]
        normals = multiply(along.T, self.metric)[:, own]
        # The columns of the inverse solve C_q Δq = c and Aᵀ M₀ Δq = s, for units of c and of s.
        inverse = jnp.linalg.inv(jnp.concatenate([rows, normals]))
        columns = jnp.zeros((q.size, own.size), q.dtype).at[own].set(inverse)
        return columns[:, : len(rows)], columns[:, len(rows) :]

    def tangent(
        self, system: AbstractSystem, q: Float[Array, " n"], along: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """The unit vector that one freedom allows next to a direction."""
        tangent = self.slice(system, q, along[:, None])[1][:, 0]
        return tangent / jnp.sqrt(multiply(tangent, multiply(self.metric, tangent)))

    def project(
        self, system: AbstractSystem, q: Float[Array, " n"], along: Float[Array, "n d"]
    ) -> Float[Array, " n"]:
        """The configuration on the constraints by Newton's method from q, across directions."""

        def newton(q: Array, _: None) -> tuple[Array, None]:
            correction, _tangents = self.slice(system, q, along)
            return q - multiply(correction, self.violation(system, q)), None

        return jax.lax.scan(newton, q, None, length=_NEWTON)[0]


class Point(NamedTuple):
    """Points of a curve: configurations and unit tangents."""

    q: Float[Array, "*k n"]
    tangent: Float[Array, "*k n"]


@program_once
def start(system: AbstractSystem, frames: Frames, q: Array, before: Array) -> Point:
    """The point of the curve next to q whose tangent is next to `before`."""
    q = frames.project(system, q, before[:, None])
    return Point(q, frames.tangent(system, q, before))


@program_once
def advance(system: AbstractSystem, frames: Frames, point: Point, step: Array) -> Point:
    """The next points of the curve (BLOCK,), by Runge and Kutta's method and Newton's.

    Equal steps of a one-step method are points of one smooth motion along the curve, whose speed
    differs from one by O(h⁴): as good a coordinate as the arc length, which need not be known.
    """
    slope = functools.partial(frames.tangent, system)

    def one(point: Point, _: None) -> tuple[Point, Point]:
        q, first = point
        second = slope(q + step / 2 * first, first)
        third = slope(q + step / 2 * second, first)
        fourth = slope(q + step * third, first)
        # The classical method of Runge and Kutta.
        mean = (first + 2 * second + 2 * third + fourth) / 6
        q = frames.project(system, q + step * mean, mean[:, None])
        new = Point(q, slope(q, first))
        return new, new

    return jax.lax.scan(one, point, None, length=BLOCK)[1]


@program_once
def violations(
    system: AbstractSystem, t: Float[Array, ""], q: Float[Array, "K n"]
) -> Float[Array, "K M"]:
    """C at several configurations."""
    return jax.vmap(system.constraint, (None, 0))(t, q)
