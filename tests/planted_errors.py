"""Twenty mechanisms in which one thing is wrong each, for the balance of energy to find."""

import dataclasses
from typing import ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from mechanisms import RK4
from parallelogram import parallelogram
from zoo import GRAVITY, point_pendulum

import romjax as rj

# What is not wrong; each plant spoils one thing of it.
MASS, LENGTH, STIFFNESS, DAMPING = 1.3, 0.8, 30.0, 0.4


def swing(*effects, joint=None) -> rj.Scene:
    """A bar on a hinge, with effects between its free end and the ground."""
    bar = rj.RigidBody("bar", MASS, 0.07, position=(LENGTH / 2, 0.0))
    hinge = rj.Revolute(bar.at((-LENGTH / 2, 0.0)), rj.ground.at())
    tip, wall = bar.at((LENGTH / 2, 0.0)), rj.ground.at((1.0, -0.5))
    made = [effect(tip, wall) for effect in effects]
    return rj.Scene([bar], [hinge if joint is None else joint(bar)], [rj.Gravity(), *made])


# Parts with an error in them.


class Spring(rj.AbstractPotential):
    """A spring to get wrong."""

    a: rj.Marker
    b: rj.Marker

    def energy(self, t, *poses):
        return 0.5 * STIFFNESS * jnp.sum((poses[0].position - poses[1].position) ** 2)

    def check(self):
        pass


class OneEnd(Spring):
    """A spring that pulls one end harder than the other."""

    def wrenches(self, t, poses, twists):
        wrench, other = super().wrenches(t, poses, twists)
        return wrench, jax.tree.map(lambda x: 0.9 * x, other)


class WrongSlope(Spring):
    """A spring whose force is not the slope of its energy."""

    def wrenches(self, t, poses, twists):
        return jax.tree.map(lambda x: 1.1 * x, super().wrenches(t, poses, twists))


class Sideways(Spring):
    """A force across the spring, which gains energy in each turn."""

    def wrenches(self, t, poses, twists):
        delta = poses[0].position - poses[1].position
        force = jnp.stack([-delta[1], delta[0]])
        return rj.Wrench(force, jnp.zeros(())), rj.Wrench(-force, jnp.zeros(()))


class Cliff(Spring):
    """An energy that jumps, without a force there."""

    def energy(self, t, *poses):
        return jnp.where(poses[0].position[1] < -0.4, 1.0, 0.0)


class Giving(rj.AbstractDissipation):
    """A damper with the wrong sign."""

    a: rj.Marker
    b: rj.Marker

    def rayleigh(self, t, poses, twists):
        return -0.5 * DAMPING * jnp.sum((twists[0].velocity - twists[1].velocity) ** 2)

    def check(self):
        pass


class Slipping(rj.AbstractJoint):
    """A point on a line, with a part of its derivative along the line."""

    a: rj.Marker
    b: rj.Marker
    name: str = eqx.field(static=True, default="")
    rows: ClassVar[int] = 1

    def residual(self, t, a, b):
        along = b.along(a.position)
        return (b.across(a.position) + 0.2 * (along - jax.lax.stop_gradient(along)))[None]


class Growing(rj.RigidBody):
    """A body whose inertia depends on its angle, but which says that it is constant."""

    def mass_matrix(self, q):
        return jnp.stack([self.mass, self.mass, self.inertia * (1 + 0.5 * jnp.sin(q[2]))])


class Undamped(rj.Beam):
    """A beam whose damping feeds its vibrations."""

    def damping_force(self, v):
        return -super().damping_force(v)


class WrongTableau(diffrax.Bosh3):
    """A method with a coefficient that is wrong in the third digit, with its error estimate."""

    tableau = dataclasses.replace(
        diffrax.Bosh3.tableau,
        b_sol=diffrax.Bosh3.tableau.b_sol + np.array([0.001, -0.001, 0.0, 0.0]),
    )


# Systems with an error in them. A bead on a wire: M(q) = 1 + cos² q.


def bead(mass=None, force=None, energy=None, power=None) -> rj.CustomSystem:
    def right_mass(q):
        return (1 + jnp.cos(q) ** 2)[:, None]

    def right_force(t, q, v):
        own = rj.quadratic_velocity_force(mass or right_mass)(q, v)
        return own - GRAVITY * jnp.sin(q) - DAMPING * v

    return rj.CustomSystem(
        mass or right_mass,
        force or right_force,
        q0=[1.0],
        v0=[2.0],
        energy=energy or (lambda t, q: -GRAVITY * jnp.cos(q[0])),
        power=power or (lambda t, q, v: -DAMPING * v[0] ** 2),
    )


def without_quadratic_forces():
    return bead(force=lambda t, q, v: -GRAVITY * jnp.sin(q) - DAMPING * v)


def swirl():
    """Two coordinates and a force that turns around the origin."""
    return rj.CustomSystem(
        lambda q: jnp.eye(2),
        lambda t, q, v: -9.0 * q + 0.05 * jnp.stack([-q[1], q[0]]),
        q0=[1.0, 0.0],
        v0=[0.0, 2.0],
        energy=lambda t, q: 4.5 * q @ q,
    )


def lopsided_mass():
    """A mass matrix that is not symmetric, without a declared energy."""
    return rj.CustomSystem(
        lambda q: jnp.array([[2.0, 0.5], [0.0, 1.0]]),
        lambda t, q, v: -9.0 * q,
        q0=[1.0, 0.0],
        v0=[0.0, 2.0],
    )


def two_masses():
    """On a spring, in free fall."""
    a, b = (
        rj.RigidBody(name, MASS, 0.1, position=(x, 0.0)) for name, x in (("a", 0.0), ("b", 1.0))
    )
    return rj.Scene([a, b], [], [rj.Gravity(), OneEnd(a.at(), b.at())])


def growing():
    bodies = [Growing("bar", MASS, 0.07, position=(LENGTH / 2, 0.0))]
    hinge = rj.Revolute(bodies[0].at((-LENGTH / 2, 0.0)), rj.ground.at())
    return rj.Scene(bodies, [hinge], [rj.Gravity()])


def fed_beam():
    shape = {"modes": 2, "shapes": "clamped-free", "amplitudes": (0.05, 0.0)}
    beam = Undamped("beam", MASS, LENGTH, EI=5.0, damping=0.02, **shape)
    return rj.Scene(
        [beam],
        [rj.Weld(beam.at((-LENGTH / 2, 0.0)), rj.ground.at((-LENGTH / 2, 0.0)))],
        [rj.Gravity()],
    )


def torn():
    """An angle that is held, and turned."""
    wheel = rj.RigidBody("wheel", mass=1.0, inertia=0.1)
    ends = wheel.at(), rj.ground.at()
    return rj.Scene(
        [wheel], [rj.FixedAngle(*ends), rj.PrescribedAngle(*ends, rj.Step(0.5, 0.05, 0.1))]
    )


CHANGE_POINT = {"solver": rj.Rodas5P(), "rtol": 1e-9, "stabilization": rj.Baumgarte(10.0, 100.0)}
STEPS = {"solver": RK4()}
PLANTED = {
    "a spring that pulls one end": (two_masses, {}),
    "a force that is no slope": (lambda: swing(WrongSlope), {}),
    "a force across": (lambda: swing(Sideways), {}),
    "an energy that jumps": (lambda: swing(Cliff), {}),
    "a damper that gives": (lambda: swing(Giving), {}),
    "a beam whose damping gives": (fed_beam, {"solver": rj.Rodas5P()}),
    "a joint with a wrong slope": (
        lambda: swing(
            joint=lambda bar: Slipping(bar.at((-LENGTH / 2, 0.0)), rj.ground.at(angle=-0.5))
        ),
        {},
    ),
    "a body that is not constant": (growing, {}),
    "no quadratic velocity force": (without_quadratic_forces, {}),
    "a mass matrix that is not symmetric": (lopsided_mass, {}),
    "a force that turns": (swirl, {}),
    "a wrong energy": (lambda: bead(energy=lambda t, q: -9.0 * jnp.cos(q[0])), {}),
    "a wrong power": (lambda: bead(power=lambda t, q, v: DAMPING * v[0] ** 2), {}),
    "a power that is missing": (lambda: bead(power=lambda t, q, v: 0.0 * v[0]), {}),
    "a loose tolerance": (point_pendulum, {"rtol": 0.3, "solver": diffrax.Tsit5()}),
    "long steps": (point_pendulum, STEPS | {"dt": 0.4}),
    "no stabilisation in long steps": (point_pendulum, STEPS | {"dt": 0.2, "stabilization": None}),
    "a wrong method": (swing, {"solver": WrongTableau()}),
    "a torn joint": (torn, {}),
    "a change point": (parallelogram, CHANGE_POINT),
}
