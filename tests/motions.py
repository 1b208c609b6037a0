"""Motions that are made up, for pictures of them."""

import diffrax
import jax.numpy as jnp
import numpy as np

import romjax as rj
from romjax.integrate.derived import Derived
from romjax.integrate.parts import Parts
from romjax.integrate.statistics import Statistics

COUNT = 21


def motion(
    scene: rj.Scene, amplitude: float = 0.1, end: float = 1.0, count: int = COUNT
) -> rj.Trajectory:
    """A made-up motion: coordinate i swings with i + 1 rad/s, the third one rests."""
    system = rj.assemble(scene)
    n = system.n
    t = np.linspace(0.0, end, count)
    omega = np.arange(1, n + 1)
    size = amplitude * np.where(np.arange(n) == 2, 0.0, 1.0 / np.arange(1, n + 1))
    return rj.Trajectory(
        t=jnp.asarray(t),
        q=jnp.asarray(np.asarray(system.q0) + size * np.sin(omega * t[:, None])),
        v=jnp.asarray(size * omega * np.cos(omega * t[:, None])),
        derived=Derived(
            multipliers=jnp.zeros((count, system.m)), metric=jnp.diag(jnp.arange(1.0, n + 1))
        ),
        violation=jnp.zeros(count),
        stats=Statistics(count, count, 0),
        status=jnp.asarray(0),
        coordinates=system.structure.coordinates,
        solver_parts=Parts.of(diffrax.Tsit5()),
    )


def cart_and_beam() -> rj.Scene:
    """A cart on a rail with a bending beam hinged to it."""
    cart = rj.RigidBody("cart", mass=1.0, inertia=0.1)
    beam = rj.Beam("beam", mass=0.5, length=2.0, frequencies=[5.0, 20.0], position=(1.0, 0.0))
    rail = rj.ground.at((0.0, 1.0), angle=0.5)
    return rj.Scene(
        bodies=[cart, beam],
        joints=[rj.PointOnLine(cart.at(), rail), rj.Revolute(cart.at(), beam.at((-1.0, 0.0)))],
    )
