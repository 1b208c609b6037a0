"""Mechanisms whose rest and small motions are known in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import zoo
from jaxtyping import Array

import romjax as rj
from romjax.scene.body.modes import bending_roots, bending_shapes


def clamped_beam(
    mass=1.0,
    length=1.0,
    EI=1.0,
    damping=0.0,
    push=0.0,
    frequency=0.0,
    phase=np.pi / 2,
    gravity=0.0,
    amplitudes=(0.0, 0.0, 0.0),
) -> rj.Scene:
    """A beam along x with three modes that is clamped at its lower end, pushed up at the other by
    `push` sin(2π `frequency` t + `phase`), a constant unless given.
    """
    beam = rj.Beam(
        "beam",
        mass,
        length,
        EI=EI,
        modes=3,
        shapes="clamped-free",
        damping=damping,
        position=(length / 2, 0.0),
        amplitudes=amplitudes,
    )
    root = rj.Weld(beam.at((-length / 2, 0.0)), rj.ground.at(), name="root")
    at_tip = rj.Force(beam.at((length / 2, 0.0)), (0.0, 1.0), rj.Sine(push, frequency, phase=phase))
    return rj.Scene([beam], [root], [at_tip, rj.Gravity((0.0, -gravity))])


def frequencies_and_shapes(mass, length, EI, place, modes=3):
    """Of a clamped beam: its frequencies [rad/s], and its modes at places, 0 to 1."""
    frequencies = bending_roots("clamped-free", modes) ** 2 * np.sqrt(EI / (mass * length**3))
    values = bending_shapes("clamped-free", modes, np.asarray(place)[..., None], np)[0]
    return frequencies, values / np.sqrt(mass)


def hung_twice(masses=(1.0, 1.0), angles=(0.0, 0.0)) -> rj.AbstractSystem:
    """Two bars, the first on two equal hinges."""
    scene = zoo.bars(masses, angles=angles)
    return rj.assemble(rj.Scene(scene.bodies, (*scene.joints, scene.joints[0]), scene.effects))


def both_slopes(function, at) -> tuple[Array, Array, Array]:
    """The value of a scalar function, its forward and its reverse derivative, traced once."""
    value, forward = jax.linearize(function, at)
    (backward,) = jax.linear_transpose(forward, at)(jnp.ones_like(value))
    return value, forward(jnp.ones_like(at)), backward
