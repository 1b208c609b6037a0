"""The spanning tree of a mechanism: which joint holds each body, and which joints are cut."""

from typing import Any, NamedTuple

from ...assembly.assembled import AssembledSystem
from ...common.inheritance import goes_with
from ...scene.joint.base import AbstractJoint
from ...scene.one_coordinate import AbstractOneCoordinate
from ...scene.turn_counter import CounterJoint

GROUND = -1


class Link(NamedTuple):
    """A joint between two bodies, by their numbers; −1 is the ground.

    - `group`, `row`: which joint of the system. `rows`: how many constraints it is.
    - `a`, `b`: the bodies of its first and of its second marker.
    """

    group: int
    row: int
    rows: int
    a: int
    b: int

    def other(self, body: int) -> int:
        """Return the body at the other end."""
        return self.b if self.a == body else self.a


class Branch(NamedTuple):
    """An edge of the tree: the parent of a body, and the joint, None of a body that is free."""

    body: int
    parent: int
    link: Link | None


class Spanning(NamedTuple):
    """A spanning tree: its branches, each after that of its parent, and the joints that are cut, by
    group and row.
    """

    branches: tuple[Branch, ...]
    cut: tuple[tuple[int, int], ...]


def frames_of(system: AssembledSystem) -> dict[int, tuple[int, int, int]]:
    """The bodies by their first coordinate: each one's number, its group, and its row there."""
    frames = dict[int, tuple[int, int, int]]()
    for g, group in enumerate(system.bodies):
        if not isinstance(group.bodies, AbstractOneCoordinate):
            for row, columns in enumerate(group.coordinates.rows):
                frames[columns[0]] = (len(frames), g, row)
    return frames


def has_own_coordinates(joint: Any) -> bool:
    """Whether a joint has coordinates of its own, which a subclass with a residual of its own has
    not inherited.
    """
    return joint.freedoms is not None and goes_with(joint, "place", "residual")


def has_own_screws(joint: Any) -> bool:
    """Whether a joint knows its twists, which a subclass with another `place` has not inherited."""
    return goes_with(joint, "screws", "place") and type(joint).screws is not AbstractJoint.screws


def spanning_tree(system: AssembledSystem) -> Spanning:
    """Grow the tree from the ground, always by the joint with most constraints, and of these by the
    one nearest to the ground.

    The joints that are cut then have the fewest constraints, the tree has the fewest coordinates,
    and loops are cut where they are farthest from the ground, which keeps branches short: the mass
    matrix of a long branch is worse conditioned than those of two halves. Parts that no joint of
    this kind holds to the ground get a free body, the one with most joints.
    """
    bodies, links = frames_of(system), _links(system)
    depth, waiting = {GROUND: 0}, set(range(len(bodies)))
    branches = list[Branch]()
    used = set[tuple[int, int]]()
    degrees = [sum(body in (link.a, link.b) for link in links) for body in range(len(bodies))]
    while waiting:
        reachable = [
            # The smallest key wins: most constraints, then nearest to the ground, then the order of
            # the scene, so that equal mechanisms have equal trees.
            (-link.rows, depth[end], number, end)
            for number, link in enumerate(links)
            for end in (link.a, link.b)
            if end in depth and link.other(end) in waiting
        ]
        if reachable:
            _, _, number, parent = min(reachable)
            link = links[number]
            body, branch = link.other(parent), Branch(link.other(parent), parent, link)
            used.add((link.group, link.row))
        else:
            # No joint reaches what is left. Six or three coordinates of a free body are spent where
            # they serve most joints.
            body = max(waiting, key=lambda i: (degrees[i], -i))
            branch, parent = Branch(body, GROUND, None), GROUND
        depth[body] = depth[parent] + 1
        waiting.remove(body)
        branches.append(branch)
    every = [
        (g, row)
        for g, group in enumerate(system.joints)
        if not isinstance(group.joints, CounterJoint)
        for row in range(len(group.rows.rows))
    ]
    cut = tuple(each for each in every if each not in used)
    return Spanning(_along_branches(branches), cut)


def _along_branches(branches: list[Branch]) -> tuple[Branch, ...]:
    """Return the branches in such an order that a chain comes one by one."""
    children: dict[int, list[Branch]] = {}
    for branch in branches:
        children.setdefault(branch.parent, []).append(branch)
    ordered, waiting = list[Branch](), children.get(GROUND, [])[::-1]
    while waiting:
        branch = waiting.pop()
        # Depth first: the branches of a chain get neighbouring numbers, and its coordinates too.
        ordered.append(branch)
        waiting += children.get(branch.body, [])[::-1]
    return tuple(ordered)


def _links(system: AssembledSystem) -> list[Link]:
    """The joints that a tree may be made of."""
    if system.joint_markers is None:
        return []
    numbers = {first: number for first, (number, _, _) in frames_of(system).items()}
    # The first coordinate of the frame that carries a marker tells its body.
    firsts, links = system.joint_markers.frames.array[:, 0], list[Link]()
    for g, group in enumerate(system.joints):
        joint: AbstractJoint = group.joints
        if not has_own_coordinates(joint) or len(joint.markers) != 2:
            continue
        a, b = (take.astype(int) for take in group.markers.take(firsts)[:2])
        links += [
            Link(g, row, group.rows.width, numbers.get(i, GROUND), numbers.get(j, GROUND))
            for row, (i, j) in enumerate(zip(a.tolist(), b.tolist(), strict=True))
        ]
    return links
