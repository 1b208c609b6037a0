"""The structures of the matrix of verbs: those of the zoo, and some that meet things."""

import functools

import numpy as np
import zoo
from mechanisms import ends
from parallelogram import parallelogram

import romjax as rj
from romjax import spatial as r

FLOOR = -0.3  # [m], below a level bar of 1 m
# Of contacts so soft that a few steps see each of them.
SOFT = {"stiffness": 1e4, "dissipation": 0.1}
TURNING = 3.0  # of drives [rad/s]


# In the plane.


def stop() -> rj.Scene:
    """A bar that falls onto a soft floor below its end, and leaves it again."""
    scene = zoo.bar()
    _, end = ends(scene.bodies[0])
    floor = rj.Contact(end, rj.ground.at((0.0, FLOOR)), rj.Line(), **SOFT)
    return rj.Scene(scene.bodies, scene.joints, [*scene.effects, floor])


def driven_arm() -> rj.Scene:
    """Two bars, of which the first is turned and the second hangs on it."""
    scene = zoo.bars(spins=(TURNING, 0.0))
    drive = rj.PrescribedAngle(scene.bodies[0].at(), rj.ground.at(), rj.Ramp(TURNING))
    return rj.Scene(scene.bodies, [*scene.joints, drive], scene.effects)


def level(scene: rj.Scene) -> list[rj.AbstractEvent]:
    """The end of the only bar of a scene hits a floor."""
    _, end = ends(scene.bodies[0])
    return [_floor(end, rj.ground.at((0.0, FLOOR), angle=np.pi / 2))]


# In space.


def ball() -> rj.Scene:
    """A ball that is thrown along a soft floor, and begins to roll."""
    mass, radius = 0.1, 0.03
    one = r.RigidBody(
        "ball",
        mass,
        0.4 * mass * radius**2 * np.ones(3),
        position=(0.0, 0.0, 0.02 + radius),
        velocity=(0.3, 0.1, 0.0),
    )
    floor = r.Contact(
        one.at((0.0, 0.0, 0.0)),
        rj.ground.at((0.0, 0.0, 0.0)),
        r.Plane(),
        radius=radius,
        friction=rj.Friction(0.1, creep=0.01),
        **SOFT,
    )
    return rj.Scene([one], effects=[rj.Gravity((0.0, 0.0, -zoo.GRAVITY)), floor])


def driven_beam() -> rj.Scene:
    """The beam of the zoo, turned about its hinge, so that it can only bend."""
    scene = zoo.beam_in_space(spin=TURNING)
    hinge = scene.joints[0]
    drive = rj.PrescribedAngle(hinge.a, hinge.b, rj.Ramp(TURNING))
    return rj.Scene(scene.bodies, [hinge, drive], scene.effects)


def level_in_space(scene: rj.Scene) -> list[rj.AbstractEvent]:
    """The end of the only bar of a scene hits a floor."""
    upright = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    return [_floor(scene.bodies[0].at("end"), rj.ground.at((0.0, 0.0, FLOOR), rotation=upright))]


def _floor(end: rj.Marker, level: rj.Marker) -> rj.Impact:
    return rj.Impact(rj.quantity.Travel(end, level), restitution=0.7)


MAKE = {
    "bar": zoo.bar,
    "bars": zoo.bars,
    "four-bar": zoo.four_bar,
    "pinned twice": functools.partial(zoo.four_bar, doubled=True),
    "parallelogram": functools.partial(parallelogram, angle=0.3, twice=True),
    "driven": zoo.driven_four_bar,
    "driven arm": driven_arm,
    "cart": zoo.cart_pendulum,
    "slider crank": zoo.slider_crank,
    "bending rod": functools.partial(zoo.slider_crank, bends=True),
    "five-bar": zoo.five_bar,
    "falling beams": zoo.falling_beams,
    "contact": stop,
    "friction": functools.partial(
        rj.gallery.bouncing_ball, height=0.02, speed=0.3, radius=0.03, **SOFT
    ),
    "impact": zoo.bar,
    "top": zoo.top,
    "ball joints": zoo.ball_bars,
    "loop in space": zoo.loop_in_space,
    "beam in space": zoo.beam_in_space,
    "driven beam": driven_beam,
    "rolling ball": ball,
    "impact in space": functools.partial(rj.gallery.ball_chain, 1),
}
TOUCHING = {"contact", "friction", "rolling ball"}
EVENTS = {"impact": level, "impact in space": level_in_space}
