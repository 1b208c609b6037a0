"""Finite-element models from scikit-fem, free of supports."""

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.helpers import dd, ddot, dot, eye, sym_grad, trace


@skfem.BilinearForm
def _product(u, v, w):
    return u * v


@skfem.BilinearForm
def _stretching(u, v, w):
    return u.grad[0] * v.grad[0]


@skfem.BilinearForm
def _bending(u, v, w):
    return dd(u)[0][0] * dd(v)[0][0]


@skfem.BilinearForm
def _inertia(u, v, w):
    return dot(u, v)


def beam(elements, length, mass, EA, EI):
    """A uniform beam along x, by Hermite elements and linear ones: K, M and nodes.

    Rows x, y and rotation, node after node.
    """
    mesh = skfem.MeshLine(np.linspace(-length / 2, length / 2, elements + 1))
    along = skfem.Basis(mesh, skfem.ElementLineP1(), intorder=4)
    across = skfem.Basis(mesh, skfem.ElementLineHermite(), intorder=8)
    pairs = [
        (EA * _stretching.assemble(along), EI * _bending.assemble(across)),
        tuple(mass / length * _product.assemble(basis) for basis in (along, across)),
    ]
    rows = np.vstack([along.nodal_dofs, across.nodal_dofs + along.N]).T
    order = rows.ravel()
    stiffness, inertia = (sp.block_diag(pair, "csc")[order][:, order] for pair in pairs)
    return stiffness, inertia, np.stack([mesh.p[0], np.zeros(elements + 1)], axis=1)


def plate(length, height, nx, ny, modulus=2e11, poisson=0.3, density=7800.0, thickness=0.01):
    """A rectangle in plane stress by quadratic quadrilaterals: K, M, nodes and their rows."""
    mesh = skfem.MeshQuad.init_tensor(
        np.linspace(-length / 2, length / 2, nx + 1), np.linspace(-height / 2, height / 2, ny + 1)
    )
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
    first = modulus * poisson / (1 - poisson**2)
    second = modulus / (2 * (1 + poisson))

    @skfem.BilinearForm
    def stretching(u, v, w):
        strain = sym_grad(u)
        stress = first * eye(trace(strain), 2) + 2 * second * strain
        return ddot(stress, sym_grad(v))

    rows = np.hstack([basis.nodal_dofs, basis.facet_dofs, basis.interior_dofs]).T
    nodes = basis.doflocs[:, rows[:, 0]].T
    stiffness = thickness * stretching.assemble(basis)
    return stiffness, density * thickness * _inertia.assemble(basis), nodes, rows


def brick(edges, counts, modulus=2e11, poisson=0.3, density=7800.0, quadratic=False):
    """A block about the origin by hexahedra: K, M, nodes and their rows."""
    lines = [np.linspace(-e / 2, e / 2, n + 1) for e, n in zip(edges, counts, strict=True)]
    mesh = skfem.MeshHex.init_tensor(*lines)
    element = skfem.ElementHex2() if quadratic else skfem.ElementHex1()
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=4 if quadratic else 2)
    first = modulus * poisson / ((1 + poisson) * (1 - 2 * poisson))
    second = modulus / (2 * (1 + poisson))

    @skfem.BilinearForm
    def stretching(u, v, w):
        strain = sym_grad(u)
        return ddot(first * eye(trace(strain), 3) + 2 * second * strain, sym_grad(v))

    groups = [basis.nodal_dofs, basis.edge_dofs, basis.facet_dofs, basis.interior_dofs]
    rows = np.hstack([group for group in groups if group.size]).T
    nodes = basis.doflocs[:, rows[:, 0]].T
    return stretching.assemble(basis), density * _inertia.assemble(basis), nodes, rows
