"""The reduced system of local bases: the mechanism with fewer modes in its bodies."""

import dataclasses
import functools

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...assembly.assemble import assemble
from ...assembly.assembled import AssembledSystem
from ...assembly.disassemble import disassemble
from ...assembly.locate import assembled
from ...common.arrays import Time, Vector, as_array
from ...common.errors import ReductionError, SceneError
from ...compiling.program import program_once
from ...linalg.kkt import KKT
from ...scene.body.base import AbstractBody
from ...scene.body.bending import AbstractBendingBody
from ...scene.body.reduced import ReducedBody
from ...scene.scene import Scene
from ...system.base import AbstractSystem, AbstractValidity
from ...system.reduced import (
    AbstractReducedSystem,
    Physical,
    Reduced,
    check_alike,
    moved_start,
    start_of,
)
from ...system.state import AbstractState, Energy, Power
from ...system.structure import Structure
from .bases import BodyBases


class LocalSystem(AbstractReducedSystem):
    """A mechanism whose bodies move in q_f = Φ z, each with a basis of its own.

    d'Alembert's principle on q = T z, with the frames of all bodies and all constraints: the
    equations are those of an ordinary scene, so a step costs O(N) in the number of bodies. Made by
    `reduce`.

    - `full`: the system that was reduced. `reduced`: the one of the bodies with few modes, which
      has its coordinates, its constraints and its start.
    - `bases`: T. `validity`: what they were made of. `summary`: that in words.
    """

    full: AssembledSystem
    reduced: AssembledSystem
    bases: BodyBases
    time: Float[Array, ""]
    validity: AbstractValidity | None
    summary: str = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        full: AssembledSystem,
        bases: BodyBases,
        start: tuple[Physical, Physical, Float[Array, ""]],
        validity: AbstractValidity | None = None,
        summary: str = "",
    ) -> "LocalSystem":
        """Make the system with the `start` nearest to physical (q, v, t).

        `full`, `bases`, `validity` and `summary` are the fields.
        """
        rom = cls(full, _with_bases(full, bases), bases, start[2], validity, summary)
        return rom.starting_at(*start)

    @property
    def q0(self) -> Reduced:
        return self.reduced.q0

    @property
    def v0(self) -> Reduced:
        return self.reduced.v0

    @property
    def ranks(self) -> tuple[int, ...]:
        """The number of modes of each body, in the order of the scene; without the counters of
        angles and the states of effects, which follow the bodies.
        """
        bodies = self.bases.by_body()[: len(self.full.structure.frames)]
        return tuple(modes.shape[1] for modes in bodies)

    @property
    def structure(self) -> Structure:
        return self.reduced.structure

    def mass(self, q: Reduced) -> Float[Array, "r r"]:
        return self.reduced.mass(q)

    def force(self, t: Time, q: Reduced, v: Reduced) -> Reduced:
        return self.reduced.force(t, q, v)

    def constraint(self, t: Time, q: Reduced) -> Float[Array, " m"]:
        return self.reduced.constraint(t, q)

    def state(self, t: Time, q: Reduced, v: Reduced) -> "LocalState":
        return LocalState(self.reduced.state(t, q, v), self.bases)

    def reconstruct(self, t: Time, q: Reduced, v: Reduced) -> tuple[Physical, Physical]:
        del t
        return self.bases.expand(q), self.bases.expand(v)

    def restrict(self, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        z, w = _projected(self.bases, q, v)
        return z, w

    def starting_at(self, q: Vector, v: Vector, t: Vector | None = None) -> "LocalSystem":
        return self._starting_at(*self.restrict(as_array(q), as_array(v)), t)

    def with_full(self, full: AbstractSystem) -> "LocalSystem":
        check_alike(self.full, full)
        full = assembled("with_full", full)
        rom = dataclasses.replace(self, full=full, reduced=_with_bases(full, self.bases))
        return rom._starting_at(*moved_start(self, rom))

    def _starting_at(self, z: Reduced, w: Reduced, t: Vector | None = None) -> "LocalSystem":
        time = self.time if t is None else jnp.asarray(t, z.dtype)
        q0, v0 = start_of(self.reduced, z, w, time)
        reduced = dataclasses.replace(self.reduced, q0=q0, v0=v0)
        return dataclasses.replace(self, reduced=reduced, time=time)


@program_once
def _projected(bases: BodyBases, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
    return bases.project(q), bases.project(v)


def _with_bases(full: AssembledSystem, bases: BodyBases) -> AssembledSystem:
    """The system of the bodies with few modes; raises ReductionError if joints then lock it."""
    scene = disassemble(full)
    # Counters of angles and states of effects, which no scene has as bodies, come after these.
    bodies = [
        _reduced(body, modes) if body.modes else body
        for body, modes in zip(scene.bodies, bases.by_body(), strict=False)
    ]
    try:
        return assemble(Scene(bodies, scene.joints, scene.effects))
    except SceneError as error:
        raise ReductionError(f"reduce: with so few modes: {error}") from error


def _reduced(body: AbstractBody, modes: Array) -> AbstractBody:
    # A body that bends folds a basis into its own tables.
    if isinstance(body, AbstractBendingBody):
        return body.in_span(modes)
    return ReducedBody(body, modes)


@dataclasses.dataclass(frozen=True)
class LocalState(AbstractState):
    """A state of the bodies with few modes, seen as one of the full system."""

    inner: AbstractState
    bases: BodyBases

    @functools.cached_property
    def q(self) -> Physical:  # type: ignore[override]
        return self.bases.expand(self.inner.q)

    @functools.cached_property
    def v(self) -> Physical:  # type: ignore[override]
        return self.bases.expand(self.inner.v)

    def apply_mass(self, x: Float[Array, "r *k"]) -> Float[Array, "r *k"]:
        return self.inner.apply_mass(x)

    def jacobian(self) -> Float[Array, "m r"]:
        return self.inner.jacobian()

    def force(self) -> Reduced:
        return self.inner.force()

    def energy(self) -> Energy:
        return self.inner.energy()

    def power(self) -> Power | None:
        return self.inner.power()

    def residual(self, a: Reduced) -> Reduced:
        return self.inner.residual(a)

    def kkt(self) -> KKT:
        return self.inner.kkt()

    def physical_acceleration(self, a: Reduced) -> Physical:
        return self.bases.expand(a)
