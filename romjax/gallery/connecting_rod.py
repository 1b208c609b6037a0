"""A crank drive whose connecting rod is a mesh."""

import numpy as np
import scipy.sparse as sp

from ..arrays import Number
from ..scene.body.beam import Beam
from ..scene.body.modal import ModalBody
from ..scene.body.rigid import RigidBody
from ..scene.joint.prescribed import PrescribedAngle
from ..scene.joint.prismatic import Prismatic
from ..scene.joint.revolute import Revolute
from ..scene.marker import ground
from ..scene.scene import Scene
from ..scene.signal import Ramp

# Outer and inner radius of the eyes, and half the width of the shank between them [m].
BIG, SMALL, SHANK = (0.034, 0.022), (0.02, 0.011), 0.011
PISTON = (0.05, 0.07)  # as it is drawn [m]


def connecting_rod(
    *,
    crank: float = 0.045,  # radius of the crank [m]
    length: float = 0.15,  # of the rod, between its eyes [m]
    speed: float = 200.0,  # [rad/s]
    piston: Number = 0.4,  # [kg]
    thickness: float = 0.02,  # of the rod [m]
    modulus: float = 2.1e11,  # [Pa]
    poisson: float = 0.3,
    density: float = 7850.0,  # [kg/m³]
    cell: float = 0.003,  # size of the elements [m]
) -> Scene:
    """A crank that turns steadily, a steel rod of finite elements in plane stress, and a piston.

    The mesh is a grid of equal squares, those in the outline of the rod: one element matrix, and no
    mesh generator. Craig–Bampton's static modes of both eyes and two modes between them stand for
    its some six hundred nodes. At the outer dead point the rod must stop the piston, whose
    acceleration is r Ω² (1 + r/l) where the rod is stiff.
    """
    nodes, cells = grid(length, cell)
    stiffness, mass = (
        assembled(element, cells, len(nodes))
        for element in square(cell, thickness, modulus, poisson, density)
    )
    shaft = Beam(
        "crank",
        0.3,
        crank,
        position=(crank / 2, 0.0),
        velocity=(0.0, speed * crank / 2),
        angular_velocity=speed,
    )
    rod = ModalBody.of_mesh(
        "rod",
        stiffness,
        mass,
        nodes,
        {"crank": rim(nodes, 0.0, BIG[1] + cell), "piston": rim(nodes, length, SMALL[1] + cell)},
        modes=2,
        damping=0.02,
        velocity=(0.0, speed * crank),
        angular_velocity=-speed * crank / length,
    ).placed("crank", shaft.pose("end"))
    head = RigidBody("piston", piston, 1e-4, position=rod.pose("piston").position, extent=PISTON)
    return Scene(
        bodies=[shaft, rod, head],
        joints=[
            Revolute(shaft.at("start"), ground.at(), name="crank bearing"),
            Revolute(rod.at("crank"), shaft.at("end"), name="big eye"),
            Revolute(rod.at("piston"), head.at(), name="small eye"),
            Prismatic(head.at(), ground.at(), name="cylinder"),
            PrescribedAngle(shaft.at("start"), ground.at(), Ramp(speed), name="drive"),
        ],
    )


def grid(length: float, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (nodes, 2) [m] of a rod from the origin along x, and the nodes of each cell (cells, 4)."""
    reach = round((length + 2 * BIG[0]) / cell)
    columns, rows = (
        np.arange(-reach, reach).ravel() for _ in range(2)
    )
    corner = np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1).reshape(-1, 2)
    middle = (corner + 0.5) * cell
    from_big, from_small = (np.hypot(middle[:, 0] - x, middle[:, 1]) for x in (0.0, length))
    solid = (from_big < BIG[0]) | (from_small < SMALL[0])
    solid |= (abs(middle[:, 1]) < SHANK) & (middle[:, 0] > 0) & (middle[:, 0] < length)
    solid &= (from_big > BIG[1]) & (from_small > SMALL[1])
    around = corner[solid][:, None] + np.array([(0, 0), (1, 0), (1, 1), (0, 1)])[None]
    points, cells = np.unique(around.reshape(-1, 2), axis=0, return_inverse=True)
    return points * cell, cells.reshape(-1, 4)


def rim(nodes: np.ndarray, x: float, radius: float) -> np.ndarray:
    """The nodes around the hole of an eye, those within a radius of its centre [m]."""
    near: np.ndarray = np.flatnonzero(np.hypot(nodes[:, 0] - x, nodes[:, 1]) < radius)
    return near


def square(
    size: float, thickness: float, modulus: float, poisson: float, density: float
) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass (8, 8) of a bilinear square in plane stress, by Gauss's four points."""
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    law = np.array([(1, poisson, 0), (poisson, 1, 0), (0, 0, (1 - poisson) / 2)])
    stiffness, mass = np.zeros((8, 8)), np.zeros((8, 8))
    for point in signs / np.sqrt(3):
        factors = 1 + signs * point[None]
        shape = np.kron(factors.prod(axis=1) / 4, np.eye(2))
        slope = signs * factors[:, ::-1] / (2 * size)
        strain = np.zeros((3, 8))
        strain[0, ::2], strain[1, 1::2] = slope.T
        strain[2, ::2], strain[2, 1::2] = slope[:, 1], slope[:, 0]
        stiffness += strain.T @ law @ strain
        mass += shape.T @ shape
    volume = thickness * size**2 / 4
    return modulus / (1 - poisson**2) * volume * stiffness, density * volume * mass


def assembled(element: np.ndarray, cells: np.ndarray, nodes: int) -> sp.csc_array:
    """The matrix of a mesh of equal elements; rows x and y, node after node."""
    rows = (2 * cells[:, :, None] + np.arange(2)).reshape(-1, 8)
    down, along = np.repeat(rows, 8, axis=1), np.tile(rows, 8)
    entries = np.tile(element.ravel(), len(cells))
    return sp.csc_array((entries, (down.ravel(), along.ravel())), shape=(2 * nodes, 2 * nodes))
