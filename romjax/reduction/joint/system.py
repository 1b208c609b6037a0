"""A mechanism in the coordinates of its joints and the amplitudes of its bodies."""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly.assembled import AssembledSystem
from ...assembly.locate import assembled
from ...common.arrays import Number, Time, Vector, as_array
from ...common.compat import is_traced
from ...compiling.program import program_once
from ...system.base import AbstractSystem, AbstractValidity
from ...system.reduced import (
    AbstractReducedSystem,
    Physical,
    Reduced,
    check_alike,
    moved_start,
    started,
)
from ...system.structure import Structure
from .along import AlongJoints
from .counters import check_rotors, counters_of
from .cuts import Cut
from .lift import TreeLift
from .redundant import rank_of_rows
from .spanning import Spanning
from .state import JointState
from .tree import Tree, plant


class JointSystem(AbstractReducedSystem):
    """M(z) z̈ + C_zᵀ λ = Q(t, z, ż), C(t, z) = 0, by the coordinates z of the joints of a tree.

    The motion is that of the full system, exactly: the joints of the tree hold by themselves, and
    only those that are cut keep their constraints. Made by `reduce`.

    - `full`: the system of bodies. `spanning`: its tree. `lift`: q of z. `cut`: the joints that
      close loops, or have no coordinates of their own. `along`: the effects along coordinates z.
    - `q0`, `v0` (r,): the start, at `time` [s]. `structure`, `summary`: names and words.
    """

    is_exact: ClassVar[bool] = True

    full: AssembledSystem
    lift: TreeLift
    cut: Cut
    along: AlongJoints
    q0: Float[Array, " r"]
    v0: Float[Array, " r"]
    time: Float[Array, ""]
    spanning: Spanning = eqx.field(static=True)
    structure: Structure = eqx.field(static=True)
    summary: str = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        full: AssembledSystem,
        spanning: Spanning,
        structure: Structure,
        summary: str,
        time: Number,
    ) -> "JointSystem":
        """Make the system with the start of the full one, which holds at `time` [s].

        `full`, `spanning`, `structure` and `summary` are fields.
        """
        z = jnp.zeros(len(structure.coordinates), full.q0.dtype)
        time = jnp.asarray(time, z.dtype)
        lift, cut, along = _parts(full, spanning, None)
        rom = cls(full, lift, cut, along, z, z, time, spanning, structure, summary)
        return rom.starting_at(full.q0, full.v0)._without_repeated_rows()

    @property
    def tree(self) -> Tree:
        """The bodies in the order of the tree."""
        return self.lift.tree

    @property
    def validity(self) -> AbstractValidity | None:
        """The results hold where those of the full system do."""
        return None

    def mass(self, q: Reduced) -> Float[Array, "r r"]:
        return self.state(self.time, q, jnp.zeros_like(q)).mass()

    def constraint(self, t: Time, q: Reduced) -> Float[Array, " m"]:
        if not self.m:
            return jnp.zeros(0, q.dtype)
        return self.cut.joints.residual(t, self.lift.position(q))

    def state(self, t: Time, q: Reduced, v: Reduced) -> JointState:
        return JointState(self, t, q, v)

    def reconstruct(self, t: Time, q: Reduced, v: Reduced) -> tuple[Physical, Physical]:
        state = self.state(t, q, v)
        return state.q, state.v

    def restrict(self, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
        z, w = _restricted(self.lift, q, v)
        return z, w

    def starting_at(self, q: Vector, v: Vector, t: Vector | None = None) -> "JointSystem":
        q, v = as_array(q), as_array(v)
        lift = _signed(self.lift, q)
        z, w = _restricted(lift, q, v)
        rom = dataclasses.replace(self, lift=lift)
        return started(rom, z, w, self.time if t is None else t)

    def with_full(self, full: AbstractSystem) -> "JointSystem":
        check_alike(self.full, full)
        other = assembled("with_full", full)
        lift, cut, along = _parts(other, self.spanning, self.lift)
        # While JAX traces, as many rows repeat others as before.
        cut = dataclasses.replace(cut, rank=self.cut.rank)
        rom = dataclasses.replace(self, full=other, lift=lift, cut=cut, along=along)
        rom = started(rom, *moved_start(self, rom), self.time)
        if is_traced(rom.q0):
            return rom
        check_rotors(other, rom.lift, rom.q0)
        return rom._without_repeated_rows()

    def _without_repeated_rows(self) -> "JointSystem":
        """The system that knows how many rows of cut joints repeat others."""
        rank = rank_of_rows(self)
        return dataclasses.replace(self, cut=dataclasses.replace(self.cut, rank=rank))


def _parts(
    full: AssembledSystem, spanning: Spanning, before: TreeLift | None
) -> tuple[TreeLift, Cut, AlongJoints]:
    """The lift, with the lengths of quaternions that it had before, the cut joints, and the effects
    along coordinates.
    """
    tree = plant(full, spanning)
    lengths = before.lengths if before is not None else None
    if before is None and full.structure.quaternions:
        lengths = as_array(np.ones(tree.count))
    counters = counters_of(full, tree, spanning, None if before is None else before.counters)
    lift, cut = TreeLift(tree, lengths, counters, full.n), Cut.of(full, tree, spanning.cut)
    return lift, cut, AlongJoints.of(full, tree, spanning)


@program_once
def _restricted(lift: TreeLift, q: Physical, v: Physical) -> tuple[Reduced, Reduced]:
    both: tuple[Array, Array] = jax.jvp(lift.restrict, (q,), (v,))
    return both


@program_once
def _signed(lift: TreeLift, q: Physical) -> TreeLift:
    """The lift whose quaternions have the lengths and signs, and whose counters the turns, of q."""
    if lift.lengths is None:
        return lift
    plain = dataclasses.replace(lift, lengths=jnp.ones_like(lift.lengths), counters=None)
    z = plain.restrict(q)
    turns = np.array([row[3:7] for row in lift.tree.columns.rows])
    p, given = plain.position(z)[turns], q[turns]
    # A quaternion and its opposite turn alike: the start says which of both it is.
    signs = jnp.where(jnp.sum(p * given, axis=1) < 0, -1, 1)
    signed = dataclasses.replace(lift, lengths=signs * jnp.sqrt(jnp.sum(given**2, axis=1)))
    if lift.counters is None:
        return signed
    return dataclasses.replace(signed, counters=lift.counters.starting_at(signed, z, q))
