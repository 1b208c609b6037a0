"""Flexible bodies in space.

The truth is a run at rtol = 1e-10 by another method and another stabilisation, whose whole world is
turned and moved: in other coordinates of positions and quaternions. The energies of a beam in space
are not written anew.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

import romjax as rj

from .kind import Kind, Numbers, moved, places, times
from .minimal import GRAVITY
from .planar import log
from .spatial import axes

r = rj.spatial
TIGHT = 1e-10
FIRST = 4.730040744862704**2


def draw_beam(chance: np.random.Generator) -> Numbers:
    """A beam with its first frequencies in both planes [Hz]."""
    mass, length = log(chance, 0.1, 10.0), log(chance, 0.3, 3.0)
    hertz = log(chance, 2.0, 80.0) * np.array([1.0, chance.uniform(0.5, 2.0)])
    across = mass * length**2 / 12
    return {
        "mass": np.asarray(mass),
        "length": np.asarray(length),
        "moments": np.array([0.02 * across, across, across]),
        "EI": (2 * np.pi * hertz / FIRST) ** 2 * mass * length**3,
        "damping": np.asarray(chance.choice([0.0, log(chance, 1e-3, 1e-1)])),
        "frame": Rotation.random(rng=chance).as_matrix(),
        "axis": axes(chance, 1)[0],
        "spin": np.asarray(chance.uniform(-6.0, 6.0)),
        "down": np.array([0.0, 0.0, -GRAVITY]),
        "origin": np.zeros(3),
        "end": np.asarray(log(chance, 0.1, 1.0)),
    }


def beam_scene(p: Numbers) -> rj.Scene:
    """The beam on a ball joint, turning about the "axis" of its frame; its weight bends it."""
    xp = jnp if isinstance(p["frame"], jax.Array) else np
    turning = p["spin"] * (p["frame"] @ p["axis"])
    arm = p["frame"][:, 0] * p["length"] / 2
    beam = r.Beam(
        "beam",
        p["mass"],
        p["length"],
        p["moments"],
        EI=p["EI"],
        bending=2,
        damping=xp.stack([p["damping"]] * 4),
        position=p["origin"] + arm,
        orientation=p["frame"],
        velocity=xp.cross(turning, arm),
        angular_velocity=turning,
    )
    hinge = r.Spherical(beam.at("start"), rj.ground.at(p["origin"]))
    return rj.Scene([beam], [hinge], [rj.Gravity(p["down"])])


# How the world of the truth is turned and moved.
TURN = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
SHIFT = np.array([0.4, -0.3, 0.2])


def turned(p: Numbers, nudge: float) -> Numbers:
    """Numbers of the same scene in another place, whose start is moved."""
    moved_on = Rotation.from_rotvec(nudge * np.ones(3)).as_matrix() @ p["frame"]
    return {**p, "frame": TURN @ moved_on, "down": TURN @ p["down"], "origin": SHIFT}


def motion(p: Numbers, nudge: float = 0.0) -> np.ndarray:
    system = rj.assemble(beam_scene(turned(p, nudge)))
    ts, tight = times(p["end"]), {"rtol": TIGHT, "stabilization": rj.Projection(), "audit": False}
    run = rj.simulate(system, ts, solver=diffrax.Dopri8(), **tight)
    found = np.asarray(places(system, run)).reshape(len(ts), -1, 3)
    return ((found - SHIFT) @ TURN).reshape(len(ts), -1)


KINDS = {"beam in space": Kind(draw_beam, moved(beam_scene), motion)}
