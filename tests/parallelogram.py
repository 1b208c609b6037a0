"""A parallelogram of point masses, which passes its change points."""

import jax.numpy as jnp

import romjax as rj

# Its sides [m].
CRANK, COUPLER = 1.2, 2.0


def parallelogram(
    masses=(1.3, 0.7), speed=0.9, angle=jnp.pi / 2, crank=CRANK, coupler=COUPLER, twice=False
) -> rj.Scene:
    """Two masses on bars of equal length, a bar between them, gravity; the bars start at an
    `angle` against the x axis and move with `speed` [m/s]. `twice`: the middle bar is made twice.
    """
    along = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    velocity = speed * jnp.stack([-along[1], along[0]])
    anchors = jnp.zeros(2), jnp.stack([jnp.asarray(coupler, float), jnp.zeros(())])
    a, b = (
        rj.RigidBody(name, mass, 1.0, position=anchor + crank * along, velocity=velocity)
        for name, mass, anchor in zip("ab", masses, anchors, strict=True)
    )
    bars = [
        rj.Distance(body.at(), rj.ground.at(anchor), crank)
        for body, anchor in zip((a, b), anchors, strict=True)
    ]
    middle = [
        rj.Distance(a.at(), b.at(), coupler, name=name) for name in ("middle", "again")[: 1 + twice]
    ]
    return rj.Scene([a, b], [*bars, *middle], [rj.Gravity()])
