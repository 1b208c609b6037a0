"""Stiffness and mass matrices of meshes of elastic parts, by scikit-fem."""

from typing import Any, NamedTuple

import numpy as np
import skfem
from skfem.helpers import ddot, dot, eye, sym_grad, trace


class Meshed(NamedTuple):
    """The matrices of a part, its nodes (nodes, d) [m], and the rows of each node (nodes, d)."""

    stiffness: Any
    mass: Any
    nodes: np.ndarray
    rows: np.ndarray

    def end(self, x: float) -> np.ndarray:
        """The nodes at a place along the part [m]."""
        at: np.ndarray = np.flatnonzero(abs(self.nodes[:, 0] - x) < 1e-9)
        return at


def meshed(basis: skfem.Basis, lame: float, shear: float, density: float) -> Meshed:
    """Of an isotropic part; of a flat one, the three numbers are times its thickness."""
    dimensions = basis.mesh.dim()

    @skfem.BilinearForm
    def stretching(u, v, _):
        strain = sym_grad(u)
        stress = lame * eye(trace(strain), dimensions) + 2 * shear * strain
        return ddot(stress, sym_grad(v))

    @skfem.BilinearForm
    def inertia(u, v, _):
        return density * dot(u, v)

    groups = basis.nodal_dofs, basis.edge_dofs, basis.facet_dofs, basis.interior_dofs
    rows = np.hstack([rows for rows in groups if rows is not None and rows.size]).T
    nodes = basis.doflocs[:, rows[:, 0]].T
    return Meshed(stretching.assemble(basis), inertia.assemble(basis), nodes, rows)
