"""Scenes whose joints hold at the start."""

from jaxtyping import Array, Float

from ..scene.scene import Scene
from ..system.consistent import consistent
from .assemble import assemble
from .kinematics import columns_of


def consistent_scene(scene: Scene) -> Scene:
    """The scene with the nearest start at which all joints hold, in positions and in velocities.

    So that nobody works out the angles of a loop by hand, nor the velocities of what a crank
    drives: give them roughly. Nearest in the mass metric, and differentiable, as in `consistent`.

    Raises SceneError as `assemble` does, and InputError if there is no such start near.
    """
    system = assemble(scene)
    q, v = consistent(system)
    return started(scene, q, v)


def started(scene: Scene, q: Float[Array, " n"], v: Float[Array, " n"]) -> Scene:
    """The scene with another start."""
    columns, _ = columns_of(scene.bodies)
    own = [slice(columns[b.name][0], columns[b.name][-1] + 1) for b in scene.bodies]
    bodies = [body.started(q[at], v[at]) for body, at in zip(scene.bodies, own, strict=True)]
    return Scene(bodies, scene.joints, scene.effects)
