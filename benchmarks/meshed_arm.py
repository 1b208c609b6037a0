"""A robot arm in space whose three links are meshes of solid elements, each by thirty modes."""

import functools
from collections.abc import Iterator

import numpy as np
import skfem
from finite_elements import meshed

import romjax as rj

r = rj.spatial
YOUNG, POISSON, DENSITY, DAMPING = 3e9, 0.38, 1300.0, 0.02  # of a polymer, SI; damping ratio
# Length, width and height of the links [m], and their elements; 675 nodes each.
LINKS = {
    "upper arm": (0.5, 0.05, 0.07),
    "forearm": (0.4, 0.04, 0.055),
    "hand": (0.25, 0.03, 0.04),
}
ELEMENTS = (13, 2, 2)
VIBRATION = 24  # modes beside the six static ones that two ports have
SIDE = (0.0, -1.0, 0.0)  # axis of the hinges that lift
# Of column and links: angles [rad], and gains of the drives [N m/rad], a tenth of them [N m s/rad].
ANGLES, GAINS = (1.0, 0.6, -0.9, -0.5), (400.0, 400.0, 100.0, 44.0)


@functools.cache
def link(name: str) -> r.ModalBody:
    """A bar from the origin along x, free of supports, by quadratic hexahedra."""
    length, width, height = LINKS[name]
    ends = (0.0, length), (-width / 2, width / 2), (-height / 2, height / 2)
    lines = [np.linspace(*x, count + 1) for x, count in zip(ends, ELEMENTS, strict=True)]
    mesh = skfem.MeshHex.init_tensor(*lines)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex2()), intorder=4)
    lame = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    part = meshed(basis, lame, YOUNG / (2 * (1 + POISSON)), DENSITY)
    ports = {"start": part.end(0.0), "end": part.end(length)}
    return r.ModalBody.of_mesh(
        name, *part[:3], ports, modes=VIBRATION, dofs=part.rows, damping=DAMPING
    )


def meshed_arm(load: float = 0.4, duration: float = 0.4, reach: float = 1.0) -> rj.Scene:
    """The arm starts at rest along x and moves a load [kg] to other angles, `reach` times those of
    the training, in so many seconds.
    """
    column = r.RigidBody("column", 3.0, (0.02,) * 3, (0, 0, 0.15), extent=(0.1, 0.1, 0.3))
    ends = [(rj.ground.at((0.0, 0.0, 0.0)), column.at((0.0, 0.0, -0.15)))]
    bodies: list[rj.AbstractBody] = [column]
    before, reached = column.at((0.0, 0.0, 0.15), axis=SIDE), column.pose((0.0, 0.0, 0.15))
    for name in LINKS:
        body = link(name).placed("start", reached)
        ends.append((before, body.at("start", axis=SIDE)))
        bodies.append(body)
        before, reached = body.at("end", axis=SIDE), body.pose("end")
    grip = r.RigidBody("load", load, (1e-3,) * 3, extent=(0.08,) * 3)
    grip = grip.placed((0.0, 0.0, 0.0), reached)
    joints: list[rj.AbstractJoint] = [r.Revolute(foot, base) for base, foot in ends]
    joints.append(r.Weld(grip.at((0.0, 0.0, 0.0), axis=SIDE), before))
    drives = [
        rj.Motor(foot, base, rj.Step(reach * angle, 0.0, duration), gain, 0.1 * gain)
        for (base, foot), angle, gain in zip(ends, ANGLES, GAINS, strict=True)
    ]
    return rj.Scene([*bodies, grip], joints, [rj.Gravity((0.0, 0.0, -9.81)), *drives])


def moves(count: int) -> Iterator[dict[str, float]]:
    """Other loads, durations and reaches, by a seed."""
    lot = np.random.default_rng(1)
    for _ in range(count):
        load, duration, reach = lot.uniform((0.2, 0.3, -1.2), (0.6, 0.5, 1.2))
        yield {"load": load, "duration": duration, "reach": reach}
