"""A scene in another place: all of it turned and shifted, and nothing else changed."""

import dataclasses

import jax
import numpy as np

import romjax as rj

TURN, SHIFT = 0.7, np.array([0.4, -0.9])
ROTATION = np.array([[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]])


def moved_marker(marker: rj.Marker) -> rj.Marker:
    """Those on bodies move with their bodies."""
    if marker.body != "ground":
        return marker
    place = ROTATION @ np.asarray(marker.point) + SHIFT
    return rj.Marker(marker.body, place, marker.angle + TURN)


def moved_body(body: rj.AbstractBody) -> rj.AbstractBody:
    return dataclasses.replace(
        body,
        position=ROTATION @ np.asarray(body.position) + SHIFT,
        angle=body.angle + TURN,
        velocity=ROTATION @ np.asarray(body.velocity),
    )


def moved_part(part):
    """A joint or an effect. All that acts between markers sees only how they are to each other."""

    def is_marker(x):
        return isinstance(x, rj.Marker)

    part = jax.tree.map(lambda x: moved_marker(x) if is_marker(x) else x, part, is_leaf=is_marker)
    if isinstance(part, rj.Gravity):
        return rj.Gravity(ROTATION @ np.asarray(part.acceleration))
    if isinstance(part, rj.Force) and part.frame == "world":
        return dataclasses.replace(part, direction=ROTATION @ np.asarray(part.direction))
    if isinstance(part, rj.Gear):
        # φ_a = ratio φ_b + offset counts both angles from the world's x axis, which stays behind:
        # φ_a + turn = ratio (φ_b + turn) + offset + (1 − ratio) turn.
        return dataclasses.replace(part, offset=part.offset + (1 - part.ratio) * TURN)
    return part


def moved_scene(scene: rj.Scene) -> rj.Scene:
    parts = [[moved_part(part) for part in parts] for parts in (scene.joints, scene.effects)]
    return rj.Scene([moved_body(body) for body in scene.bodies], *parts)


def turned(scene: rj.Scene, x) -> np.ndarray:
    """Velocities or accelerations of all bodies, turned."""
    x, at = np.array(x), 0
    for body in scene.bodies:
        x[at : at + 2] = ROTATION @ x[at : at + 2]
        at += body.size
    return x


def moved_coordinates(scene: rj.Scene, q) -> np.ndarray:
    q, at = turned(scene, q), 0
    for body in scene.bodies:
        q[at : at + 3] += [*SHIFT, TURN]
        at += body.size
    return q
