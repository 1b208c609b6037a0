"""Modes of a body at all nodes of the mesh that it was made of."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ...common.arrays import Vector
from ...common.errors import SceneError
from ..fields import check_kind
from .component_modes import Matrix
from .finite_elements import reduce_mesh
from .mesh_ports import PortNodes
from .modal import AbstractModalBody

# Shapes and stiffness of the body and of the mesh agree to rounding, and so do frequencies that are
# equal; those of another mesh, or of other modes, do not.
_ALIKE = 1e-6


def mesh_modes(
    body: AbstractModalBody,
    stiffness: Matrix,
    mass: Matrix,
    nodes: Vector,
    ports: Mapping[str, PortNodes],
    *,
    modes: int,
    interface: str = "fixed",
    dofs: Vector | None = None,
) -> Float[np.ndarray, "rows modes"]:
    """The modes Φ of a `body` by the rows of its mesh: with its amplitudes q, u = Φ q are the
    displacements [m] and rotations [rad] of all nodes along the axes of the body.

    A body keeps its modes at ports and along its outline only. From u follow nodal forces K u, and
    stresses as the finite-element program has them of displacements.

    **Arguments:**

    - `body`: what `ModalBody.of_mesh` has made of the mesh, in the plane or in space.
    - `stiffness`, `mass`, `nodes`, `ports`, `modes`, `interface`, `dofs`: as they were given there;
      the mesh is reduced once more.

    Raises SceneError for another kind of body, and for a mesh or modes that are not the body's.
    """
    remedy = "a body that romjax.ModalBody.of_mesh has made"
    check_kind("mesh_modes", "the body", body, AbstractModalBody, remedy)
    owner = f"body '{body.name}'"
    mesh = reduce_mesh(owner, body.dimension, stiffness, mass, nodes, ports, modes, interface, dofs)
    wanted, found = (
        np.asarray(x, float).reshape(-1, x.shape[-1]) for x in (body.shapes, mesh.shapes)
    )
    turn, misfit = np.eye(found.shape[1]), 1.0
    if wanted.shape == found.shape:
        # Signs, and directions of equal frequencies, hang on the processor: turned as in the body.
        ends = np.flatnonzero(np.diff(mesh.frequencies) > _ALIKE * mesh.frequencies[1:]) + 1
        for own in np.split(np.arange(len(turn)), ends):
            # The rotation nearest to what takes one set of shapes to the other (Procrustes).
            left, _, right = np.linalg.svd(found[:, own].T @ wanted[:, own])
            turn[np.ix_(own, own)] = left @ right
        # A mesh with K times a number has the same shapes.
        own = np.asarray(body.stiffness, float)
        own = np.diag(own) if own.ndim == 1 else own
        pairs = (found @ turn, wanted), (turn.T @ np.diag(mesh.frequencies**2) @ turn, own)
        misfit = max(float(np.linalg.norm(a - b) / np.linalg.norm(b)) for a, b in pairs)
    if not misfit <= _ALIKE:
        raise SceneError(
            f"mesh_modes: the modes of {owner} are not those of this mesh; give the matrices, "
            "nodes, ports, modes and interface that of_mesh was given."
        )
    return mesh.elastic @ turn
