"""Where a body is that one of its points is brought to, and where its points are."""

from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..arrays import Number, Vector, as_array, concrete
from ..compat import is_traced
from ..errors import SceneError
from .fields import check_shape
from .marker import Pose

B = TypeVar("B", bound=Any)


def start_pose(body: Any, point: Vector) -> Pose:
    """Where a material `point` [m] of a body is at the start, and how it is turned there."""
    q, _ = body.start()
    arm, turn = _arm(body, q, point)
    return Pose(as_array(_moved(q[:2], q[2], arm)), as_array(q[2] + turn))


def brought(body: B, point: Vector, to: Pose, angle: Number | None) -> B:
    """The body whose material `point` [m] is where a pose is, its frame turned by `angle` [rad], as
    it is unless given.
    """
    if not hasattr(body, "position"):
        raise SceneError(
            f"body '{body.name}': a {type(body).__name__} has no position of its own; place the "
            "body that it is made of."
        )
    turned = body.angle if angle is None else as_array(angle)
    q, _ = body.start()
    arm, _ = _arm(body, q, point)
    position = as_array(_moved(to.position, turned, arm, sign=-1))
    placed: B = eqx.tree_at(lambda b: (b.position, b.angle), body, (position, turned))
    placed.check()
    return placed


def started(body: B, q: Array, v: Array) -> B:
    """The body whose own coordinates and velocities at the start are q and v."""
    if not hasattr(body, "position"):
        raise SceneError(
            f"body '{body.name}': a {type(body).__name__} has no fields `position`, `angle`, …; "
            "give it a method `started`."
        )
    names = ["position", "angle", "velocity", "angular_velocity"]
    values = [q[:2], q[2], v[:2], v[2]]
    if body.modes:
        names, values = [*names, "amplitudes", "rates"], [*values, q[3:], v[3:]]
    moved: B = eqx.tree_at(lambda b: [getattr(b, name) for name in names], body, values)
    return moved


def _arm(body: Any, q: Array, point: Vector) -> tuple[Any, Any]:
    """A material point in the frame of a body as it is bent, X + S q_f − ½ q_fᵀ G q_f [m], and how
    much it is turned there [rad].
    """
    at = as_array(point)
    check_shape(f"body '{body.name}'", "point", at, (2,))
    if not body.modes:
        return at, 0.0
    moved = body.mode_shapes(at) @ q[3:]
    arm = at + moved[:2]
    if body.foreshortens:
        arm = arm - 0.5 * (body.foreshortening(at) @ q[3:]) @ q[3:]
    return arm, moved[2]


def _moved(origin: Any, angle: Any, arm: Any, sign: int = 1) -> Any:
    """The position origin + sign A(angle) arm; by NumPy, which compiles nothing, where JAX does not
    trace.
    """
    if any(is_traced(x) for x in (origin, angle, arm)):
        xp: Any = jnp
    else:
        xp, (origin, angle, arm) = np, (concrete(x) for x in (origin, angle, arm))
    c, s = xp.cos(angle), xp.sin(angle)
    return origin + sign * xp.stack([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])
