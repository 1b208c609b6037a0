"""Static responses of bodies to loads at their ports, as snapshots beside those of a motion."""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..basis.snapshots import Changes, SnapshotSet
from ..program import program
from ..scene.body.base import AbstractBody, nameless
from ..scene.effect.base import AbstractEffect
from ..scene.joint.base import AbstractJoint
from ..scene.scene import Scene


def with_attachments(scene: Scene, bodies: Sequence[SnapshotSet]) -> list[SnapshotSet]:
    """The snapshots of each body's amplitudes with its attachment modes among them.

    An attachment mode is what a unit load at a port deflects, K⁻¹ Sᵀ e with the stiffness K and
    the shape S of the modes there; without rigid motion, which is the frame's (Rubin, AIAA
    Journal 13, 1975, doi:10.2514/3.60497). Each is as large as the
    load that alone moves its port as far as the snapshots do: loads together that the training knew
    in one combination only may come in any other.

    **Arguments:** the `scene`, whose joints and effects have their markers at the ports; `bodies`:
    the snapshots of the amplitudes of each of its bodies.
    """
    points: dict[str, list[Array]] = {body.name: [] for body in scene.bodies}
    parts: list[AbstractJoint | AbstractEffect] = [*scene.joints, *scene.effects]
    for part in parts:
        for marker in part.markers:
            points.get(marker.body, []).append(marker.point)
    more = []
    for body, own in zip(scene.bodies, bodies, strict=True):
        ports = points[body.name]
        if body.modes and ports:
            arrays = nameless(body), jnp.stack(ports), own.q, own.weights
            own = dataclasses.replace(own, changes=_attached(*arrays))
        more.append(own)
    return more


@program
def _attached(
    body: AbstractBody,
    points: Float[Array, "ports 2"],
    q: Float[Array, "h modes"],
    weights: Float[Array, " h"],
) -> Changes:
    stiffness = jax.hessian(body.elastic_energy)(jnp.zeros(3 + q.shape[1], q.dtype))[3:, 3:]
    shapes = jnp.concatenate([body.mode_shapes(point) for point in points])
    responses = jnp.linalg.solve(stiffness, shapes.T).T
    # How far a unit load moves its own port, and how far that has moved.
    yielding = jnp.sum(responses * shapes, axis=1)
    moved = jnp.linalg.norm((shapes @ q.T) * weights[None], axis=1)
    loads = jnp.where(yielding > 0, moved / jnp.where(yielding > 0, yielding, 1), 0)
    rows = loads[:, None] * responses
    return Changes(rows, jnp.zeros_like(rows), jnp.ones_like(loads))
