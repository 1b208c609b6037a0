"""Joint coordinates in which the amplitudes of all bodies move in one subspace."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...basis.basis import Basis
from ...basis.orthonormal import orthonormalize
from ...basis.passed import passed
from ...common.arrays import Time, Vector, as_jax
from ...linalg.dense import multiply
from ...linalg.kkt import KKT
from ...scene.coordinate import Coordinate
from ...system.base import AbstractValidity
from ...system.constraints import ConstraintState
from ...system.reduced import AbstractReducedSystem, Physical, Reduced, start_of
from ...system.state import AbstractState, Energy, Power
from ...system.structure import Structure
from ...system.validity import TrainingBox
from .state import JointState
from .system import JointSystem


class JointSubspace(AbstractReducedSystem):
    """Gᵀ M G ÿ + (C_z G)ᵀ λ = Gᵀ Q, C = 0, on z = z̄ + G y of joint coordinates z.

    y keeps the coordinates of the joints, which hold exactly, and a few amplitudes η = Φ ζ of all
    bodies together. Made by `reduce`.

    - `joint`: the mechanism in all joint coordinates. `modes` G (n, r), `dual` (r, n): y of z.
    - `offset` z̄ (n,): zero but for amplitudes.
    - `q0`, `v0` (r,): the start. `validity`: the box of the ζ of the training. `structure`,
      `summary`: names and words.
    """

    joint: JointSystem
    modes: Float[Array, "n r"]
    dual: Float[Array, "r n"]
    offset: Float[Array, " n"]
    q0: Float[Array, " r"]
    v0: Float[Array, " r"]
    validity: AbstractValidity | None
    structure: Structure = eqx.field(static=True)
    summary: str = eqx.field(static=True)

    @classmethod
    def of(cls, joint: JointSystem, basis: Basis) -> "JointSubspace":
        """Keep the joints of a system, and of its amplitudes the span of a basis of its q."""
        tree, given = joint.tree, np.asarray(basis.modes)
        own = [
            (c, a)
            for row, to in zip(tree.columns.rows, tree.amplitudes.rows, strict=True)
            for c, a in zip(row[tree.size :], to, strict=True)
            if a < tree.n
        ]
        columns, amplitudes = (np.array(x, int) for x in zip(*own, strict=True))
        metric = np.asarray(basis.snapshots.metric)[np.ix_(columns, columns)]
        shapes = np.asarray(orthonormalize(as_jax(given[columns]), as_jax(metric)))
        retained = np.setdiff1d(np.arange(tree.n), amplitudes)
        first = len(retained)  # of the new amplitudes
        r = first + shapes.shape[1]
        modes, dual = np.zeros((tree.n, r), given.dtype), np.zeros((r, tree.n), given.dtype)
        # G is the identity on the joints and Φ on the amplitudes; its dual is Φᵀ M there, since
        # ΦᵀMΦ = 1.
        modes[retained, np.arange(first)] = dual[np.arange(first), retained] = 1
        modes[amplitudes, first:], dual[first:, amplitudes] = shapes, shapes.T @ metric
        offset = np.zeros(tree.n, given.dtype)
        offset[amplitudes] = np.asarray(basis.offset)[columns]
        known = joint.structure
        names = [known.coordinates[i] for i in retained]
        names += [Coordinate("", f"amplitudes {i + 1}") for i in range(shapes.shape[1])]
        firsts = {int(z): i for i, z in enumerate(retained)}
        structure = dataclasses.replace(
            known,
            coordinates=tuple(names),
            rigid=(True,) * first + (False,) * shapes.shape[1],
            quaternions=tuple(firsts[first] for first in known.quaternions),
            states=tuple(firsts[state] for state in known.states),
        )
        summary = f"{joint.summary}, {shapes.shape[1]} modes of {len(amplitudes)} amplitudes"
        none = jnp.zeros(r, given.dtype)
        validity = None
        if basis.decomposition is not None:
            read = np.zeros((shapes.shape[1], len(given)), given.dtype)
            read[:, columns] = shapes.T @ metric
            points = np.asarray(passed(basis.snapshots)) @ read.T
            validity = TrainingBox.of(as_jax(points), root=as_jax(read))
        g, onto, zero = (as_jax(x) for x in (modes, dual, offset))
        rom = cls(joint, g, onto, zero, none, none, validity, structure, summary)
        return rom._starting_at(joint)

    @property
    def full(self) -> AssembledSystem:
        """The system of bodies."""
        return self.joint.full

    @property
    def time(self) -> Float[Array, ""]:
        """The time of the start [s]."""
        return self.joint.time

    def mass(self, q: Reduced) -> Float[Array, "r r"]:
        return self.state(self.time, q, jnp.zeros_like(q)).mass()

    def constraint(self, t: Time, q: Reduced) -> Float[Array, " m"]:
        return self.joint.constraint(t, self._expanded(q))

    def state(self, t: Time, q: Reduced, v: Reduced) -> "SubspaceState":
        inner = self.joint.state(t, self._expanded(q), multiply(self.modes, v))
        return SubspaceState(inner, self.modes)

    def reconstruct(self, t: Time, q: Reduced, v: Reduced) -> tuple[Physical, Physical]:
        return self.joint.reconstruct(t, self._expanded(q), multiply(self.modes, v))

    def restrict(self, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        z, w = self.joint.restrict(q, v)
        return multiply(self.dual, z - self.offset), multiply(self.dual, w)

    def starting_at(self, q: Vector, v: Vector, t: Vector | None = None) -> "JointSubspace":
        return self._starting_at(self.joint.starting_at(q, v, t))

    def with_full(self, full: AssembledSystem) -> "JointSubspace":  # type: ignore[override]
        return self._starting_at(self.joint.with_full(full))

    def _expanded(self, q: Reduced) -> Float[Array, " n"]:
        return self.offset + multiply(self.modes, q)

    def _starting_at(self, joint: JointSystem) -> "JointSubspace":
        z, w = multiply(self.dual, joint.q0 - self.offset), multiply(self.dual, joint.v0)
        rom = dataclasses.replace(self, joint=joint, q0=z, v0=w)
        q0, v0 = start_of(rom, z, w, rom.time)
        return dataclasses.replace(rom, q0=q0, v0=v0)


@dataclasses.dataclass(frozen=True)
class SubspaceState(AbstractState):
    """The state of a mechanism in joint coordinates, seen by few of them."""

    inner: JointState
    modes: Float[Array, "n r"]

    @property
    def q(self) -> Physical:  # type: ignore[override]
        return self.inner.q

    @property
    def v(self) -> Physical:  # type: ignore[override]
        return self.inner.v

    def mass(self) -> Float[Array, "r r"]:
        """Gᵀ M G, from the motions that unit rates give the bodies."""
        return multiply(self.modes.T, multiply(self.inner.mass(), self.modes))

    def apply_mass(self, x: Float[Array, "r *k"]) -> Float[Array, "r *k"]:
        return multiply(self.modes.T, self.inner.apply_mass(multiply(self.modes, x)))

    def jacobian(self) -> Float[Array, "m r"]:
        return multiply(self.inner.jacobian(), self.modes)

    def force(self) -> Reduced:
        return multiply(self.modes.T, self.inner.force())

    def energy(self) -> Energy:
        return self.inner.energy().by_coordinates(self.modes)

    def power(self) -> Power | None:
        return self.inner.power()

    def gaps(self) -> Float[Array, " contacts"] | None:
        return self.inner.gaps()

    def limits(self) -> Float[Array, " effects"] | None:
        return self.inner.limits()

    def residual(self, a: Reduced) -> Reduced:
        return multiply(self.modes.T, self.inner.residual(multiply(self.modes, a)))

    def constraints(self) -> ConstraintState | None:
        return self.inner.constraints()

    def kkt(self) -> KKT:
        return KKT.dense(self.jacobian(), self.mass())

    def physical_acceleration(self, a: Reduced) -> Physical:
        return self.inner.physical_acceleration(multiply(self.modes, a))
