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


def beam_in_space(elements, length, mass, EA, EI, GJ, polar):
    """The same with bending about y and z, EI of two numbers, and torsion, `polar` its moment of
    inertia: K, M and nodes.

    Rows of three displacements and three rotations, node after node.
    """
    rows = np.arange(6 * elements + 6).reshape(-1, 6)
    stiffness, inertia = (np.zeros((rows.size, rows.size)) for _ in range(2))
    # A rotation about y moves what is ahead along −z.
    for own, signs, parts in (
        ((0, 1, 5), (1, 1, 1), beam(elements, length, mass, EA, EI[1])),
        ((2, 4), (1, -1), beam(elements, length, mass, EA, EI[0])),
        ((3,), (1,), beam(elements, length, polar, GJ, 1.0)),
    ):
        index = rows[:, list(own)].ravel()
        sign = np.tile(np.array(signs, float), elements + 1)
        # Bending without what is along the beam, torsion as that alone.
        chosen = [[0, 1, 2], [1, 2], [0]][3 - len(own)]
        kept = np.arange(rows.size // 2).reshape(-1, 3)[:, chosen].ravel()
        for total, part in zip((stiffness, inertia), parts[:2], strict=True):
            total[np.ix_(index, index)] = part.toarray()[np.ix_(kept, kept)] * np.outer(sign, sign)
    nodes = np.zeros((elements + 1, 3))
    nodes[:, 0] = parts[2][:, 0]
    return sp.csc_array(stiffness), sp.csc_array(inertia), nodes


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
