"""Writes the mesh of the gallery's connecting rod: `python notebooks/connecting_rod.py`.

The mesh is a grid of equal squares, those in the outline of the rod: one element matrix, and no
mesh generator. A steel rod of 20 mm, by bilinear elements in plane stress.
"""

from pathlib import Path

import numpy as np
import scipy.sparse as sp

FOLDER = Path(__file__).parents[1] / "romjax" / "gallery" / "files"
LENGTH, THICKNESS, CELL = 0.15, 0.02, 0.003  # between the eyes, and of the elements [m]
MODULUS, POISSON, DENSITY = 2.1e11, 0.3, 7850.0  # [Pa], [kg/m³]
# Outer and inner radius of the eyes, and half the width of the shank between them [m].
BIG, SMALL, SHANK = (0.034, 0.022), (0.02, 0.011), 0.011


def grid(length: float, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (nodes, 2) [m] of a rod from the origin along x, and those of each cell (cells, 4)."""
    reach = round((length + 2 * BIG[0]) / cell)
    steps = np.arange(-reach, reach)
    corner = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
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


if __name__ == "__main__":
    nodes, cells = grid(LENGTH, CELL)
    for name, element in zip(
        ("stiffness", "mass"), square(CELL, THICKNESS, MODULUS, POISSON, DENSITY), strict=True
    ):
        matrix = assembled(element, cells, len(nodes))
        sp.save_npz(FOLDER / f"connecting-rod-{name}.npz", (matrix + matrix.T) / 2)
    big, small = rim(nodes, 0.0, BIG[1] + CELL), rim(nodes, LENGTH, SMALL[1] + CELL)
    np.savez_compressed(FOLDER / "connecting-rod.npz", nodes=nodes, crank=big, piston=small)
