"""Hyper-reduction: steps whose cost does not grow with the number of bodies."""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...assembly.assembled import AssembledSystem
from ...assembly.locate import assembled
from ...basis.basis import AbstractDecomposition, Basis
from ...basis.snapshots import Motions
from ...common import compat
from ...common.errors import InputError, ReductionError, UnsuitedError
from ...compiling.program import program_once
from ...system.base import AbstractSystem
from ...system.validity import TrainingBox
from ..formulation.base import AbstractFormulation
from ..formulation.minimal import Minimal
from ..lift.closed_form import ClosedFormLift
from ..system import ReducedSystem
from .kinematics import Rotations, SampledKinematics, independent
from .loads import linear_effects
from .system import HyperReducedSystem, Sample
from .validity import SampledBox
from .weights import body_terms, sparse_weights

# Snapshots that are trained with, and states beside them, in a box that is wider by a factor.
_SNAPSHOTS, _STATES, _WIDER = 100, 200, 1.5
# Tangents that vary by less do not turn.
_STEADY = 1e-10
# Positions may miss their exact values by so many times `tol`, relative to their size.
_TIMES = 100.0


class HyperReduced(AbstractFormulation):
    """Minimal coordinates of a tree of hinged rigid bodies, of which a few stand for all.

    Two levels of the reduced model z̈(t, z, w) of `Minimal`, in the coordinates of the same basis:
    the Lagrangian is that of sampled bodies, L(z, w) = Σ ξ_b L_b with weights ξ ≥ 0, and their
    positions, sums of arms h e^{iθ} of all angles θ before them, are combinations of a few
    rotations, A e^{iθ_K(z)}. Both remain functions of z from which the equations follow by
    d'Alembert's principle, so the mass matrix stays symmetric and positive definite and energy is
    conserved. Effects stay exact: those linear in z and w, such as torsion springs in hinges, as
    matrices, all others on the bodies that they act on.

    Trained without another run, on the accelerations of the minimal model at the snapshots and in a
    box around them. The weights are those of energy-conserving sampling and weighting (Farhat,
    Avery, Chapman, Cortial, "Dimensional reduction of nonlinear finite element dynamic models with
    finite rotations and energy-based mesh sampling and weighting for computational efficiency",
    IJNME 98, 625 (2014), doi:10.1002/nme.4668), of bodies and with inertia.

    **Arguments:**

    - `tol`: what may differ from the minimal model of the same basis, about, in virtual work,
      inertia and rotations, relative to their size.

    Raises InputError for a `tol` outside of 0 to 1.
    """

    name: ClassVar[str] = "hyper"
    in_subspace: ClassVar[bool] = False

    tol: float = eqx.field(static=True, default=1e-5)

    def __check_init__(self) -> None:
        if not 0 < self.tol < 1:
            raise InputError(f"HyperReduced: tol={self.tol}, but it must lie between 0 and 1.")

    def basis(
        self, system: AbstractSystem, motion: Motions, decomposition: AbstractDecomposition
    ) -> Basis:
        """Return the basis of `Minimal`, which is one of the independent coordinates."""
        return Minimal().basis(system, motion, decomposition)

    def reduce(self, system: AbstractSystem, basis: Basis) -> HyperReducedSystem:
        """Raises ReductionError for bodies that deform, joints that close loops, slide or move with
        time, and for a basis without snapshots, which there is nothing to train with.
        """
        if any(compat.is_traced(x) for x in jax.tree.leaves((system, basis))):
            raise ValueError(
                "reduce: bodies are sampled outside of jit, grad and vmap; inside, take the same "
                "ones of another system by rom.with_full(system)."
            )
        full = _checked(system, basis)
        exact = Minimal().reduce(full, basis)
        if not isinstance(exact.lift, ClosedFormLift):
            raise _refusal("its joints slide or close loops")
        lift = exact.lift
        z, w = _states(lift, basis)
        sample = self._sample(exact, lift, z, w)
        rom = HyperReducedSystem.of(
            full,
            lift,
            sample,
            (exact.q0, exact.v0, exact.time),
            exact.validity,
            exact.structure,
            f"{exact.summary}; {sum(map(len, sample.bodies))} of "
            f"{sum(len(g.coordinates.rows) for g in full.bodies)} bodies, "
            f"{len(sample.rotations.sampled)} of {len(sample.rotations.angles)} angles",
        )
        missed = float(_missed(full, lift, rom.kinematics, sample.columns, jnp.asarray(z)))
        if not missed <= _TIMES * self.tol:
            raise _refusal(f"positions do not follow from angles alone, by {missed:.1e} of them")
        assert isinstance(exact.validity, TrainingBox)
        box = SampledBox.of_training(exact.validity, rom, jnp.asarray(z), jnp.asarray(w))
        return dataclasses.replace(rom, validity=box)

    def _sample(
        self, exact: ReducedSystem, lift: ClosedFormLift, z: np.ndarray, w: np.ndarray
    ) -> Sample:
        full = assembled("Hyper", exact)
        tables = [group.coordinates.array.astype(int) for group in full.bodies]
        linear = linear_effects(full, lift, jnp.asarray(z))
        others = tuple(i for i in range(len(full.effects)) if i not in linear)
        loaded = _loaded(full, others)
        terms = body_terms(exact, jnp.asarray(z), jnp.asarray(w))
        weights = sparse_weights(tuple(np.asarray(x) for x in terms), self.tol)
        rows, chosen, first = list[tuple[int, ...]](), list[Any](), 0
        for table in tables:
            own = weights[first : first + len(table)]
            # Bodies that effects act on are sampled for their poses, though their own weight may be
            # zero.
            used = np.flatnonzero((own > 0) | np.isin(table[:, 0], loaded))
            rows.append(tuple(int(i) for i in used))
            chosen.append(jnp.asarray(own[used]))
            first += len(table)
        bodies = np.concatenate([t[list(own)] for t, own in zip(tables, rows, strict=True)])
        moving = np.asarray(_tangents(full, lift, jnp.asarray(z[:: len(z) // 5])))
        # What does not turn is affine in z, and needs no rotations.
        varied = np.max(np.ptp(moving, axis=0), axis=1) > _STEADY * np.max(np.abs(moving))
        turned = [(x, y) for x, y, _ in bodies.tolist() if varied[x] or varied[y]]
        every = np.concatenate(tables)[:, 2]
        angles = np.flatnonzero(np.isin(independent(lift), every))
        rotations = Rotations.of(lift, angles, z, self.tol)
        columns = tuple(int(i) for i in bodies.reshape(-1))
        return Sample(tuple(rows), tuple(chosen), linear, others, columns, tuple(turned), rotations)


def _checked(system: AbstractSystem, basis: Basis) -> AssembledSystem:
    full = assembled("reduce", system)
    if full is not system:
        raise _refusal("the system is reduced already")
    if full.structure.quaternions:
        raise _refusal("bodies move in space")
    if full.structure.flexible:
        raise _refusal("there are bodies that deform")
    if basis.decomposition is None:
        raise ReductionError(
            "reduce: bodies are sampled by snapshots, which given modes lack; take a basis of a "
            "run, such as that of romjax.Minimal() in these modes."
        )
    if full.m and compat.depends_on_first(full.constraint, jnp.zeros(()), full.q0):
        raise _refusal("joints move with time")
    return full


def _refusal(why: str) -> UnsuitedError:
    return UnsuitedError(
        f"reduce: hyper-reduction is for trees of rigid bodies on hinges, but here {why}."
    )


def _states(lift: ClosedFormLift, basis: Basis) -> tuple[np.ndarray, np.ndarray]:
    """z, w (K, r): of snapshots, and of a box around them."""
    stride = -(-len(basis.snapshots.t) // _SNAPSHOTS)
    dual, snapshots = np.asarray(lift.dual), basis.snapshots
    z = (np.asarray(snapshots.q)[::stride] - np.asarray(lift.offset)) @ dual.T
    w = np.asarray(snapshots.v)[::stride] @ dual.T
    return _with_box(z, 0), _with_box(w, 1)


def _with_box(x: np.ndarray, seed: int) -> np.ndarray:
    low, high = np.min(x, axis=0), np.max(x, axis=0)
    middle, half = (low + high) / 2, _WIDER * (high - low) / 2
    others = np.random.default_rng(seed).uniform(-1, 1, (_STATES, x.shape[1]))
    return np.concatenate([x, middle + half * others])


def _loaded(full: AssembledSystem, effects: tuple[int, ...]) -> np.ndarray:
    """First coordinates of the bodies that effects act on."""
    if full.effect_markers is None:
        return np.zeros(0, int)
    owners = full.effect_markers.frames.array[:, 0].astype(int)
    own = [owners[:0], *(np.concatenate(full.effects[i].markers.take(owners)) for i in effects)]
    return np.concatenate(own)


@program_once
def _tangents(full: AssembledSystem, lift: ClosedFormLift, z: Any) -> Any:
    zero = jnp.zeros_like(z[0])
    return jax.lax.map(lambda z: lift.motion(full, lift.time, z, zero).tangent, z)


@program_once
def _missed(
    full: AssembledSystem, lift: ClosedFormLift, how: SampledKinematics, columns: Any, z: Any
) -> Any:
    """Largest error of sampled coordinates, relative to the largest coordinate."""
    zero, own = jnp.zeros_like(z[0]), np.array(columns, int)

    def one(z: Any) -> Any:
        right = lift.position(full, lift.time, z)[own]
        return jnp.max(jnp.abs(how.motion(z, zero).q - right)), jnp.max(jnp.abs(right))

    error, size = jax.lax.map(one, z)
    return jnp.max(error) / jnp.max(size)
