"""The markers of the joints of a tree: where its bodies are held."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...assembly import planar, spatial
from ...assembly.assembled import AssembledSystem
from ...assembly.bending import Bending
from ...assembly.kinematics import Markers
from ...common.arrays import as_jax, concatenate, pick, untraced
from ...common.compat import is_traced
from ...linalg import quaternions
from ...linalg.indexing import Index
from ...scene.marker import Pose
from . import twists
from .spanning import Branch


class Frames(NamedTuple):
    """The positions of frames, their turns, in space of unit length, and their axes."""

    position: Float[Array, "count d"]
    turn: Float[Array, "count *turn"]
    axes: Float[Array, "count d d"]

    @classmethod
    def of(cls, poses: Pose) -> "Frames":
        """Return the frames of some poses; by NumPy where these are its arrays."""
        turn = twists.unit(poses.turn)
        return cls(poses.position, turn, twists.axes(turn))


def ports_of(
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


class Still(NamedTuple):
    """The ports of bodies that do not deform.

    - `outer`, `inner`: those on the parent of each body, and on the body. `across` (bodies, 4, 4):
      the matrix by which the turn of a joint in space gives that of the body's frame in the
      parent's; None in the plane.
    """

    outer: Frames
    inner: Frames
    across: Float[Array, "bodies 4 4"] | None

    @classmethod
    def of(cls, ports: Markers, count: int) -> "Still":
        """Return the ports as they are."""
        frames = Frames.of(Pose(*untraced(ports.points, ports.turns)))
        outer, inner = (Frames(*[x[own] for x in frames]) for own in (np.s_[:count], np.s_[count:]))
        across = None
        if ports.points.shape[1] == 3:
            across = quaternions.two_sided_product(outer.turn, quaternions.conjugate(inner.turn))
        still: Still = jax.tree.map(as_jax, cls(outer, inner, across))
        return still


def _bending(every: Markers, taken: np.ndarray) -> tuple[Bending, ...]:
    return tuple(few for own in every.bending if (few := own.among(taken)) is not None)


def _padded(x: Any, modes: int, axes: int = 1) -> Any:
    """The last `axes` of an array filled up with zeros to so many `modes`."""
    more = [(0, 0)] * (x.ndim - axes) + [(0, modes - k) for k in x.shape[x.ndim - axes :]]
    return jnp.pad(x, more) if is_traced(x) else np.pad(np.asarray(x), more)


def _appended(given: Any, row: np.ndarray) -> Array:
    flat = concatenate([given.reshape(-1), row.reshape(-1)])
    return as_jax(flat).reshape(len(given) + 1, *row.shape)
