"""Two bodies, parts between them, and their outlines."""

import jax
import numpy as np
from mechanics import marker_place
from programs import kept

import romjax as rj
from romjax.assembly.outlines import MovingOutline, outlines

ONE = rj.RigidBody("one", 2.0, 0.3, position=(0.4, 0.1), angle=0.3)


TWO = rj.Beam("two", 0.7, 1.1, EI=4.0, modes=2, position=(1.1, -0.2), angle=-0.5)


ENDS = ONE.at((0.2, 0.1), 0.2), TWO.at((-0.1, 0.0), -0.4)


def scene_of(*parts, bodies=(ONE, TWO)) -> rj.Scene:
    joints = [part for part in parts if isinstance(part, rj.AbstractJoint)]
    return rj.Scene(bodies, joints, [part for part in parts if part not in joints])


def some(scene: rj.Scene, frames: int = 3) -> np.ndarray:
    """Configurations around the start; joints need not hold."""
    start = np.concatenate([body.start()[0] for body in scene.bodies])
    return start + 0.2 * np.random.default_rng(4).normal(size=(frames, len(start)))


def signs(scene: rj.Scene, q: np.ndarray, t=0.3) -> list[MovingOutline]:
    """Outlines of all but bodies."""
    return [outline for outline in outlines(scene, t, q) if outline.style != "body"]


def ends(scene, part, q):
    """Places of both markers over time."""
    return [np.asarray(x) for x in marker_places(scene, part.markers, q)]


@kept
def marker_places(scene, markers, q):
    return [jax.vmap(lambda x, m=m: marker_place(scene, m, x))(q) for m in markers]
