"""The base of reduced systems, which stand for another one with more coordinates."""

import abc
import dataclasses
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..common import precision
from ..common.arrays import Time, Vector, as_array, concrete
from ..common.checks import check_order
from ..common.errors import InputError, ReductionError
from ..compiling.program import program_once
from ..linalg import quaternions
from .base import AbstractSystem
from .consistent import consistent
from .constraints import differentiate

# Shapes of signatures: coordinates of the full system, and of the reduced one.
Physical = Float[Array, " n"]
Reduced = Float[Array, " r"]
R = TypeVar("R", bound="AbstractReducedSystem")


class AbstractReducedSystem(AbstractSystem):
    """A system in few coordinates; `full` is the one that was reduced.

    - `time` [s]: of the start, and where `mass` is, if constraints depend on time.
    - `summary`: what it was made of, in words.
    """

    # Whether its accelerations satisfy the equations of motion in its subspace, so that forces,
    # powers and moments follow from them.
    satisfies_dynamics: ClassVar[bool] = True
    # Whether its motion is that of the full system, whose equations then hold at its states, and
    # not only in a subspace.
    is_exact: ClassVar[bool] = False

    if TYPE_CHECKING:
        # As in AbstractSystem: fields of this class would come before those of the kinds.
        @property
        def time(self) -> Float[Array, ""]: ...
        @property
        def summary(self) -> str: ...
    else:
        time: eqx.AbstractVar[Float[Array, ""]]
        summary: eqx.AbstractVar[str]

    @property
    def degrees_of_freedom(self) -> int:
        """Coordinates that the constraints leave free, r − m."""
        return self.n - self.m

    def force(self, t: Time, q: Reduced, v: Reduced) -> Reduced:
        return self.state(t, q, v).force()

    @abc.abstractmethod
    def reconstruct(self, t: Time, q: Reduced, v: Reduced) -> tuple[Physical, Physical]:
        """The physical coordinates and velocities that a reduced state stands for."""

    @abc.abstractmethod
    def restrict(self, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        """The reduced coordinates and velocities nearest to physical ones, in the start's chart."""

    def in_chart_of(self: R, q: Physical) -> R:
        """The system in the coordinates that suit a configuration: itself, unless it has charts."""
        del q
        return self

    def starting_at(self: R, q: Vector, v: Vector, t: Vector | None = None) -> R:
        """The system with the start nearest to physical q, v (n,) at t [s], on its constraints.

        Raises ReductionError if these cannot be satisfied there.
        """
        q, v = as_array(q), as_array(v)
        own = self.in_chart_of(q)
        return started(own, *own.restrict(q, v), self.time if t is None else t)

    @abc.abstractmethod
    def with_full(self, full: AbstractSystem) -> "AbstractReducedSystem":
        """The same reduction of a system with other numbers, from that one's own start: from one
        that was given by `starting_at`, or by snapshots, it is moved by as much as the starts of
        both systems are apart. It is put on the constraints. Works under `jit`, `grad` and `vmap`.

        Raises ReductionError if the coordinates differ, or if there is no start.
        """


def reduced_of(system: AbstractSystem) -> AbstractReducedSystem | None:
    """The system itself if it is reduced, one that stands for another; else None."""
    return None if system.full is system else cast(AbstractReducedSystem, system)


def follows(
    model: AbstractReducedSystem,
    t: Float[Array, " K"],
    q: Float[Array, "K n"],
    v: Float[Array, "K n"],
) -> bool:
    """Whether a model has configurations near all of these physical states."""
    return bool(_exist(model, t, q, v))


def check_alike(full: AbstractSystem, other: AbstractSystem) -> None:
    """Raise ReductionError unless another system can take the place of the `full` one."""
    if other.n != full.n or other.m != full.m:
        raise ReductionError(
            f"with_full: a system of {other.n} coordinates and {other.m} constraints cannot take "
            f"the place of one of {full.n} and {full.m}; reduce it by itself."
        )
    check_order("with_full", full.structure.labels, other.structure.labels, ReductionError)


def moved_start(before: R, after: R) -> tuple[Reduced, Reduced]:
    """The start of a model `after` its full system was exchanged: as far from where that one starts
    as it was `before` from where the other starts.
    """
    own, there = (x.restrict(x.full.q0, x.full.v0) for x in (before, after))
    given = (before.q0, before.v0), own, there
    moved: tuple[Reduced, Reduced] = _moved(*given, after.structure.quaternions)
    return moved


def started(system: R, z: Reduced, w: Reduced, t: Vector) -> R:
    """The system with the start z, w at t [s], put on its constraints; raises ReductionError if it
    cannot be.
    """
    begun: Any = dataclasses.replace(cast(Any, system), q0=z, v0=w, time=jnp.asarray(t, z.dtype))
    q0, v0 = start_of(begun, z, w, begun.time)
    both: R = dataclasses.replace(begun, q0=q0, v0=v0)
    return both


def start_of(
    system: AbstractSystem, z: Reduced, w: Reduced, t: Float[Array, ""]
) -> tuple[Reduced, Reduced]:
    """The reduced start z, w at t, on the constraints; raises ReductionError if it cannot be."""
    known = concrete(z)
    if known is not None and not np.all(np.isfinite(known)):
        raise ReductionError(
            "The reduced model has no start there: none of its configurations is that of the full "
            "system, whose joints it may not be able to close with these numbers; make a model of "
            "a run of that system."
        )
    if system.m == 0:
        return z, w
    violation = concrete(_largest_violation(system, t, z, w))
    if violation is not None and violation <= precision.of(z.dtype).projected:
        return z, w
    try:
        return consistent(system, z, w, t)
    except InputError as error:
        raise ReductionError(f"The reduced model has no start there. {error}") from error


@program_once
def _largest_violation(
    system: AbstractSystem, t: Float[Array, ""], z: Reduced, w: Reduced
) -> Float[Array, ""]:
    """Return the largest violation of a constraint or of its rate."""
    state = differentiate(system.constraint, t, z, w)
    return jnp.max(jnp.abs(jnp.stack([state.violation, state.rate])))


@program_once
def _moved(
    start: tuple[Reduced, Reduced],
    own: tuple[Reduced, Reduced],
    there: tuple[Reduced, Reduced],
    turns: tuple[int, ...],
) -> tuple[Reduced, Reduced]:
    """There, and beyond by what the start is away from `own`; `turns`: where quaternions begin."""
    z, w = (other + (x - y) for other, x, y in zip(there, start, own, strict=True))
    if not turns:
        return z, w
    table = quaternions.columns(turns)
    (p, rate), (q, other), (r, last) = ([x[table] for x in pair] for pair in (start, own, there))
    turned = quaternions.product(r, quaternions.product(quaternions.conjugate(q), p))
    # At rest beside each other, and with the same angular velocity, they stay so.
    speeds = [quaternions.angular_velocity(*x) for x in ((r, last), (p, rate), (q, other))]
    spun = quaternions.derivative(turned, speeds[0] + speeds[1] - speeds[2])
    return z.at[table].set(turned), w.at[table].set(spun)


@program_once
def _exist(
    model: AbstractReducedSystem,
    t: Float[Array, " K"],
    q: Float[Array, "K n"],
    v: Float[Array, "K n"],
) -> Bool[Array, ""]:
    def one(t: Array, q: Array, v: Array) -> Array:
        own = model.in_chart_of(q)
        return jnp.all(jnp.isfinite(own.reconstruct(t, *own.restrict(q, v))[0]))

    return jnp.all(jax.vmap(one)(t, q, v))
