"""Mechanisms with known motions, and the classical method that they are stepped with."""

from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import romjax as rj


class RK4(diffrax.AbstractERK):
    """The classical Runge–Kutta method, for steps of a given size."""

    tableau = diffrax.ButcherTableau(
        c=np.array([0.5, 0.5, 1.0]),
        b_sol=np.array([1, 2, 2, 1]) / 6,
        b_error=np.zeros(4),
        a_lower=(np.array([0.5]), np.array([0, 0.5]), np.array([0, 0, 1.0])),
    )
    interpolation_cls = diffrax.ThirdOrderHermitePolynomialInterpolation.from_k

    def order(self, terms):
        return 4


class Moving(rj.AbstractJoint):
    """A hinge whose place on `b` runs along x at a given speed [m/s]."""

    a: rj.Marker
    b: rj.Marker
    speed: jax.Array = eqx.field(converter=jnp.asarray)
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 2

    def residual(self, t, a, b):
        return a.position - b.position - jnp.stack([self.speed * t, jnp.zeros_like(t)])


def bar(name, start, end, mass=1.0, velocity=(0.0, 0.0, 0.0)) -> rj.RigidBody:
    """A uniform bar between two points."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    along = end - start
    length = float(np.hypot(*along))
    return rj.RigidBody(
        name,
        mass=mass,
        inertia=mass * length**2 / 12,
        position=(start + end) / 2,
        angle=float(np.arctan2(along[1], along[0])),
        velocity=velocity[:2],
        angular_velocity=velocity[2],
        extent=(length, 0.1),
    )


def ends(body: rj.RigidBody) -> tuple[rj.Marker, rj.Marker]:
    half = body.extent * jnp.array([0.5, 0.0])
    return body.at(-half), body.at(half)


def linkage(points, bars, turning, gravity=False, masses=None, extra=()) -> rj.Scene:
    """Bars between named points; points on the ground have names in capitals.

    `points` gives places by name, `bars` pairs of names, `turning` the velocities of the points.
    """
    bodies, markers = [], {}
    for k, (a, b) in enumerate(bars):
        start, end = np.asarray(points[a], float), np.asarray(points[b], float)
        va, vb = (np.asarray(turning.get(name, (0.0, 0.0)), float) for name in (a, b))
        along = end - start
        rate = float(along[0] * (vb - va)[1] - along[1] * (vb - va)[0]) / float(along @ along)
        mass = 1.0 if masses is None else masses[k]
        body = bar(a + b, start, end, mass, (*(va + vb) / 2, rate))
        bodies.append(body)
        for name, marker in zip((a, b), ends(body), strict=True):
            markers.setdefault(name, []).append(marker)
    joints = []
    for name, held in markers.items():
        anchor = rj.ground.at(points[name]) if name.isupper() else held.pop(0)
        joints += [rj.Revolute(marker, anchor) for marker in held]
    return rj.Scene(bodies, (*joints, *extra), [rj.Gravity()] if gravity else [])


def turned_about_the_origin(system, spin, tilt):
    """The start of beams that lie along x, turned by `tilt` [rad], turning with `spin` [rad/s]."""
    q = np.asarray(system.q0).reshape(-1, 6).copy()
    c, s = np.cos(tilt), np.sin(tilt)
    q[:, :2] = q[:, :2] @ np.array([[c, s], [-s, c]])
    q[:, 2] += tilt
    v = np.zeros_like(q)
    v[:, :3] = spin * np.stack([-q[:, 1], q[:, 0], np.ones(len(q))], axis=1)
    return jnp.asarray(q.ravel()), jnp.asarray(v.ravel())
