"""The tree of a mechanism: which coordinates are whose, and the numbers of its joints and ports."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...assembly import planar, spatial
from ...assembly.assembled import AssembledSystem
from ...assembly.bending import Bending
from ...assembly.kinematics import Markers
from ...common.arrays import as_jax, concatenate, pick
from ...common.compat import is_traced
from ...linalg.indexing import Index
from .free import Free
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
      body. `columns`: the frame of each body in q, then its amplitudes; n stands for none.
    - `parents`: by their places in the tree; their number stands for the ground.
    - `motions` (bodies, freedoms + modes): of each body, its joint's rates and those of its
      amplitudes, among the rates u of the tree, as many as freedoms; their number stands for none.
    - `amplitudes` (bodies, modes): among z.
    - `plain`: the coordinates that are no quaternions, among z, and `spun` (balls, 4) those that
      are; u has the rates of the former, and the angular velocities `spins` (balls, 3).
    """

    links: tuple[Links, ...]
    ports: Markers
    columns: Index = eqx.field(static=True)
    parents: tuple[int, ...] = eqx.field(static=True)
    motions: Index = eqx.field(static=True)
    amplitudes: Index = eqx.field(static=True)
    plain: Index = eqx.field(static=True)
    plain_rates: Index = eqx.field(static=True)
    spun: Index = eqx.field(static=True)
    spins: Index = eqx.field(static=True)
    n: int = eqx.field(static=True)
    rates: int = eqx.field(static=True)
    freedoms: int = eqx.field(static=True)
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
    table = _Coordinates(freedoms, [len(columns) for _, columns in owned])
    frame = 3 if _dimension(system) == 2 else 7
    most = max(len(columns) for _, columns in owned)
    links = list[Links]()
    grouped: dict[Any, list[int]] = {}
    for i, branch in enumerate(branches):
        link = branch.link
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
    return Tree(
        links=tuple(links),
        ports=_ports(system, branches, owned, frame, most),
        columns=Index.of([(*f, *a, *[system.n] * (most - len(a))) for f, a in owned]),
        parents=parents,
        motions=Index.of(table.motions),
        amplitudes=Index.of(table.amplitudes),
        plain=Index.of([table.plain]),
        plain_rates=Index.of([table.plain_rates]),
        spun=Index.of(table.spun),
        spins=Index.of(table.spins),
        n=table.n,
        rates=table.rates,
        freedoms=table.freedoms,
        size=frame,
    )


class _Coordinates:
    """Numbers the coordinates z and the rates u of a tree, body by body."""

    def __init__(self, freedoms: list[tuple[int, bool]], modes: list[int]):
        self.n = self.rates = 0
        self.coordinates, self.spun, self.spins = [], list[range](), list[range]()
        self.plain, self.plain_rates = list[int](), list[int]()
        own = list[tuple[list[int], list[int]]]()
        for (count, turns), bending in zip(freedoms, modes, strict=True):
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
    found = []
    for branch in branches:
        first, g = by_number[branch.body]
        group = system.bodies[g]
        row = next(row for row in group.coordinates.rows if row[0] == first)
        size = group.bodies.frame_size
        found.append((list(row[:size]), list(row[size:])))
    return found


def _ports(
    system: AssembledSystem,
    branches: tuple[Branch, ...],
    owned: list[tuple[list[int], list[int]]],
    frame: int,
    most: int,
) -> Markers:
    """The markers of the joints on the parents, then on the bodies.

    Those of free bodies are their frames, and the origin.
    """
    d, count = 2 if frame == 3 else 3, len(branches)
    every, rows = system.joint_markers, list[int]()
    fresh = 0 if every is None else len(every.points)  # one more row: a frame of a body
    for side in range(2):
        for branch in branches:
            link = branch.link
            if link is None:
                rows.append(fresh)
                continue
            first = (link.a == branch.body) == (side == 1)
            blocks = system.joints[link.group].markers
            rows.append(blocks.start + link.row + (0 if first else blocks.count))
    taken, dtype = np.array(rows, int), system.q0.dtype
    turn = np.zeros((), dtype) if d == 2 else np.array([1, 0, 0, 0], dtype)

    def with_origin(given: Any, other: np.ndarray) -> Array:
        more: Any = other[None] if given is None else _appended(given, other)
        return pick(more, taken)

    motions = 3 if d == 2 else 6
    shapes: Any = with_origin(
        None if every is None else _padded(every.shapes, most), np.zeros((motions, most), dtype)
    )
    second = None
    if every is not None and every.foreshortening is not None:
        wide = _padded(every.foreshortening, most, axes=2)
        second = with_origin(wide, np.zeros((d, most, most), dtype))
    n = system.n
    ground = list((planar if d == 2 else spatial).ground(n))
    places = {branch.body: i for i, branch in enumerate(branches)}
    owners = [places.get(branch.parent) for branch in branches] + list(range(count))
    frames = [ground if i is None else owned[i][0] for i in owners]
    bent = [[] if i is None else owned[i][1] for i in owners]
    return Markers(
        with_origin(None if every is None else every.points, np.zeros(d, dtype)),
        with_origin(None if every is None else every.turns, turn),
        shapes,
        second,
        Index.of(frames),
        Index.of([(*own, *[n] * (most - len(own))) for own in bent]),
        () if every is None else _bending(every, taken),
    )


def _bending(every: Markers, taken: np.ndarray) -> tuple[Bending, ...]:
    return tuple(few for own in every.bending if (few := own.among(taken)) is not None)


def _padded(x: Any, modes: int, axes: int = 1) -> Any:
    """The last `axes` of an array filled up with zeros to so many `modes`."""
    more = [(0, 0)] * (x.ndim - axes) + [(0, modes - k) for k in x.shape[x.ndim - axes :]]
    return jnp.pad(x, more) if is_traced(x) else np.pad(np.asarray(x), more)


def _appended(given: Any, row: np.ndarray) -> Array:
    flat = concatenate([given.reshape(-1), row.reshape(-1)])
    return as_jax(flat).reshape(len(given) + 1, *row.shape)
