"""Where the parts of a mechanism are: outlines, hinges and rails, as NumPy arrays."""

import jax
import numpy as np
from jaxtyping import Float, Real

from ..scene.body.base import AbstractBody
from ..scene.joint.point_on_line import PointOnLine
from ..scene.joint.prismatic import Prismatic
from ..scene.joint.revolute import Revolute
from ..scene.marker import GROUND
from ..scene.scene import Scene


def outlines(scene: Scene, q: Real[np.ndarray, "k n"]) -> list[Float[np.ndarray, "k points 2"]]:
    """The outline of each body [m] at the configurations `q` (k, n).

    Material points X sit at r = R + A(φ) (X + S q_f); modal amplitudes are not exaggerated.
    """
    parts = _split(scene, q)
    return [_place(body, body.outline(), parts[body.name]) for body in scene.bodies]


def hinges(scene: Scene, q: Real[np.ndarray, "k n"]) -> Float[np.ndarray, "k hinges 2"]:
    """The hinge points [m] of all revolute joints, as their first marker's body carries them."""
    parts = _split(scene, q)
    bodies = {body.name: body for body in scene.bodies}
    places = [np.zeros((len(q), 0, 2))]
    for joint in scene.joints:
        if isinstance(joint, Revolute):
            marker = joint.b if joint.a.body == GROUND else joint.a
            point = marker.point[None]
            places.append(_place(bodies[marker.body], point, parts[marker.body]))
    return np.concatenate(places, axis=1)


def rails(scene: Scene) -> list[tuple[np.ndarray, float]]:
    """A point [m] and the angle [rad] of each line on the ground along which a point slides."""
    slides = [j for j in scene.joints if isinstance(j, PointOnLine | Prismatic)]
    lines = [j.b for j in slides if j.b.body == GROUND]
    return [(np.asarray(marker.point), float(marker.angle)) for marker in lines]


def _split(scene: Scene, q: np.ndarray) -> dict[str, np.ndarray]:
    """The columns of `q` that belong to each body."""
    sizes = [body.size for body in scene.bodies]
    if q.shape[1] != sum(sizes):
        raise ValueError(
            f"outlines: q has {q.shape[1]} coordinates, but the bodies of the scene "
            f"({', '.join(body.name for body in scene.bodies)}) have {sum(sizes)}; "
            "draw a motion of this scene."
        )
    columns = np.split(q, np.cumsum(sizes)[:-1], axis=1)
    return {body.name: part for body, part in zip(scene.bodies, columns, strict=True)}


def _place(body: AbstractBody, points: jax.Array, q: np.ndarray) -> np.ndarray:
    """Places (k, points, 2) of the material `points` (points, 2) of a body at its own `q`."""
    local = np.asarray(points)[None]
    if body.modes:
        shapes = np.asarray(_shapes(body, points))
        local = local + np.einsum("pim,km->kpi", shapes[:, :2], q[:, 3:])
    cos, sin = np.cos(q[:, 2:3]), np.sin(q[:, 2:3])
    x = q[:, 0:1] + cos * local[:, :, 0] - sin * local[:, :, 1]
    y = q[:, 1:2] + sin * local[:, :, 0] + cos * local[:, :, 1]
    return np.stack([x, y], axis=2)


@jax.jit
def _shapes(body: AbstractBody, points: jax.Array) -> jax.Array:
    return jax.vmap(body.mode_shapes)(points)
