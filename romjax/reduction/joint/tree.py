"""The tree of a mechanism: which coordinates are whose, and the numbers of its joints and ports."""

from typing import Any

import equinox as eqx
import jax
import numpy as np

from ...assembly.assembled import AssembledSystem
from ...assembly.kinematics import Markers
from ...common.arrays import pick
from ...common.inheritance import goes_with
from ...linalg.indexing import Index
from ...scene.body.base import AbstractBody
from .free import Free
from .ports import Still, ports_of
from .spanning import Branch, Spanning, frames_of


class Links(eqx.Module):
    """The joints of one kind in the tree, in the order of the bodies that they hold.

    - `joints`: stacked. `bodies`: those that they hold, by their places in the tree.
    - `reversed`: whether they hold the bodies by their second markers.
    - `coordinates` (count, freedoms): theirs among z.
    """

    joints: Any
    bodies: tuple[int, ...] = eqx.field(static=True)
    reversed: bool = eqx.field(static=True)
    coordinates: Index = eqx.field(static=True)


class Tree(eqx.Module):
    """Bodies in the order of a tree, each after the one that holds it, its parent.

    - `links`: the joints. `ports`: the markers of joints, on the parent of each body, then on each
      body; `still`: these, where no body deforms. `columns`: the frame of each body in q,
      then its amplitudes; n stands for none.
    - `parents`: by their places in the tree; their number stands for the ground.
    - `motions` (bodies, freedoms + modes): of each body, its joint's rates and those of its
      amplitudes, among the rates u of the tree, as many as freedoms; their number stands for none.
    - `amplitudes` (bodies, modes): among z. `invariants`: of the groups of bodies, whether those
      of their inertia give the forces of motion.
    - `states`: the first-order states of effects in q, among z, and among the rates, a row each.
    - `plain`: the coordinates that are no quaternions, among z, and `spun` (balls, 4) those that
      are; u has the rates of the former, and the angular velocities `spins` (balls, 3).
    """

    links: tuple[Links, ...]
    ports: Markers
    still: Still | None
    columns: Index = eqx.field(static=True)
    parents: tuple[int, ...] = eqx.field(static=True)
    motions: Index = eqx.field(static=True)
    amplitudes: Index = eqx.field(static=True)
    states: Index = eqx.field(static=True)
    plain: Index = eqx.field(static=True)
    plain_rates: Index = eqx.field(static=True)
    spun: Index = eqx.field(static=True)
    spins: Index = eqx.field(static=True)
    n: int = eqx.field(static=True)
    rates: int = eqx.field(static=True)
    freedoms: int = eqx.field(static=True)
    invariants: tuple[bool, ...] = eqx.field(static=True)
    size: int = eqx.field(static=True)  # of a frame in q

    @property
    def count(self) -> int:
        """How many bodies there are."""
        return len(self.parents)

    @property
    def modes(self) -> int:
        """The modes of the body that has most."""
        return self.amplitudes.width

    @property
    def is_chain(self) -> bool:
        """Whether each body holds the next one."""
        return self.parents == (self.count, *range(self.count - 1))

    @property
    def roots(self) -> tuple[int, ...]:
        """The first body of the branch that each body is on."""
        roots = list[int]()
        for i, parent in enumerate(self.parents):
            roots.append(i if parent == self.count else roots[parent])
        return tuple(roots)

    @property
    def ancestors(self) -> list[np.ndarray]:
        """The body 1, 2, 4 … links before each; their number where there is none."""
        levels, before = [], np.array([*self.parents, self.count])
        while np.any(before < self.count):
            levels.append(before[:-1].astype(np.uint32))
            before = before[before]
        return levels


def plant(system: AssembledSystem, spanning: Spanning) -> Tree:
    """Make the tree of a system with the numbers that it holds."""
    branches = spanning.branches
    place = {branch.body: i for i, branch in enumerate(branches)}
    parents = tuple(place.get(branch.parent, len(branches)) for branch in branches)
    owned = _owned(system, branches)
    kinds = [_kind(system, branch) for branch in branches]
    freedoms = [_freedoms(joint) for joint, _ in kinds]
    states = system.structure.states
    table = _Coordinates(freedoms, [len(columns) for _, columns in owned], len(states))
    frame = 3 if _dimension(system) == 2 else 7
    most = max(len(columns) for _, columns in owned)
    links = list[Links]()
    grouped: dict[Any, list[int]] = {}
    for i, branch in enumerate(branches):
        link = branch.link
        # Joints of one kind are stacked; those that hold bodies by their second markers are another
        # kind, since their poses are inverted.
        key = None if link is None else (link.group, link.b == branch.body)
        grouped.setdefault(key, []).append(i)
    for key, members in grouped.items():
        coordinates = Index.of([table.coordinates[i][0] for i in members])
        if key is None:
            joints: Any = Free(frame)
        else:
            rows = np.array([_link(branches[i]).row for i in members], int)
            stacked = system.joints[key[0]].joints
            joints = jax.tree.map(lambda x, rows=rows: pick(x, rows), stacked)
        links.append(Links(joints, tuple(members), key is not None and key[1], coordinates))
    ports = ports_of(system, branches, owned, frame, most)
    return Tree(
        links=tuple(links),
        ports=ports,
        still=Still.of(ports, len(branches)) if most == 0 else None,
        columns=Index.of([(*f, *a, *[system.n] * (most - len(a))) for f, a in owned]),
        parents=parents,
        motions=Index.of(table.motions),
        amplitudes=Index.of(table.amplitudes),
        states=Index.of([states, *table.states]),
        plain=Index.of([table.plain]),
        plain_rates=Index.of([table.plain_rates]),
        spun=Index.of(table.spun),
        spins=Index.of(table.spins),
        n=table.n,
        rates=table.rates,
        freedoms=table.freedoms,
        invariants=tuple(_knows_invariants(group.bodies) for group in system.bodies),
        size=frame,
    )


class _Coordinates:
    """Numbers the coordinates z and the rates u of a tree, body by body, then those of states."""

    def __init__(self, freedoms: list[tuple[int, bool]], modes: list[int], states: int):
        self.n = self.rates = 0
        self.coordinates, self.spun, self.spins = [], list[range](), list[range]()
        self.plain, self.plain_rates = list[int](), list[int]()
        own = list[tuple[list[int], list[int]]]()
        for (count, turns), bending in zip(freedoms, modes, strict=True):
            # A quaternion has four coordinates, but the three rates of an angular velocity.
            z = self._take(count - 4 if turns else count)
            rates = list(z[1])
            coordinates = list(z[0])
            if turns:
                self.spun.append(range(self.n, self.n + 4))
                self.spins.append(range(self.rates, self.rates + 3))
                coordinates += self.spun[-1]
                rates += self.spins[-1]
                self.n, self.rates = self.n + 4, self.rates + 3
            bent = self._take(bending)
            self.coordinates.append((coordinates, list(bent[0])))
            own.append((rates, list(bent[1])))
        self.states = self._take(states)
        self.freedoms = max(len(rates) for rates, _ in own)
        most = max(modes)
        self.motions = [
            (*r, *[self.rates] * (self.freedoms - len(r)), *b, *[self.rates] * (most - len(b)))
            for r, b in own
        ]
        self.amplitudes = [(*b, *[self.n] * (most - len(b))) for _, b in self.coordinates]

    def _take(self, count: int) -> tuple[range, range]:
        z, u = range(self.n, self.n + count), range(self.rates, self.rates + count)
        self.plain += z
        self.plain_rates += u
        self.n, self.rates = self.n + count, self.rates + count
        return z, u


def _knows_invariants(bodies: AbstractBody) -> bool:
    """Whether bodies in space, stacked, have invariants, which a subclass with a mass of its own
    has not inherited.
    """
    if bodies.dimension == 2 or not goes_with(bodies, "invariants", "mass_matrix"):
        return False
    known = list[bool]()

    def look(body: AbstractBody) -> int:
        known.append(body.invariants() is not None)
        return 0

    jax.eval_shape(jax.vmap(look), bodies)
    return known[0]


def _dimension(system: AssembledSystem) -> int:
    return system.bodies[0].bodies.dimension


def _link(branch: Branch) -> Any:
    assert branch.link is not None
    return branch.link


def _kind(system: AssembledSystem, branch: Branch) -> tuple[Any, bool]:
    """The joint that holds a body, stacked with others; and whether by its second marker."""
    link = branch.link
    if link is None:
        return Free(3 if _dimension(system) == 2 else 7), False
    return system.joints[link.group].joints, link.b == branch.body


def _freedoms(joint: Any) -> tuple[int, bool]:
    assert joint.freedoms is not None
    return len(joint.freedoms), joint.turns_freely


def _owned(
    system: AssembledSystem, branches: tuple[Branch, ...]
) -> list[tuple[list[int], list[int]]]:
    """The columns of the frame and of the amplitudes of each body."""
    by_number = {number: (first, g) for first, (number, g, _) in frames_of(system).items()}
    columns = []
    for branch in branches:
        first, g = by_number[branch.body]
        group = system.bodies[g]
        row = next(row for row in group.coordinates.rows if row[0] == first)
        size = group.bodies.frame_size
        columns.append((list(row[:size]), list(row[size:])))
    return columns
