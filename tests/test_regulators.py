"""A regulator that is designed with a linear model balances the mechanism itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo

import romjax as rj
from romjax import spatial as r

HALF = 0.4  # of the pole [m]
SETTLED = 1e-3  # what may be left of the start, as a share
SEEN = [f"{body}.{axis}" for body in ("trolley", "pole") for axis in "xy"]


class Regulator(rj.AbstractMarkerEffect):
    """A horizontal force on the trolley from the places and velocities of it and of the pole."""

    trolley: rj.Marker
    pole: rj.Marker
    gain: jax.Array
    needs_twists = True
    dimensions = (3,)

    def wrenches(self, t, poses, twists):
        state = [x.position[:2] for x in poses] + [x.velocity[:2] for x in twists]
        push = -self.gain @ jnp.concatenate(state)
        none = jnp.zeros(3)
        return rj.Wrench(jnp.append(push, 0.0), none), rj.Wrench(none, none)

    def check(self):
        pass


def trolley_with_pole(tilts, gain) -> rj.Scene:
    """A pole on a universal joint on a trolley, which slides in a plane and does not turn."""
    along, across, up = ({"axis": axis} for axis in np.eye(3))
    (sine, other), (cosine, flat) = np.sin(tilts), np.cos(tilts)
    start = {
        "position": HALF * np.array([sine * flat, -other, cosine * flat]),
        "orientation": r.euler("YXZ", (*tilts, 0.0)),
    }
    trolley = r.RigidBody("trolley", 1.5, (0.1, 0.1, 0.1))
    pole = r.RigidBody("pole", 0.5, (0.03, 0.03, 1e-3), **start)
    middle, ground = trolley.at((0, 0, 0), **up), rj.ground.at((0, 0, 0), **up)
    joints = [
        r.Planar(middle, ground),
        rj.FixedAngle(middle, ground, 0.0),
        r.Universal(pole.at((0, 0, -HALF), **along), trolley.at((0, 0, 0), **across)),
    ]
    regulator = Regulator(middle, pole.at((0, 0, 0)), jnp.asarray(gain))
    return rj.Scene([trolley, pole], joints, [rj.Gravity((0, 0, -zoo.GRAVITY)), regulator])


@pytest.mark.slow
def test_a_pole_in_space_is_balanced():
    """From 20 and −15 degrees about its two axes, by a quadratic regulator of the upright pole."""
    import control  # here, since it takes long to import

    scene = trolley_with_pole((0.0, 0.0), np.zeros((2, 8)))
    upright, middle = rj.assemble(scene), scene.bodies[0].at((0, 0, 0))
    pushes = {"along": (1, 0, 0), "across": (0, 1, 0)}
    inputs = {name: rj.Force(middle, axis, rj.Constant(1.0)) for name, axis in pushes.items()}
    model = rj.linearize(upright, inputs, SEEN + [f"{label}'" for label in SEEN])
    a, b, c = (np.asarray(x) for x in (model.A, model.B, model.C))
    assert a.shape == (8, 8)
    weighted = np.sqrt([10.0, 10.0, 30.0, 30.0, 1.0, 1.0, 1.0, 1.0])[:, None] * c
    gain, _, poles = control.lqr(a, b, weighted.T @ weighted, 0.1 * np.eye(2))
    assert np.all(poles.real < 0)

    tilts = np.deg2rad([20.0, -15.0])
    system = rj.assemble(trolley_with_pole(tilts, gain @ np.linalg.inv(c)))
    run = zoo.run(system, np.linspace(0.0, 6.0, 61), rtol=1e-6)
    places = np.stack([run[label] for label in SEEN], axis=1)
    left = np.max(np.abs(places[-1])) / np.max(np.abs(places[0]))
    assert left < SETTLED
