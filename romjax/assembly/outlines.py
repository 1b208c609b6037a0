"""The outlines of a scene as it moves, from the poses that the dynamics use."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import Vector, as_arrays, as_jax
from ..common.checks import unknown_name
from ..common.errors import InputError
from ..compiling.program import program_once
from ..scene.body.base import AbstractBody
from ..scene.drawing import hatched
from ..scene.effect.base import AbstractEffect
from ..scene.joint.base import AbstractJoint
from ..scene.marker import GROUND, Marker, Pose, Poses, ground
from ..scene.outline import Outlines, Style
from ..scene.scene import Scene
from .counting import bodies_coordinates
from .kinematics import MarkerBlocks, Markers, arrange, columns_of, prepare_points

# Signs are this share of the diagonal of all that moves.
SIGN = 0.03
# Frames are evaluated in multiples of this, so that any number of them compiles to one program.
FRAMES = 64


class MovingOutline(NamedTuple):
    """An outline at several times, without a trace of JAX.

    - `part`: the name of the body, or what messages call the joint or the effect; "ground" for
      what is hatched.
    - `points`: in the inertial frame [m], (frames, points, d).
    - `style`, `endless`: as of `romjax.Outline`.
    - `values`: numbers at the points that are shown in colour, (frames, points), if there are any.
    """

    part: str
    points: Float[np.ndarray, "frames points d"]
    style: Style
    endless: bool
    values: Float[np.ndarray, "frames points"] | None = None


def outlines(
    scene: Scene, t: Vector, q: Vector, traced: Sequence[Marker] = ()
) -> list[MovingOutline]:
    """All that pictures of a `scene` show: its bodies, traces, joints and effects, in this order.

    **Arguments:**

    - `t`: times [s], (frames,), or one for all.
    - `q`: coordinates (frames, n). Modal amplitudes are not exaggerated.
    - `traced`: markers whose paths are shown; an outline of one point each.

    Raises ValueError if `q` is not one of this scene, InputError for a marker that it lacks.
    """
    scene = as_arrays(scene)
    bodies = {body.name: body for body in scene.bodies}
    columns, n = columns_of(scene.bodies)
    q = bodies_coordinates((*scene.joints, *scene.effects), np.asarray(q), n)
    if q.ndim != 2 or q.shape[1] != n:
        given = f"{q.shape[1]} coordinates" if q.ndim == 2 else f"shape {q.shape}"
        raise ValueError(
            f"outlines: q has {given}, but the bodies of the scene ({', '.join(bodies)}) have {n} "
            f"coordinates; draw a motion of this scene, (times, {n})."
        )
    t = np.broadcast_to(np.asarray(t, q.dtype), len(q))
    count, padding = len(q), -len(q) % FRAMES
    q, t = np.pad(q, ((0, padding), (0, 0)), mode="edge"), np.pad(t, (0, padding), mode="edge")

    lines = [np.asarray(body.outline()) for body in scene.bodies]
    largest = max(float(np.linalg.norm(np.ptp(line, axis=0))) for line in lines)
    owners: list[tuple[str, Style]] = [(name, "body") for name in bodies]
    for marker in traced:
        _check_traced(marker, bodies)
        lines.append(np.asarray(marker.point, lines[0].dtype)[None])
        owners.append((marker.body, "trace"))
    names = [name for (name, _), line in zip(owners, lines, strict=True) for _ in line]
    points = as_jax(np.concatenate(lines))
    unturned = np.asarray(ground.at((0.0,) * scene.dimension).turn)
    turns = as_jax(np.broadcast_to(unturned, (len(points), *unturned.shape)))
    material = prepare_points(names, points, turns, bodies, columns, n)
    parts: tuple[AbstractJoint | AbstractEffect, ...] = (*scene.joints, *scene.effects)
    groups, markers = arrange(parts, [part.markers for part in parts], bodies, columns, n)
    elements = [(stacked, blocks) for stacked, blocks, _ in groups]
    placed, drawn, size = jax.device_get(
        _evaluate(material, markers, elements, *map(as_jax, (t, q, np.asarray(largest))))
    )

    shown = [
        MovingOutline(name, part[:count], style, False)
        for (name, style), part in zip(
            owners, np.split(placed, np.cumsum([len(line) for line in lines])[:-1], 1), strict=True
        )
    ]
    signs: dict[int, list[MovingOutline]] = {}
    for (_, _, members), shapes in zip(groups, drawn, strict=True):
        for row, member in enumerate(members):
            signs[member] = [
                MovingOutline(parts[member].label(), o.points[:count, row], o.style, o.endless)
                for o in shapes
            ]
    shown += [outline for member in sorted(signs) for outline in signs[member]]
    return shown + _ground(parts, float(size), count)


def _check_traced(marker: Marker, bodies: dict[str, AbstractBody]) -> None:
    marker.check("trace")
    if marker.body == GROUND:
        raise InputError("trace: a marker on the ground has no path; give one on a body.")
    if marker.body not in bodies:
        raise unknown_name("trace", "body", marker.body, bodies)
    bodies[marker.body].check_marker("trace", marker)


@program_once
def _evaluate(
    material: Markers,
    markers: Markers | None,
    elements: list[tuple[Any, MarkerBlocks]],
    t: Float[Array, " frames"],
    q: Float[Array, "frames n"],
    largest: Float[Array, ""],
) -> tuple[Float[Array, "frames points d"], list[Outlines], Float[Array, ""]]:
    """Points of the bodies; outlines of joints and effects, group by group, with the axes (frames,
    elements, points, d); the size of signs, at most half of the `largest` body's.
    """
    bodies = jax.vmap(material.poses)(q)
    placed = bodies.position
    poses = jax.tree.map(lambda x: x[:, :0], bodies)
    if markers is not None:
        poses = jax.vmap(markers.poses)(q)
    everything = jnp.concatenate([placed, poses.position], axis=1).reshape(-1, placed.shape[2])
    finite = jnp.all(jnp.isfinite(everything), axis=1, keepdims=True)
    low = jnp.min(jnp.where(finite, everything, jnp.inf), axis=0)
    high = jnp.max(jnp.where(finite, everything, -jnp.inf), axis=0)
    size = SIGN * jnp.sqrt(jnp.sum((high - low) ** 2))
    size = jnp.where((size > 0) & jnp.isfinite(size), size, SIGN)
    # A large sign would hide bodies that are many and small.
    size = jnp.where(largest > 0, jnp.minimum(size, largest / 2), size)

    def frame(t: Array, poses: Pose) -> list[Outlines]:
        def outline(part: Any, number: Array | np.ndarray, poses: Poses) -> Outlines:
            del number  # there for parts without any number or marker, to be mapped over
            return tuple(part.outline(t, poses, size))

        return [
            jax.vmap(outline)(stacked, np.arange(blocks.count), blocks.take(poses))
            for stacked, blocks in elements
        ]

    return placed, jax.vmap(frame)(t, poses), size


def _ground(
    parts: Sequence[AbstractJoint | AbstractEffect], size: float, count: int
) -> list[MovingOutline]:
    """A hatched line at each marker on the ground of the parts that ask for it."""
    held = [m for part in parts if part.hatched for m in part.markers if m.body == GROUND]
    # Markers that are in one place but for rounding have one sign.
    origins = {tuple(np.round(np.asarray(marker.point), 12)) for marker in held}
    return [
        MovingOutline("ground", np.tile(hatched(origin, size), (count, 1, 1)), "ground", False)
        for origin in sorted(origins)
    ]
