"""A parallelogram of point masses, which passes its change points."""

import jax
import jax.numpy as jnp
import numpy as np

import romjax as rj

# Its sides [m].
CRANK, COUPLER = 1.2, 2.0


def parallelogram(
    masses=(1.3, 0.7), speed=0.9, angle=np.pi / 2, crank=CRANK, coupler=COUPLER, twice=False
) -> rj.Scene:
    """Two masses on bars of equal length, a bar between them, gravity; the bars start at an
    `angle` against the x axis and move with `speed` [m/s]. `twice`: the middle bar is made twice.
    """
    xp = jnp if isinstance(angle, jax.Array) else np
    along = xp.stack([xp.cos(angle), xp.sin(angle)])
    velocity = speed * xp.stack([-along[1], along[0]])
    anchors = np.zeros(2), xp.stack([xp.asarray(coupler, float), xp.zeros(())])
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
