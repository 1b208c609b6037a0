"""Modes of a component from its finite-element matrices: Craig–Bampton and free interface."""

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from ...common.arrays import Vector
from ...common.errors import SceneError

# Shapes of which less than this share is not in the span of others are in it but for rounding.
DEPENDENT = 1e-12
Matrix = Any  # a NumPy array or a SciPy sparse matrix


class ComponentModes(NamedTuple):
    """Mass-normalised modes of a component, by rising frequency."""

    frequencies: np.ndarray  # ω [rad/s], (r,); of rigid motions zero, or what rounding leaves
    modes: np.ndarray  # (n, r), modesᵀ M modes = 1


def craig_bampton(stiffness: Matrix, mass: Matrix, interface: Vector, modes: int) -> ComponentModes:
    """Modes in the span of constraint modes and fixed-interface modes (Craig and Bampton, "Coupling
    of substructures for dynamic analyses", AIAA Journal 6, 1968).

    **Arguments:**

    - `stiffness`, `mass`: K and M (n, n), symmetric, sparse or not; M positive definite.
    - `interface`: the rows of the interface, at which other parts load the component. What unit
      displacements of them do statically is represented exactly.
    - `modes`: how many modes of the component held at its interface are added.

    Returns all len(interface) + modes modes of the reduced component. Raises SceneError if the
    matrices do not fit, or if the component can move while its interface is held.
    """
    k, m = checked(stiffness, mass)
    n = k.shape[0]
    held = np.asarray(interface, dtype=int)
    if held.size and not 0 <= held.min() <= held.max() < n:
        raise SceneError(
            f"craig_bampton: interface={held.tolist()}, but K has the rows 0 to {n - 1}."
        )
    inner = np.setdiff1d(np.arange(n), held)
    if not 0 <= modes <= len(inner):
        raise SceneError(f"craig_bampton: modes={modes}, but {len(inner)} rows are not held.")
    basis = np.zeros((n, len(held) + modes))
    # Constraint modes: the static deflection for each unit displacement of the interface, all
    # others held.
    basis[held, : len(held)] = np.eye(len(held))
    if len(inner):
        solve = _factor(k[inner][:, inner], "craig_bampton: K without the rows of the interface")
        basis[inner, : len(held)] = -solve(k[inner][:, held].toarray())
        # Fixed-interface modes beside them, for the motion within.
        basis[inner, len(held) :] = _lowest(k[inner][:, inner], m[inner][:, inner], modes, solve)
    return ritz(k, m, basis)


def free_interface(stiffness: Matrix, mass: Matrix, modes: int) -> ComponentModes:
    """The lowest `modes` modes of the component as it is, rigid motions among them.

    `stiffness` and `mass` are K and M (n, n), as for `craig_bampton`.
    """
    k, m = checked(stiffness, mass)
    if not 0 < modes <= k.shape[0]:
        raise SceneError(f"free_interface: modes={modes}, but the matrices have {k.shape[0]} rows.")
    # Shifted, as K of a free component is singular; far below its elastic frequencies.
    shift = 1e-6 * k.diagonal().sum() / m.diagonal().sum()
    solve = _factor(k + shift * m, "free_interface: K + shift M")
    return ritz(k, m, _lowest(k, m, modes, solve, -shift))


def with_loads(
    component: ComponentModes,
    stiffness: Matrix,
    mass: Matrix,
    held: np.ndarray,
    rigid: np.ndarray,
    loads: np.ndarray,
) -> ComponentModes:
    """Modes in the span of those of a component and of what some loads do to it statically.

    **Arguments:**

    - `component`: mass-normalised modes. `stiffness`, `mass`: K and M (n, n) of it.
    - `held`: the rows that are held. If there are none, each load is in balance with the inertia
      forces of the rigid motion that it begins (inertia relief; Rubin, "Improved component-mode
      representation for structural dynamic analysis", AIAA Journal 13, 1975).
    - `rigid`: the rigid motions (n, 3 or 6). `loads`: (n, loads).
    """
    k, m = checked(stiffness, mass)
    if not len(held):
        moved = m @ rigid
        # The inertia of the rigid acceleration of a free component balances each load.
        loads = loads - moved @ np.linalg.solve(rigid.T @ moved, rigid.T @ loads)
        # Any rows that keep it from moving: loads in balance pull at none of them.
        held = scipy.linalg.qr(rigid.T, mode="r", pivoting=True)[1][: rigid.shape[1]]
    inner = np.setdiff1d(np.arange(k.shape[0]), held)
    bent = np.zeros_like(loads)
    bent[inner] = _factor(k[inner][:, inner], "K without the rows of rigid ports")(loads[inner])
    # What the modes, which are orthonormal, span already is left out, twice for rounding.
    size = np.sqrt(np.sum(bent * (m @ bent), axis=0))
    bent = bent / np.where(size > 0, size, 1)
    for _ in range(2):
        bent -= component.modes @ (component.modes.T @ (m @ bent))
    # Principal directions of the deflections: of several loads that bend alike, one is kept.
    squares, turns = np.linalg.eigh(bent.T @ (m @ bent))
    return ritz(k, m, np.hstack([component.modes, bent @ turns[:, squares > DEPENDENT]]))


def ritz(stiffness: Matrix, mass: Matrix, basis: np.ndarray) -> ComponentModes:
    """The natural modes in the span of the columns of `basis`."""
    # Columns have units of their own; of one length, none is lost to rounding.
    basis = basis / np.linalg.norm(basis, axis=0)
    reduced = [basis.T @ (matrix @ basis) for matrix in (stiffness, mass)]
    squares, turned = scipy.linalg.eigh(*[(x + x.T) / 2 for x in reduced])
    modes = basis @ turned
    # A sign of its own for each mode, so that the same matrices give the same coordinates.
    largest = np.take_along_axis(modes, np.argmax(np.abs(modes), axis=0)[None], axis=0)
    return ComponentModes(np.sqrt(np.maximum(squares, 0)), modes * np.sign(largest))


def checked(stiffness: Matrix, mass: Matrix) -> tuple[Matrix, Matrix]:
    """Return both as sparse matrices, if they are square, of one size, finite and symmetric."""
    matrices = []
    for name, given in (("stiffness", stiffness), ("mass", mass)):
        matrix = sp.csc_array(given)
        rows, columns = matrix.shape
        if rows != columns or rows != (sp.csc_array(stiffness).shape[0]):
            raise SceneError(f"{name} has shape {matrix.shape}; K and M must be square and alike.")
        if not np.all(np.isfinite(matrix.data)):
            raise SceneError(f"{name} holds numbers that are not finite.")
        size = abs(matrix).max()
        skew = abs(matrix - matrix.T).max()
        if skew > 1e-8 * size:
            raise SceneError(f"{name} is not symmetric: entries differ by {skew:g} of {size:g}.")
        matrices.append(matrix)
    return matrices[0], matrices[1]


def _factor(matrix: Matrix, what: str) -> Any:
    try:
        # The matrix is symmetric and definite: this order of elimination fills in far less of
        # meshes in space than one of columns, and needs no pivots.
        return scipy.sparse.linalg.splu(
            sp.csc_matrix(matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        ).solve
    except RuntimeError as error:
        raise SceneError(f"{what} is singular: parts of the mesh are not connected.") from error


def _lowest(k: Matrix, m: Matrix, count: int, solve: Any, shift: float = 0.0) -> np.ndarray:
    """Lowest modes; ARPACK where it can, since it takes fewer modes than rows."""
    n = k.shape[0]
    if 2 * count + 1 >= n:
        modes: np.ndarray = scipy.linalg.eigh(k.toarray(), m.toarray())[1][:, :count]
        return modes
    if count == 0:
        return np.zeros((n, 0))
    inverse = scipy.sparse.linalg.LinearOperator((n, n), solve)
    start = np.ones(n)  # not a random one: the same matrices give the same modes
    modes = scipy.sparse.linalg.eigsh(k, count, m, sigma=shift, OPinv=inverse, v0=start)[1]
    return modes
