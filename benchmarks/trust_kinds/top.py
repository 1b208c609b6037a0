"""A top on a ball joint, fast or slow.

The truth is Euler's equations with a rotation matrix, by SciPy's DOP853.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

import romjax as rj

from .kind import Kind, Numbers, moved, times
from .minimal import integrated
from .planar import log
from .spatial import DOWN, axes, bodies, moments

r = rj.spatial


@jax.jit
def _top_rate(z: Any) -> Any:
    """Of (R, the angular momentum about the tip by the axes of space), by the numbers at the end:
    those of time first.
    """
    frame, momentum = z[1:10].reshape(3, 3), z[10:13]
    mass, arm, inertia = z[13], z[14:17], z[17:26].reshape(3, 3)
    spin = jnp.linalg.solve(inertia, frame.T @ momentum)
    x, y, w = spin
    cross = jnp.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    torque = jnp.cross(frame @ arm, mass * jnp.array(DOWN))
    return jnp.concatenate([(frame @ cross).ravel(), torque])


def about_the_tip(p: Numbers) -> np.ndarray:
    arm, mass = p["arm"], p["masses"][0]
    return np.diag(p["moments"][0]) + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def top_motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    inertia, ts = about_the_tip(p), times(p["end"])
    numbers = np.concatenate([p["masses"], p["arm"], inertia.ravel()])
    moved_on = Rotation.from_rotvec([nudge, nudge, 0.0]).as_matrix() @ p["frame"]
    momentum = moved_on @ inertia @ p["frame"].T @ p["spins"][0]
    y = integrated(
        lambda t, y: np.asarray(_top_rate(np.concatenate([[t], y, numbers]))),
        ts,
        np.concatenate([moved_on.ravel(), momentum]),
    )
    return y[:, :9].reshape(-1, 3, 3) @ p["arm"]


def draw_top(chance: np.random.Generator) -> Numbers:
    masses, size = log(chance, 0.1, 10.0, 1), log(chance, 0.05, 1.0, 1)
    frame, arm = Rotation.random(rng=chance).as_matrix(), size[0] * axes(chance, 1)[0]
    spin = frame @ (log(chance, 1.0, 200.0) * axes(chance, 1)[0])
    p = {
        "masses": masses,
        "moments": moments(chance, masses, size),
        "arm": arm,
        "frame": frame,
        "x": (frame @ arm)[None],
        "v": np.cross(spin, frame @ arm)[None],
        "turns": Rotation.from_matrix(frame).as_quat(scalar_first=True)[None],
        "spins": spin[None],
    }
    return {**p, "end": np.asarray(log(chance, 0.1, 2.0))}


def top_scene(p: Numbers) -> rj.Scene:
    (body,) = bodies(p)
    joint = r.Spherical(body.at(-p["arm"]), rj.ground.at((0.0, 0.0, 0.0)))
    return rj.Scene([body], [joint], [rj.Gravity(DOWN)])


KINDS = {"top": Kind(draw_top, moved(top_scene), top_motion)}
