"""Mechanics written a second time, from material points, for the tests to compare with."""

import jax
import jax.numpy as jnp
import numpy as np

import romjax as rj

# Gauss–Legendre points along a beam: enough for the squares of the first three mode shapes, whose
# argument βL reaches 11, down to rounding.
POINTS = 40


def mixed_scene() -> rj.Scene:
    """A sprung slider, a damped clamped arm along x and a pinned tip along y, with forces of all
    kinds.
    """
    slider = rj.RigidBody("slider", mass=1.3, inertia=0.2, position=(0.2, 0.1))
    arm = rj.Beam(
        "arm", 0.7, 1.1, EI=4.0, modes=3, shapes="clamped-free", damping=0.03, position=(0.75, 0.1)
    )
    tip = rj.Beam(
        "tip",
        0.4,
        0.6,
        EI=2.0,
        modes=2,
        axis="y",
        shapes="pinned-free",
        inertia=0.02,
        position=(1.3, -0.2),
    )
    return rj.Scene(
        bodies=[slider, arm, tip],
        joints=[
            rj.PointOnLine(slider.at((0.0, -0.1)), rj.ground.at((0.2, 0.0), angle=0.3)),
            rj.FixedAngle(slider.at(), rj.ground.at(), value=0.1),
            rj.Revolute(slider.at(), arm.at((-0.55, 0.0))),
            rj.Revolute(arm.at((0.55, 0.0)), tip.at((0.0, 0.3))),
        ],
        effects=[
            rj.Spring(slider.at(), rj.ground.at((-1.0, 0.0)), stiffness=30.0, rest_length=0.8),
            rj.Spring(tip.at((0.0, -0.3)), rj.ground.at((1.0, -1.0)), stiffness=20.0),
            rj.Damper(arm.at((0.2, 0.0)), tip.at((0.0, -0.1)), damping=0.7),
            rj.Force(tip.at((0.0, 0.1)), (0.6, -0.8), rj.Table([0.0, 1.0, 2.0], [1.0, 4.0, 3.0])),
            rj.Gravity(),
        ],
    )


def coordinates(scene: rj.Scene, q):
    """The coordinates of each body, by name."""
    ends = np.cumsum([body.size for body in scene.bodies])[:-1]
    return dict(zip((b.name for b in scene.bodies), jnp.split(q, ends), strict=True))


def place(body: rj.AbstractBody, q, point):
    """Where a material point is: r = R + A(φ) (X + S q_f)."""
    c, s = jnp.cos(q[2]), jnp.sin(q[2])
    arm = point + body.mode_shapes(point)[:2] @ q[3:]
    return q[:2] + jnp.stack([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])


def marker_place(scene: rj.Scene, marker: rj.Marker, q):
    """Where a marker is."""
    for body in scene.bodies:
        if body.name == marker.body:
            return place(body, coordinates(scene, q)[body.name], marker.point)
    return marker.point


def material_points(body: rj.AbstractBody) -> tuple[np.ndarray, np.ndarray, float]:
    """Points, their masses, and the moment of inertia that they lack.

    A rigid body is a dumbbell of its mass and inertia, a beam a line with Gauss–Legendre weights;
    what its inertia exceeds that of a line by is the rotary inertia of its cross-sections.
    """
    mass = float(body.mass)
    if isinstance(body, rj.RigidBody):
        radius = (float(body.inertia) / mass) ** 0.5
        return np.array([[-radius, 0.0], [radius, 0.0]]), np.full(2, mass / 2), 0.0
    assert isinstance(body, rj.Beam)
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    along, none = nodes * float(body.length) / 2, np.zeros(POINTS)
    points = np.stack([along, none] if body.axis == "x" else [none, along], axis=1)
    line = mass * float(body.length) ** 2 / 12
    rest = 0.0 if body.inertia is None else float(body.inertia) - line
    return points, mass * weights / 2, rest


def kinetic_energy(scene: rj.Scene, q, v):
    """½ Σ m |v|² over the material points of all bodies."""
    total = 0.0
    for body in scene.bodies:
        own, rate = coordinates(scene, q)[body.name], coordinates(scene, v)[body.name]
        points, masses, rest = material_points(body)

        def velocity(point, body=body, own=own, rate=rate):
            return jax.jvp(lambda q: place(body, q, point), (own,), (rate,))[1]

        squares = jnp.sum(jax.vmap(velocity)(jnp.asarray(points)) ** 2, axis=1)
        total += 0.5 * masses @ squares + 0.5 * rest * rate[2] ** 2
    return total


def potential_energy(scene: rj.Scene, q):
    """Elastic energy of beams and springs, and the height of the centres of mass."""
    total = 0.0
    for body in scene.bodies:
        own = coordinates(scene, q)[body.name]
        if isinstance(body, rj.Beam):
            total += 0.5 * jnp.sum((body.natural_frequencies() * own[3:]) ** 2)
        for effect in scene.effects:
            if isinstance(effect, rj.Gravity):
                points, masses, _ = material_points(body)
                places = jax.vmap(lambda point, body=body, own=own: place(body, own, point))(
                    jnp.asarray(points)
                )
                total -= effect.acceleration @ (masses @ places)
    for effect in scene.effects:
        if isinstance(effect, rj.Spring):
            reach = marker_place(scene, effect.a, q) - marker_place(scene, effect.b, q)
            length = jnp.sqrt(reach @ reach)
            rest = 0.0 if effect.rest_length is None else effect.rest_length
            total += 0.5 * effect.stiffness * (length - rest) ** 2
    return total


def power(scene: rj.Scene, t, q, v):
    """What loads put in less what dampers take out."""

    def velocity(marker):
        return jax.jvp(lambda q: marker_place(scene, marker, q), (q,), (v,))[1]

    total = 0.0
    for body in scene.bodies:
        if isinstance(body, rj.Beam) and body.damping is not None:
            rates = coordinates(scene, v)[body.name][3:]
            total -= jnp.sum(2 * body.damping * body.natural_frequencies() * rates**2)
    for effect in scene.effects:
        if isinstance(effect, rj.Damper):
            apart = velocity(effect.a) - velocity(effect.b)
            total -= effect.damping * apart @ apart
        if isinstance(effect, rj.Force):
            direction = effect.direction / jnp.linalg.norm(effect.direction)
            total += effect.signal(t) * direction @ velocity(effect.at)
    return total
