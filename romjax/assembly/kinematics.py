"""The motion of all markers of a family of elements, and the way back from wrenches to Q."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..arrays import put
from ..compat import is_traced
from ..linalg.indexing import Index
from ..scene.body.base import AbstractBody
from ..scene.marker import GROUND, Marker, Pose, Wrench
from .grouping import T, group, stack


class PoseGradient(NamedTuple):
    """Derivatives of poses with respect to the coordinates of their bodies."""

    position: Float[Array, "count 2 size"]
    angle: Float[Array, "count size"]


class Markers(eqx.Module):
    """All markers of a family of elements; their poses are one Pose with a leading axis.

    Bodies of all kinds share one formula, pose = frame ∘ (point + shapes · amplitudes), so the
    program is the same for any number and mix of bodies. Bodies with fewer modes than the richest
    one are padded with zero shapes; the ground is a frame that stays at zero. Where a body
    foreshortens as it bends, the point moves by −½ amplitudes · foreshortening · amplitudes too.
    """

    points: Float[Array, "count 2"]  # in the body frame
    angles: Float[Array, " count"]  # against the body
    shapes: Float[Array, "count 3 modes"]
    foreshortening: Float[Array, "count 2 modes modes"] | None
    frames: Index = eqx.field(static=True)  # of x, y, φ in q; n stands for the ground
    amplitudes: Index = eqx.field(static=True)  # of the modal coordinates; n stands for padding

    def poses(self, q: Float[Array, " n"]) -> Pose:
        """Where all markers are."""
        extended = _extend(q)
        angle = extended[self.frames.array[:, 2]]
        arm, turn = self._local(extended)
        origin = extended[self.frames.array[:, :2]]
        return Pose(origin + _turn(angle, arm), angle + turn)

    def jacobian(self, q: Float[Array, " n"]) -> PoseGradient:
        """Derivatives of the poses; columns x, y, φ, amplitudes of each marker's body."""
        extended = _extend(q)
        angle = extended[self.frames.array[:, 2]]
        arm, _ = self._local(extended)
        shapes = self.shapes
        if self.foreshortening is not None:
            amplitudes = extended[self.amplitudes.array]
            slide = jnp.einsum("cikl,cl->cik", self.foreshortening, amplitudes)
            shapes = shapes - jnp.pad(slide, ((0, 0), (0, 1), (0, 0)))
        count = len(self.angles)
        unit = jnp.broadcast_to(jnp.eye(2, dtype=q.dtype), (count, 2, 2))
        position = [unit, _perpendicular(_turn(angle, arm))[:, :, None]]
        turning = [jnp.broadcast_to(jnp.array([0, 0, 1], q.dtype), (count, 3))]
        if self.amplitudes.width:
            turned = jax.vmap(_turn, in_axes=(None, 2), out_axes=2)(angle, shapes[:, :2])
            position.append(turned)
            turning.append(shapes[:, 2])
        return PoseGradient(jnp.concatenate(position, axis=2), jnp.concatenate(turning, axis=1))

    def coordinates(self) -> np.ndarray:
        """Indices in q of the columns of `jacobian`, (count, size); n where there is none."""
        return np.concatenate([self.frames.array, self.amplitudes.array], axis=1).astype(int)

    def pull_back(self, q: Float[Array, " n"], wrenches: Wrench) -> Float[Array, " n"]:
        """Generalized forces of wrenches on all markers, stacked like the poses."""
        _, transpose = jax.vjp(self.poses, q)
        force: Float[Array, " n"]
        (force,) = transpose(Pose(wrenches.force, wrenches.torque))
        return force

    def _local(
        self, extended: Float[Array, " extended"]
    ) -> tuple[Float[Array, "count 2"], Float[Array, " count"]]:
        if not self.amplitudes.width:
            return self.points, self.angles
        amplitudes = extended[self.amplitudes.array]
        displacement = jnp.einsum("cik,ck->ci", self.shapes, amplitudes)
        points = self.points + displacement[:, :2]
        if self.foreshortening is not None:
            points -= 0.5 * jnp.einsum(
                "cikl,ck,cl->ci", self.foreshortening, amplitudes, amplitudes
            )
        return points, self.angles + displacement[:, 2]


def _extend(q: Float[Array, " n"]) -> Float[Array, " extended"]:
    return jnp.concatenate([q, np.zeros(1, q.dtype)])


def _turn(angle: Float[Array, " count"], arm: Float[Array, "count 2"]) -> Float[Array, "count 2"]:
    return jnp.cos(angle)[:, None] * arm + jnp.sin(angle)[:, None] * _perpendicular(arm)


def _perpendicular(arm: Float[Array, "count 2"]) -> Float[Array, "count 2"]:
    return arm[:, ::-1] * np.array([[-1, 1]], arm.dtype)


class MarkerBlocks(eqx.Module):
    """Where the markers of equal elements are: a block for each side, one row per element."""

    start: int = eqx.field(static=True)
    count: int = eqx.field(static=True)
    sides: int = eqx.field(static=True)

    def take(self, stacked: T) -> tuple[T, ...]:
        """The rows of each side, from any pytree with a row for each marker."""
        starts = [self.start + side * self.count for side in range(self.sides)]
        return tuple(jax.tree.map(lambda x, b=b: x[b : b + self.count], stacked) for b in starts)


def columns_of(bodies: Sequence[AbstractBody]) -> tuple[dict[str, tuple[int, ...]], int]:
    """The columns of q that belong to each body, by name, and how many there are."""
    n, columns = 0, {}
    for body in bodies:
        columns[body.name] = tuple(range(n, n + body.size))
        n += body.size
    return columns, n


def arrange(
    elements: Sequence[Any],
    bodies: dict[str, AbstractBody],
    columns: dict[str, tuple[int, ...]],
    n: int,
) -> tuple[list[tuple[Any, MarkerBlocks, list[int]]], Markers | None]:
    """Groups of equal elements, each stacked, with the blocks of their markers and the numbers of
    the elements; and the markers of all groups, None if there are none.

    The other arguments are those of `prepare_points`.
    """
    groups, markers = [], list[Marker]()
    for stacked, members in group(elements):
        sides = list(zip(*(elements[i].markers for i in members), strict=True))
        groups.append((stacked, MarkerBlocks(len(markers), len(members), len(sides)), members))
        markers += [marker for side in sides for marker in side]
    if not markers:
        return groups, None
    points, angles = stack([(m.point, m.angle) for m in markers])
    names = [marker.body for marker in markers]
    return groups, prepare_points(names, points, angles, bodies, columns, n)


def prepare_points(
    names: Sequence[str],
    points: Float[Array, "count 2"],
    angles: Float[Array, " count"],
    bodies: dict[str, AbstractBody],
    columns: dict[str, tuple[int, ...]],
    n: int,
) -> Markers:
    """Prepare all about markers at material points that does not change in time.

    `names` are those of the bodies that carry them or "ground", `bodies` the bodies by name,
    `columns` theirs of q, `n` the length of q.
    """
    moving = [i for i, name in enumerate(names) if name != GROUND and bodies[name].modes]
    most = max((bodies[names[i]].modes for i in moving), default=0)
    given: Any = points if is_traced(points) else np.asarray(points)
    shapes: Any = np.zeros((len(names), 3, most), points.dtype)
    foreshortening: Any = None
    for carriers, members in group([bodies[names[i]] for i in moving]):
        rows = np.array([moving[member] for member in members])
        own = carriers.modes
        shapes = put(shapes, np.s_[rows, :, :own], _shapes(carriers, given[rows]))
        if carriers.foreshortens:
            if foreshortening is None:
                foreshortening = np.zeros((len(names), 2, most, most), points.dtype)
            second = _foreshortening(carriers, given[rows])
            foreshortening = put(foreshortening, np.s_[rows, :, :own, :own], second)
    shapes = jnp.asarray(shapes)
    foreshortening = None if foreshortening is None else jnp.asarray(foreshortening)
    owned = [columns.get(name, (n, n, n)) for name in names]
    frames = Index.of([c[:3] for c in owned])
    padded = Index.of([(*c[3:], *[n] * (most + 3 - len(c))) for c in owned])
    return Markers(points, angles, shapes, foreshortening, frames, padded)


@jax.jit
def _shapes(bodies: AbstractBody, points: Float[Array, "count 2"]) -> Float[Array, "count 3 modes"]:
    shapes: Float[Array, "count 3 modes"]
    shapes = jax.vmap(lambda body, point: body.mode_shapes(point))(bodies, points)
    return shapes


@jax.jit
def _foreshortening(
    bodies: AbstractBody, points: Float[Array, "count 2"]
) -> Float[Array, "count 2 modes modes"]:
    foreshortening: Float[Array, "count 2 modes modes"]
    foreshortening = jax.vmap(lambda body, point: body.foreshortening(point))(bodies, points)
    return foreshortening
