"""Bars between points: a four-bar, a five-bar and a slider crank, for several comparisons."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

import romjax as rj

Point = Sequence[float]
REST = ((0.0, 0.0), (0.0, 0.0))
FOUR_BAR = ((0.0, 0.0), (0.3, 0.9), (1.8, 1.3), (2.0, 0.0))


def bar(
    name: str, start: Point, end: Point, mass: float = 1.0, velocities: Sequence[Point] = REST
) -> rj.RigidBody:
    """A uniform bar between two points that have these velocities."""
    along, faster = np.subtract(end, start), np.subtract(velocities[1], velocities[0])
    length = float(np.hypot(*along))
    return rj.RigidBody(
        name,
        mass=mass,
        inertia=mass * length**2 / 12,
        position=np.add(start, end) / 2,
        angle=float(np.arctan2(along[1], along[0])),
        velocity=np.mean(velocities, axis=0),
        angular_velocity=float(along[0] * faster[1] - along[1] * faster[0]) / length**2,
        extent=(length, 0.1),
    )


def ends(body: rj.RigidBody) -> tuple[rj.Marker, rj.Marker]:
    """Its start and its end."""
    half = body.extent * jnp.array([0.5, 0.0])
    return body.at(-half), body.at(half)


def four_bar(
    points: Sequence[Point] = FOUR_BAR,
    coupler: float = 1.0,
    twice: bool = False,
    velocities: Sequence[Point] = REST,
    gravity: bool = True,
) -> rj.Scene:
    """Crank, coupler of a given mass [kg] and rocker between four points, the outer ones on the
    ground, the inner ones with these velocities. The first hinge may be made twice.
    """
    a, b, c, d = points
    fixed = (0.0, 0.0)
    bodies = [
        bar("crank", a, b, velocities=(fixed, velocities[0])),
        bar("coupler", b, c, coupler, velocities),
        bar("rocker", d, c, velocities=(fixed, velocities[1])),
    ]
    (foot, knee), (left, right), (base, top) = (ends(body) for body in bodies)
    joints = [
        rj.Revolute(foot, rj.ground.at(a)),
        rj.Revolute(knee, left),
        rj.Revolute(base, rj.ground.at(d)),
        rj.Revolute(right, top),
    ]
    more = joints[:1] if twice else []
    return rj.Scene(bodies, joints + more, [rj.Gravity()] if gravity else [])


def bending_four_bar(speed: float = 10.0, EI: float = 7.0) -> rj.Scene:
    """A crank that turns steadily [rad/s], a coupler of this stiffness [N m²], and a rocker."""
    base, knee, top, foot = (0.0, 0.0), (0.05, 0.09), (0.28, 0.42), (0.35, 0.13)
    crank, rod, rocker = (
        bar("crank", base, knee, 0.05),
        bar("coupler", knee, top),
        bar("rocker", foot, top, 0.08),
    )
    place = {"position": rod.position, "angle": rod.angle}
    coupler = rj.Beam("coupler", 0.11, float(rod.extent[0]), EI=EI, modes=2, **place)
    joints = [
        rj.Revolute(ends(crank)[0], rj.ground.at(base)),
        rj.Revolute(coupler.at("start"), ends(crank)[1]),
        rj.Revolute(ends(rocker)[1], coupler.at("end")),
        rj.Revolute(ends(rocker)[0], rj.ground.at(foot)),
        rj.PrescribedAngle(crank.at(), rj.ground.at(), rj.Ramp(speed, crank.angle)),
    ]
    return rj.consistent_scene(rj.Scene([crank, coupler, rocker], joints, [rj.Gravity()]))


def five_bar(rod: float = 1.0, spring: float = 60.0) -> rj.Scene:
    """Two cranks and between them two rods, one of a given mass [kg], whose common pin hangs on a
    spring [N/m]; two freedoms.
    """
    points = ((0.0, 0.0), (-0.6, 1.0), (0.6, 1.9), (1.7, 1.0), (1.0, 0.0))
    a, b, c, d, e = points
    bodies = [bar("left", a, b), bar("rod", b, c, rod), bar("other", c, d), bar("right", e, d)]
    (foot, knee), (start, pin), (top, end), (base, elbow) = (ends(body) for body in bodies)
    joints = [
        rj.Revolute(foot, rj.ground.at(a)),
        rj.Revolute(knee, start),
        rj.Revolute(pin, top),
        rj.Revolute(end, elbow),
        rj.Revolute(base, rj.ground.at(e)),
    ]
    springs = [
        rj.Spring(pin, rj.ground.at((0.5, 2.6)), spring, 0.5),
        rj.Spring(bodies[0].at(), rj.ground.at((-1.5, 1.0)), 50.0, 1.0),
        rj.Spring(bodies[3].at(), rj.ground.at((2.5, 1.0)), 50.0, 1.0),
    ]
    return rj.Scene(bodies, joints, [rj.Gravity(), *springs])


def slider_crank(
    p: Point, s: Point, inertia: float, velocities: Sequence[Point] = REST, gravity: bool = True
) -> rj.Scene:
    """Crank from the origin to p, rod from p to s, and a slider of 1 kg at s on the x axis."""
    crank = bar("crank", (0.0, 0.0), p, velocities=((0.0, 0.0), velocities[0]))
    rod = bar("rod", p, s, velocities=velocities)
    slider = rj.RigidBody("slider", 1.0, inertia, position=s, velocity=velocities[1])
    (foot, knee), (left, right) = ends(crank), ends(rod)
    joints = [
        rj.Revolute(foot, rj.ground.at()),
        rj.Revolute(knee, left),
        rj.PointOnLine(slider.at(), rj.ground.at()),
        rj.FixedAngle(slider.at(), rj.ground.at()),
        rj.Revolute(right, slider.at()),
    ]
    return rj.Scene([crank, rod, slider], joints, [rj.Gravity()] if gravity else [])
