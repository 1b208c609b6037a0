"""The motion of all markers of a family of elements, and the way back from wrenches to Q."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_jax, put
from ..common.compat import is_traced
from ..compiling.program import program_once
from ..linalg.dense import multiply
from ..linalg.indexing import Index, consecutive
from ..scene.body.base import AbstractBody
from ..scene.body.bending import AbstractBendingBody
from ..scene.marker import GROUND, Marker, Pose, Twist, Wrench
from ..scene.placing import from_centre
from . import planar, spatial
from .bending import Bending
from .grouping import T, group, stack
from .pose_gradient import PoseGradient


class Markers(eqx.Module):
    """All markers of a family of elements; their poses are one Pose with a leading axis.

    Bodies of all kinds share one formula, pose = frame ∘ (point + shapes · amplitudes), so the
    program is the same for any number and mix of bodies. Bodies with fewer modes than the richest
    one are padded with zero shapes; the ground is a frame that stays at zero. Where a body
    foreshortens as it bends, the point moves by −½ amplitudes · foreshortening · amplitudes too.
    Bodies that bend far have poses of their own, which take the place of the formula.

    `planar` and `spatial` hold what differs between two dimensions and three.
    """

    points: Float[Array, "count d"]  # in the body frame
    turns: Float[Array, "count *turn"]  # against the body
    shapes: Float[Array, "count motions modes"]
    foreshortening: Float[Array, "count d modes modes"] | None
    frames: Index = eqx.field(static=True)  # of the frame in q; from n on for the ground
    amplitudes: Index = eqx.field(static=True)  # of the modal coordinates; n stands for padding
    bending: tuple[Bending, ...] = ()  # of bodies with local poses of their own

    def poses(self, q: Float[Array, " n"]) -> Pose:
        """Return the poses of all markers."""
        extended = self._extend(q)
        poses: Pose = self._space.compose(self._frame(extended), self._local(extended))
        return poses

    def motion(self, q: Float[Array, " n"], v: Float[Array, " n"]) -> tuple[Pose, Twist]:
        """Return the poses and the twists of all markers."""
        poses, rates = jax.jvp(self.poses, (q,), (v,))
        return poses, poses.twist(rates)

    def jacobian(self, q: Float[Array, " n"]) -> PoseGradient:
        """Derivatives of the poses; columns of the frame and the amplitudes of each one's body."""
        extended = self._extend(q)
        local, shapes = self._local(extended), self.shapes
        if self.foreshortening is not None:
            amplitudes = extended[self.amplitudes.array]
            # ∂(½ q_fᵀ G q_f)/∂q_f = G q_f, G symmetric.
            slide = multiply(self.foreshortening, amplitudes[:, None, :, None])[..., 0]
            more = shapes.shape[1] - slide.shape[1]
            shapes = shapes - jnp.pad(slide, ((0, 0), (0, more), (0, 0)))
        for own in self.bending:
            slopes = own.gradients(extended[self.amplitudes.array])
            shapes = shapes.at[np.array(own.rows), :, : slopes.shape[2]].set(slopes)
        around = self._space.about(self.turns, local.turn, [own.rows for own in self.bending])
        turns = self._turns(extended)
        gradient: PoseGradient = self._space.gradient(turns, local, around, shapes)
        return gradient

    def curvature(
        self, q: Float[Array, " n"], forces: Float[Array, "count numbers"]
    ) -> Float[Array, "count size size"]:
        """The second derivatives of poses by the columns of `jacobian`, each along a constant
        `force` on the position and the turn: the Hessian of fᵀp by the coordinates of its body.
        """
        columns, d = self.coordinates(), self.points.shape[1]
        frame = self.frames.width
        # Poses are linear in positions of frames and, but for some bodies, in amplitudes.
        straight = self.foreshortening is None and not self.bending
        pushed = np.arange(d, frame if straight else columns.shape[1])
        # A pose depends on its own body alone: one direction for all bodies.
        directions = np.zeros((len(pushed), q.size), q.dtype)
        for direction, k in zip(directions, pushed, strict=True):
            direction[columns[columns[:, k] < q.size, k]] = 1

        # ∂²x/∂q² contracted with forces: the derivative of fᵀ ∂x/∂q.
        def slope(q: Array) -> Array:
            return multiply(forces[:, None], self.jacobian(q).matrix())[:, 0]

        def push(direction: Array) -> Array:
            change: Array = jax.jvp(slope, (q,), (direction,))[1]
            return change

        own = jax.vmap(push, out_axes=2)(jnp.asarray(directions))[:, d:]
        # Second derivatives are symmetric: those by amplitudes and then by the turn are known
        # already, and those by amplitudes twice are zero.
        if straight:
            more = own.shape[1] - own.shape[2]
            rest = jnp.pad(jnp.swapaxes(own[:, frame - d :], 1, 2), ((0, 0), (0, more), (0, 0)))
            own = jnp.concatenate([own, rest], axis=2)
        return jnp.pad(own, ((0, 0), (d, 0), (d, 0)))

    def coordinates(self) -> np.ndarray:
        """Indices in q of the columns of `jacobian`, (count, size); n or more: none."""
        return np.concatenate([self.frames.array, self.amplitudes.array], axis=1).astype(int)

    def pull_back(self, q: Float[Array, " n"], wrenches: Wrench) -> Float[Array, " n"]:
        """Generalized forces of wrenches on all markers, stacked like the poses."""
        # The virtual power of the wrenches: Q = (∂x/∂q)ᵀ F, without a Jacobian.
        poses, transpose = jax.vjp(self.poses, q)
        force: Float[Array, " n"]
        (force,) = transpose(poses.force(wrenches))
        return force

    @property
    def _space(self) -> Any:
        return planar if self.points.shape[1] == 2 else spatial

    def _extend(self, q: Float[Array, " n"]) -> Float[Array, " extended"]:
        """q, then what stands in for the coordinates of the ground."""
        # The pose of the ground stands behind the coordinates, where its markers find it as others
        # find theirs.
        return jnp.concatenate([q, np.array(self._space.GROUND, q.dtype)])

    def _frame(self, extended: Float[Array, " extended"]) -> Pose:
        turns = self._turns(extended)
        return Pose(extended[self.frames.array[:, : self.points.shape[1]]], turns)

    def _turns(self, extended: Float[Array, " extended"]) -> Float[Array, "count *turn"]:
        frames = self.frames.array
        return extended[frames[:, 2] if self.points.shape[1] == 2 else frames[:, 3:]]

    def _local(self, extended: Float[Array, " extended"]) -> Pose:
        return self.local(extended[self.amplitudes.array])

    def local(self, amplitudes: Float[Array, "count modes"]) -> Pose:
        """Return the poses of the markers in the frames of their bodies, deformed by amplitudes of
        each one's body.
        """
        if not self.amplitudes.width and not self.bending:
            return Pose(self.points, self.turns)
        d = self.points.shape[1]
        column = amplitudes[:, :, None]
        displacement = multiply(self.shapes, column)[:, :, 0]
        points = self.points + displacement[:, :d]
        if self.foreshortening is not None:
            slide = multiply(self.foreshortening, column[:, None])[..., 0]
            # A beam that bends pulls its points in along its axis, which is an effect of second
            # order.
            points -= 0.5 * multiply(slide, column)[:, :, 0]
        turns = self._space.bend(self.turns, displacement[:, d:])
        for own in self.bending:
            rows = np.array(own.rows)
            position, turn = own.poses(amplitudes)
            points = points.at[rows].set(position)
            turns = turns.at[rows].set(self._space.turned(turn, self.turns[rows]))
        return Pose(points, turns)


class MarkerBlocks(eqx.Module):
    """The places of the markers of equal elements: a block for each side, one row per element."""

    start: int = eqx.field(static=True)
    count: int = eqx.field(static=True)
    sides: int = eqx.field(static=True)

    def take(self, stacked: T) -> tuple[T, ...]:
        """The rows of each side, from any pytree with a row for each marker."""
        starts = [self.start + side * self.count for side in range(self.sides)]
        return tuple(
            jax.tree.map(lambda x, b=b: consecutive(x, b, self.count), stacked) for b in starts
        )


def columns_of(bodies: Sequence[AbstractBody]) -> tuple[dict[str, tuple[int, ...]], int]:
    """The columns of q that belong to each body, by name, and how many there are."""
    n, columns = 0, {}
    for body in bodies:
        columns[body.name] = tuple(range(n, n + body.size))
        n += body.size
    return columns, n


def arrange(
    elements: Sequence[Any],
    sides: Sequence[tuple[Marker, ...]],
    bodies: dict[str, AbstractBody],
    columns: dict[str, tuple[int, ...]],
    n: int,
) -> tuple[list[tuple[Any, MarkerBlocks, list[int]]], Markers | None]:
    """Groups of equal elements, each stacked, with the blocks of their markers and the numbers of
    the elements; and the markers of all groups, None if there are none.

    `sides` are the markers of each element; the other arguments are those of `prepare_points`.
    """
    groups, markers = [], list[Marker]()
    for stacked, members in group(elements):
        own = list(zip(*(sides[i] for i in members), strict=True))
        groups.append((stacked, MarkerBlocks(len(markers), len(members), len(own)), members))
        markers += [marker for side in own for marker in side]
    if not markers:
        return groups, None
    points, turns = stack([(m.point, m.turn) for m in markers])
    names = [marker.body for marker in markers]
    return groups, prepare_points(names, points, turns, bodies, columns, n)


def prepare_points(
    names: Sequence[str],
    points: Float[Array, "count d"],
    turns: Float[Array, "count *turn"],
    bodies: dict[str, AbstractBody],
    columns: dict[str, tuple[int, ...]],
    n: int,
) -> Markers:
    """Prepare all about markers at material points that does not change in time.

    `names` are those of the bodies that carry them or "ground", `bodies` the bodies by name,
    `columns` theirs of q, `n` the length of q.
    """
    carried = [i for i, name in enumerate(names) if name != GROUND]
    moving = [i for i in carried if bodies[names[i]].modes or bodies[names[i]].bends]
    most = max((bodies[names[i]].modes for i in moving), default=0)
    given: Any = points if is_traced(points) else np.asarray(points)
    for name in {names[i] for i in carried if bodies[names[i]].centre is not None}:
        rows = np.array([i for i in carried if names[i] == name])
        given = put(given, rows, from_centre(given[rows], bodies[name].centre))
        points = as_jax(given)
    d = points.shape[1]
    shapes: Any = np.zeros((len(names), 3 if d == 2 else 6, most), points.dtype)
    foreshortening: Any = None
    bending = list[Bending]()
    for carriers, members in group([bodies[names[i]] for i in moving]):
        rows = np.array([moving[member] for member in members])
        modes = carriers.modes
        if isinstance(carriers, AbstractBendingBody):
            bending.append(Bending.of(carriers, given[rows], rows))
            continue
        shapes = put(shapes, np.s_[rows, :, :modes], _shapes(carriers, given[rows]))
        if carriers.foreshortens:
            if foreshortening is None:
                foreshortening = np.zeros((len(names), d, most, most), points.dtype)
            second = _foreshortening(carriers, given[rows])
            foreshortening = put(foreshortening, np.s_[rows, :, :modes, :modes], second)
    shapes = as_jax(shapes)
    foreshortening = None if foreshortening is None else as_jax(foreshortening)
    ground = (planar if d == 2 else spatial).ground(n)
    # A counter has the first coordinate of a frame, and stands still in the others.
    own = [columns.get(name, ()) for name in names]
    frame, owned = len(ground), [(*c, *ground[len(c) :]) for c in own]
    frames = Index.of([c[:frame] for c in owned])
    padded = Index.of([(*c[frame:], *[n] * (most + frame - len(c))) for c in owned])
    return Markers(points, turns, shapes, foreshortening, frames, padded, tuple(bending))


@program_once
def _shapes(
    bodies: AbstractBody, points: Float[Array, "count d"]
) -> Float[Array, "count motions modes"]:
    shapes: Float[Array, "count motions modes"]
    shapes = jax.vmap(lambda body, point: body.mode_shapes(point))(bodies, points)
    return shapes


@program_once
def _foreshortening(
    bodies: AbstractBody, points: Float[Array, "count d"]
) -> Float[Array, "count d modes modes"]:
    foreshortening: Float[Array, "count d modes modes"]
    foreshortening = jax.vmap(lambda body, point: body.foreshortening(point))(bodies, points)
    return foreshortening
