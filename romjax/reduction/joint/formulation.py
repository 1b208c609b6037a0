"""Joint coordinates: the exact motion of a mechanism by the coordinates of its joints."""

import dataclasses
from collections.abc import Iterator
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...assembly.assembled import AssembledSystem
from ...assembly.locate import assembled
from ...basis.basis import AbstractDecomposition, Basis
from ...basis.snapshots import Motions, SnapshotSet
from ...common import precision
from ...common.arrays import Number, as_jax, concrete
from ...common.errors import ReductionError
from ...compiling.program import program_once
from ...scene.coordinate import Coordinate
from ...system.base import AbstractSystem, check_reducible
from ...system.start import Start
from ...system.structure import Structure, without_names
from ..formulation.base import AbstractFormulation
from .counters import check_rotors, counters_of
from .spanning import Spanning, frames_of, spanning_tree
from .subspace import JointSubspace
from .system import JointSystem
from .tree import Tree, plant


class JointCoordinates(AbstractFormulation):
    """The mechanism itself, by the coordinates of the joints of a tree and modal amplitudes.

    Nothing is left out or trained in `reduce(system, formulation=JointCoordinates())`.
    Joints of the tree hold by themselves, without stabilisation, multipliers or counters of full
    turns, and accelerations follow by recursion along the branches, in a time that grows with the
    number of bodies (Featherstone, "Rigid Body Dynamics Algorithms", 2008, chapter 7). Where joints
    close loops, the tree leaves out those with the fewest constraints, farthest from the ground;
    these are cut and keep their constraints, as do drives, and joints that bring no `place` and
    `read` of their own. `summary` says which. First-order states of effects follow the joints, and
    the inertia of a rotor is that of its joint's coordinate.

    With a basis, as `JointCoordinates().basis` makes it of a run, the amplitudes of all bodies move
    in a subspace of few; the joints stay as they are, so that one run trains for other motions too.

    **Arguments:**

    - `time`: when the start of the system holds [s], and runs of the model begin; drives depend on
      it.
    """

    name: ClassVar[str] = "joint"
    keeps_states: ClassVar[bool] = True
    in_subspace: ClassVar[bool] = False

    time: Number = 0.0

    def basis(
        self, system: AbstractSystem, motion: Motions, decomposition: AbstractDecomposition
    ) -> Basis:
        """The decomposition of the amplitudes alone, since the joints are kept."""
        snapshots = SnapshotSet.of(motion)
        # Snapshots with the other coordinates set to zero: their decomposition has modes of
        # amplitudes alone.
        mask = np.zeros(system.n, np.asarray(snapshots.q).dtype)
        mask[_amplitudes(system)] = 1
        basis = decomposition(snapshots.mapped(as_jax(np.diag(mask))))
        # The snapshots themselves stay whole: errors of models are measured on the entire motion.
        return dataclasses.replace(basis, snapshots=snapshots)

    def reduce(
        self, system: AbstractSystem, basis: Basis | None = None
    ) -> JointSystem | JointSubspace:
        """Raises ReductionError for a system that is reduced already, for a start at which joints
        do not hold, for a mechanism without freedoms, for a basis where nothing deforms or with
        more modes than bodies have amplitudes, and for full turns and inertias of joints that are
        no coordinates of joints of the tree.
        """
        full = assembled("reduce", system)
        if full is not system:
            raise ReductionError(
                "reduce: JointCoordinates are those of all bodies, but the system is reduced "
                "already; reduce what romjax.assemble(scene) returns."
            )
        if basis is not None:
            _check_basis(full, basis)
        _check_start(full, self.time)
        joint = in_joint_coordinates(full, self.time)
        check_rotors(full, joint.lift, joint.q0)
        return joint if basis is None else JointSubspace.of(joint, basis)


def _check_basis(full: AssembledSystem, basis: Basis) -> None:
    """Refuse a basis where nothing deforms, and one that cannot be of amplitudes alone."""
    count, modes = len(_amplitudes(full)), basis.modes.shape[1]
    if not count:
        raise ReductionError(
            "reduce: JointCoordinates() keep all joints and take a basis for amplitudes alone, "
            "but no body of the mechanism deforms; call "
            "romjax.reduce(system, formulation=romjax.JointCoordinates())."
        )
    if modes > count:
        raise ReductionError(
            f"reduce: the basis has {modes} modes, but the bodies have {count} amplitudes in all, "
            "and JointCoordinates() take a basis for these alone; make it by "
            "romjax.JointCoordinates().basis(system, run, romjax.POD())."
        )


def _amplitudes(system: AbstractSystem) -> list[int]:
    """The coordinates that are amplitudes."""
    return [i for i, rigid in enumerate(system.structure.rigid) if not rigid]


def in_joint_coordinates(full: AssembledSystem, time: Number = 0.0) -> JointSystem:
    """The system of a mechanism, from the start nearest to its own at `time` [s].

    Raises ReductionError for one without freedoms.
    """
    spanning = spanning_tree(full)
    tree = plant(full, spanning)
    if tree.n == 0:
        raise ReductionError(
            "reduce: the joints leave the mechanism no freedom, so that it has no joint "
            "coordinates; take out the joints that lock it."
        )
    structure = _structure(full, tree, spanning)
    return JointSystem.of(full, spanning, structure, _summary(full, tree, spanning), time)


def size_in_joint_coordinates(full: AssembledSystem) -> tuple[int, int] | None:
    """How many joint coordinates a system has, and constraints of joints that are cut; None where
    it has none. Something is compiled only where rotors turn.
    """
    try:
        check_reducible(full, JointCoordinates())
        spanning = spanning_tree(full)
        tree = plant(full, spanning)
        counters = counters_of(full, tree, spanning, None)
        # Whether rotors turn with joints of the tree is known only from the residuals of their
        # counters, so that the lift has to be made.
        if counters is not None and counters.rotors:
            joint = in_joint_coordinates(full)
            check_rotors(full, joint.lift, joint.q0)
    except ReductionError:
        return None
    return (tree.n, len(list(_cut_rows(full, spanning)))) if tree.n else None


def faster_size(full: AssembledSystem) -> tuple[int, int] | None:
    """The size in joint coordinates where the exact model is known to be faster: of trees, and of
    all in space; None elsewhere.
    """
    size, space = size_in_joint_coordinates(full), bool(full.structure.quaternions)
    return size if size and size[0] < full.n and (space or not size[1]) else None


def _check_start(full: AssembledSystem, time: Number) -> None:
    """Raise ReductionError unless the joints hold at the start, as joint coordinates always do."""
    if full.m == 0:
        return
    t = jnp.asarray(time, full.q0.dtype)
    closed, fits, worst = (concrete(x) for x in _start(without_names(full), t))
    if closed is None or fits is None or worst is None or (closed and fits):
        return
    what = "apart" if not closed else "moving apart"
    raise ReductionError(
        f"reduce: at the start, t = {float(t):g} s, {full.structure.constraints[int(worst)]} is "
        f"{what}; joint coordinates begin where all joints hold. Put the scene together by "
        "romjax.consistent_scene(scene); or, where drives have it begin at another time than 0, "
        "give that: romjax.JointCoordinates(time=…)."
    )


@program_once
def _start(
    full: AssembledSystem, t: Float[Array, ""]
) -> tuple[Bool[Array, ""], Bool[Array, ""], Int[Array, ""]]:
    """Whether the joints hold at the start, and their rates, and the worst of them."""
    share = precision.of(full.q0.dtype).start_tolerance
    start = Start.of(full, t, full.q0, full.v0, share)
    off = jnp.abs(start.violation) / start.allowed
    rate = jnp.abs(start.rate) / start.allowed_rate
    return start.closed, start.fits, jnp.argmax(jnp.where(start.closed, rate, off))


def _structure(full: AssembledSystem, tree: Tree, spanning: Spanning) -> Structure:
    known = full.structure
    names = [known.constraints[row] for row in _cut_rows(full, spanning)]
    by_number = list(frames_of(full))
    coordinates: dict[int, Coordinate] = {}
    amplitudes = dict[int, int]()
    for link in tree.links:
        for place, columns in zip(link.bodies, link.coordinates.rows, strict=True):
            branch = spanning.branches[place]
            label = known.coordinates[by_number[branch.body]].owner
            if branch.link is not None:
                label = _label(full, branch.link.group, branch.link.row)
            for column, (name, unit) in zip(columns, link.joints.freedoms, strict=True):
                words = f"{name} of {label}"
                coordinates[column] = Coordinate(label, name, unit, description=words)
    for own, columns in zip(tree.columns.rows, tree.amplitudes.rows, strict=True):
        for given, column in zip(own[tree.size :], columns, strict=True):
            if column < tree.n:
                coordinates[column] = known.coordinates[given]
                amplitudes[column] = given
    columns, states, _ = tree.states.rows
    coordinates |= {z: known.coordinates[i] for z, i in zip(states, columns, strict=True)}
    return Structure(
        coordinates=tuple(coordinates[i] for i in range(tree.n)),
        constraints=tuple(names),
        rigid=tuple(i not in amplitudes for i in range(tree.n)),
        flexible=known.flexible,
        ringing=known.ringing,
        loops=bool(names),
        contacts=known.contacts,
        quaternions=tuple(row[0] for row in tree.spun.rows),
        states=states,
        amplitudes=tuple(amplitudes.items()),
    )


def _label(full: AssembledSystem, group: int, row: int) -> str:
    """The label of a joint, from the constraints that it has."""
    words = full.structure.constraints[full.joints[group].rows.rows[row][0]]
    return words.removeprefix("joint ").strip("'")


def _cut_rows(full: AssembledSystem, spanning: Spanning) -> Iterator[int]:
    for g, group in enumerate(full.joints):
        for number, row in spanning.cut:
            if number == g:
                yield from group.rows.rows[row]


def _summary(full: AssembledSystem, tree: Tree, spanning: Spanning) -> str:
    joined = sum(branch.link is not None for branch in spanning.branches)
    words = [f"{joined} joint{'s' * (joined != 1)} of a tree of {tree.count} bodies"]
    free = tree.count - joined
    if free:
        words.append(f"{free} free")
    if spanning.cut:
        names = dict.fromkeys(_label(full, g, row) for g, row in spanning.cut)
        words.append(f"cut: {', '.join(map(repr, names))}")
    return ", ".join(words)
