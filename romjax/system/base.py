"""The system: how a mechanism moves. Full, user-made and reduced ones are all of this kind."""

import abc
import contextlib
import contextvars
import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import equinox as eqx
from jaxtyping import Array, Float, Int

from ..common.arrays import Time
from ..common.checks import check_kind
from ..common.errors import InputError, ReductionError
from .constraints import right_hand_side
from .stabilization import Baumgarte
from .state import AbstractState
from .structure import Structure

S = TypeVar("S", bound="AbstractSystem")
# In whose name accelerations are refused, which inputs of theirs change.
_REFUSING = contextvars.ContextVar[str | None]("refusing", default=None)


class Run(NamedTuple):
    """A simulated motion in the coordinates of a system, and what it is physically."""

    t: Float[Array, " k"]
    q: Float[Array, "k n"]
    v: Float[Array, "k n"]
    physical: Float[Array, "k N"]  # coordinates
    violation: Float[Array, " k"]  # largest |C|
    drift: Float[Array, " k"] | float = 0.0  # of it, the tolerance of the steps


class AbstractValidity(eqx.Module):
    """The region in which the results of a system hold."""

    @abc.abstractmethod
    def flags(self, system: "AbstractSystem", run: Run) -> Int[Array, ""]:
        """Return the reasons not to trust a run of `system`, as the number of a `Flag`."""

    @abc.abstractmethod
    def including(self, run: Run) -> "AbstractValidity":
        """The same where nothing that is in `run` speaks against another one."""

    @property
    def of_states(self) -> "AbstractValidity | None":
        """The part of the region that each state of a run tells by itself; None if none does."""
        return None


def check_system(owner: str, system: "AbstractSystem") -> None:
    """Raise InputError, beginning with `owner`, for what is no system, such as a scene."""
    remedy = "what romjax.assemble(scene), romjax.reduce or romjax.CustomSystem returns"
    check_kind(owner, "the system", system, AbstractSystem, remedy)


def refuse_states(
    owner: str,
    system: "AbstractSystem",
    error: type[Exception],
    remedy: str = "this formulation does not keep; take romjax.JointCoordinates(), or "
    "romjax.Local(), where bodies deform",
) -> None:
    """Raise an `error`, beginning with `owner`, for effects with first-order states, which `remedy`
    says what to do about.
    """
    structure = system.full.structure
    if structure.states:
        effect = structure.coordinates[structure.states[0]].owner
        raise error(f"{owner}: '{effect}' has first-order states, which {remedy}.")


def check_reducible(system: "AbstractSystem", formulation: Any) -> None:
    """Raise ReductionError for what a formulation does not keep: first-order states, or, unless it
    stays in a subspace with constraints, those of velocities.
    """
    if not formulation.keeps_states:
        refuse_states("reduce", system, ReductionError)
    structure = system.full.structure
    if structure.slips and not formulation.in_subspace:
        raise ReductionError(
            f"reduce: {structure.constraints[structure.slips[0]]} holds velocities, which only "
            f'"galerkin" keeps, and not "{formulation.name}", whose coordinates satisfy C = 0.'
        )


class AbstractSystem(eqx.Module):
    """M(q) q̈ + C_qᵀ λ = Q(t, q, q̇), C(t, q) = 0 (chapter equation 39.1, with the sign of 39.2).

    A kind of system implements `mass`, `force`, `constraint`, and `state`, which gives them at one
    point of the motion in the form that suits its structure. The functions in `dynamics` take any
    system.
    """

    if TYPE_CHECKING:
        # As fields of this class they would come before those of a kind of system to type
        # checkers, and could not be properties of it.
        @property
        def q0(self) -> Float[Array, " n"]: ...
        @property
        def v0(self) -> Float[Array, " n"]: ...
        @property
        def structure(self) -> Structure: ...
        @property
        def full(self) -> "AbstractSystem": ...
        @property
        def validity(self) -> AbstractValidity | None: ...
    else:
        q0: eqx.AbstractVar[Float[Array, " n"]]
        v0: eqx.AbstractVar[Float[Array, " n"]]
        structure: eqx.AbstractVar[Structure]
        full: eqx.AbstractVar["AbstractSystem"]  # in physical coordinates: itself, unless reduced
        validity: eqx.AbstractVar[AbstractValidity | None]  # where results hold; None: everywhere

    def __hash__(self) -> int:
        # The identity lets `jax.jit(system.force)` work; equinox would hash the arrays.
        return id(self)

    @property
    def n(self) -> int:
        """Number of generalized coordinates."""
        return len(self.structure.coordinates)

    @property
    def m(self) -> int:
        """Number of constraints."""
        return len(self.structure.constraints)

    @abc.abstractmethod
    def mass(self, q: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Mass matrix M, symmetric positive definite."""

    @abc.abstractmethod
    def force(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
        """Generalized force Q: applied, elastic, dissipative and quadratic-velocity forces."""

    @abc.abstractmethod
    def constraint(self, t: Time, q: Float[Array, " n"]) -> Float[Array, " m"]:
        """Constraints C; length zero if there are none."""

    @abc.abstractmethod
    def state(self, t: Time, q: Float[Array, " n"], v: Float[Array, " n"]) -> AbstractState:
        """The equations of motion at one point, each part evaluated on demand."""

    def acceleration(
        self,
        t: Time,
        q: Float[Array, " n"],
        v: Float[Array, " n"],
        stabilization: Baumgarte | None = None,
    ) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
        """Accelerations [in units of q per s²] and Lagrange multipliers (chapter equation 39.3)."""
        owner = _REFUSING.get()
        if owner is not None:
            raise InputError(
                f"{owner}: an output asks for accelerations, which the inputs change, but as a "
                'function of (t, q, v) it does not know these; give the speed, such as "cart.x\'", '
                "whose rate it is: the acceleration has the rows c A of C and c B of D, with its "
                "row c of C."
            )
        state = self.state(t, q, v)
        known = state.constraints()
        gamma = right_hand_side(self.constraint, self.m, t, q, v, stabilization, known)
        a, multipliers, _ = state.solve(gamma)
        return a, multipliers


@contextlib.contextmanager
def refusing_accelerations(owner: str) -> Iterator[None]:
    """Within it `AbstractSystem.acceleration` raises InputError, in the name of `owner`."""
    token = _REFUSING.set(owner)
    try:
        yield
    finally:
        _REFUSING.reset(token)


def beginning_at(system: S, q: Float[Array, " n"], v: Float[Array, " n"]) -> S:
    """The system from another start, in its own coordinates."""
    started: S = dataclasses.replace(cast(Any, system), q0=q, v0=v)
    return started
