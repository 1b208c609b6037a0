"""Motions that are made up, for pictures of them."""

import diffrax
import jax.numpy as jnp
import numpy as np

import romjax as rj
from romjax.common.partition import Partitioned
from romjax.integrate.derived import EagerQuantities
from romjax.integrate.statistics import Statistics

COUNT = 21


def through(system: rj.AbstractSystem, t=(0.0,), q=None, v=None) -> rj.Trajectory:
    """The run of a system through these states, the start if none are given, that nobody
    integrated.
    """
    t = np.asarray(t, float)
    q, v = (
        np.broadcast_to(np.asarray(start if x is None else x), (len(t), system.n))
        for x, start in ((q, system.q0), (v, system.v0))
    )
    return rj.Trajectory(
        t=jnp.asarray(t),
        q=jnp.asarray(q),
        v=jnp.asarray(v),
        derived=EagerQuantities(
            multipliers=jnp.asarray(np.zeros((len(t), system.m))),
            metric=jnp.asarray(np.diag(np.arange(1.0, system.n + 1))),
        ),
        violation=jnp.asarray(np.zeros(len(t))),
        stats=Statistics(len(t), len(t), 0),
        status=jnp.asarray(0),
        coordinates=system.structure.coordinates,
        solver_parts=Partitioned.of(diffrax.Tsit5()),
    )


def motion(
    scene: rj.Scene, amplitude: float = 0.1, end: float = 1.0, count: int = COUNT
) -> rj.Trajectory:
    """A made-up motion: coordinate i swings with i + 1 rad/s, the third one rests."""
    system = rj.assemble(scene)
    n = system.n
    t = np.linspace(0.0, end, count)
    omega = np.arange(1, n + 1)
    size = amplitude * np.where(np.arange(n) == 2, 0.0, 1.0 / np.arange(1, n + 1))
    q = np.asarray(system.q0) + size * np.sin(omega * t[:, None])
    return through(system, t, q, size * omega * np.cos(omega * t[:, None]))


def cart_and_beam() -> rj.Scene:
    """A cart on a rail with a bending beam hinged to it."""
    cart = rj.RigidBody("cart", mass=1.0, inertia=0.1)
    beam = rj.Beam("beam", mass=0.5, length=2.0, frequencies=[5.0, 20.0], position=(1.0, 0.0))
    rail = rj.ground.at((0.0, 1.0), angle=0.5)
    return rj.Scene(
        bodies=[cart, beam],
        joints=[rj.PointOnLine(cart.at(), rail), rj.Revolute(cart.at(), beam.at((-1.0, 0.0)))],
    )
