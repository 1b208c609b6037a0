"""Trees of bodies by lot, in the plane and in space, with every joint that has own coordinates."""

import numpy as np
import random_scenes
import random_spatial_scenes
from random_scenes import Lot

import romjax as rj

r = rj.spatial

# By name and numbers.
IN_PLANE = (
    lambda lot, *at: rj.Revolute(*at),
    lambda lot, *at: rj.Prismatic(*at, value=lot.around(1.0)),
    lambda lot, *at: rj.Weld(*at, value=lot.around(1.0)),
    lambda lot, *at: rj.FixedAngle(*at, value=lot.around(1.0)),
    lambda lot, *at: rj.PointOnLine(*at),
)
IN_SPACE = (
    lambda lot, *at: r.Revolute(*at),
    lambda lot, *at: r.Spherical(*at),
    lambda lot, *at: r.Universal(*at),
    lambda lot, *at: r.Cylindrical(*at),
    lambda lot, *at: r.Prismatic(*at),
    lambda lot, *at: r.Planar(*at),
    lambda lot, *at: r.Weld(*at),
    lambda lot, *at: r.ConstantVelocity(*at),
    lambda lot, *at: r.PointOnPlane(*at),
    lambda lot, *at: rj.PointOnLine(*at),
    lambda lot, *at: r.Screw(*at, pitch=lot.between(0.1, 0.5), offset=lot.around(0.3)),
)


def tree(seed: int, space: bool, flexible: bool = True) -> rj.Scene:
    """Some bodies on joints of any kind, each on the ground or an earlier one, and one that is
    free; first or second marker on it.

    The joints do not hold: joint coordinates put the bodies where they do.
    """
    lot = Lot(np.random.default_rng([5, seed]), np.random.default_rng([6, seed]))
    own = random_spatial_scenes if space else random_scenes
    kinds, count = IN_SPACE if space else IN_PLANE, 4
    bodies, joints = [], []
    for k in range(count):
        if space:
            body = own.random_body(lot, f"body{k}", beam=flexible and lot.chance(0.4))
        else:
            body = own.random_body(lot, f"body{k}")
            while not flexible and body.modes:
                body = own.random_body(lot, f"body{k}")
        on = lot.one_of([None, *bodies, *bodies[-1:]])
        if k != 1:
            ends = [own.random_marker(lot, body), _marker(own, lot, on, space)]
            order = 1 if lot.chance(0.5) else -1
            joints.append(kinds[(seed * 3 + k) % len(kinds)](lot, *ends[::order]))
        bodies.append(body)
    a, b = own.random_marker(lot, bodies[0]), own.random_marker(lot, bodies[-1])
    effects = [
        rj.Gravity(lot.around(10.0, 3 if space else 2)),
        rj.Spring(a, b, lot.between(1, 99), 0.5),
        rj.Damper(a, b, lot.between(0, 3)),
    ]
    return rj.Scene(bodies, joints, effects)


def _marker(own, lot: Lot, on, space: bool) -> rj.Marker:
    return own.random_marker(lot, rj.ground if space and on is None else on)
