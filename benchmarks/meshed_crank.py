"""A slider crank whose rod is a mesh of a thousand nodes, by thirty of its modes."""

import functools
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import skfem
from finite_elements import meshed

import romjax as rj

LENGTH, HEIGHT, THICKNESS, CRANK = 0.3, 0.02, 0.008, 0.1  # [m]
YOUNG, POISSON, DENSITY, DAMPING = 3e9, 0.38, 1300.0, 0.02  # of a polymer, SI; damping ratio
ELEMENTS = (71, 3)  # along and across; 1001 nodes
VIBRATION = 27  # modes beside the three static ones that two ports have


@functools.cache
def rod() -> rj.ModalBody:
    """The rod from the crank pin along x, by quadratic quadrilaterals in plane stress."""
    lengths = np.linspace(0, LENGTH, ELEMENTS[0] + 1)
    heights = np.linspace(-HEIGHT / 2, HEIGHT / 2, ELEMENTS[1] + 1)
    mesh = skfem.MeshQuad.init_tensor(lengths, heights)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
    stiff = THICKNESS * YOUNG
    part = meshed(
        basis,
        stiff * POISSON / (1 - POISSON**2),
        stiff / (2 * (1 + POISSON)),
        THICKNESS * DENSITY,
    )
    ports = {"crank": part.end(0.0), "slider": part.end(LENGTH)}
    return rj.ModalBody.of_mesh(
        "rod",
        *part[:3],
        ports,
        modes=VIBRATION,
        dofs=part.rows,
        damping=DAMPING,
        position=(CRANK, 0.0),
    )


def meshed_crank(speed: float = 80.0, load: float = 0.5) -> rj.Scene:
    """The crank turns at `speed` [rad/s] from the stretched position, the undeformed rod drives a
    slider of `load` [kg].
    """
    turning = jnp.array([0.0, CRANK * speed]), jnp.asarray(-CRANK * speed / LENGTH)
    body = eqx.tree_at(lambda b: (b.velocity, b.angular_velocity), rod(), turning)
    crank = rj.RigidBody("crank", 1.0, 0.01, angular_velocity=speed)
    slider = rj.RigidBody("slider", load, 1e-3, position=(CRANK + LENGTH, 0.0))
    joints = [
        rj.Revolute(crank.at(), rj.ground.at()),
        rj.PrescribedAngle(crank.at(), rj.ground.at(), rj.Ramp(speed)),
        rj.Revolute(body.at("crank"), crank.at((CRANK, 0.0))),
        rj.Revolute(body.at("slider"), slider.at()),
        rj.Prismatic(slider.at(), rj.ground.at()),
    ]
    return rj.Scene([crank, body, slider], joints)


def driven(count: int) -> Iterator[dict[str, float]]:
    """Other speeds and loads, by a seed."""
    lot = np.random.default_rng(2)
    for _ in range(count):
        speed, load = lot.uniform((60.0, 0.2), (100.0, 0.8))
        yield {"speed": speed, "load": load}
