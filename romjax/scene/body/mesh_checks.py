"""Whether the nodes of a mesh fit its matrices: what a rigid motion of them strains, and weighs."""

import itertools
from typing import NamedTuple

import numpy as np

from ...common.errors import SceneError
from .component_modes import Matrix

# A rigid motion strains nodes that do not fit: refused above this share of the strain of its parts,
# shears and turns of the nodes in their places, which cancel. Places rounded to six digits leave a
# thousandth in a mesh with hundreds of nodes along an edge.
STRAIN = 1e-2
# Energies below this share of the sum of their terms' sizes are rounding.
ROUNDING = 1e-12
# What the masses along the axes may differ by: files have few digits.
MASS = 1e-4
# No solid carries sound faster than 36 km/s (Trachenko and others, "Speed of sound from fundamental
# physical constants", Science Advances 6, 2020), nor is one denser than osmium, 23e3 kg/m³.
# Elements make the first larger, by three at most, and the hull of their nodes the second.
SOUND, DENSITY = 1e5, 1e5
_AXES = "xyz"
_UNITS = "give nodes in metres, K in N/m and M in kg"


class _Fields(NamedTuple):
    """Displacements of all nodes whose sums are its rigid motions, as columns.

    Unit translations along each axis, then x_j along i for all axes i and j, then unit rotations of
    the nodes in their places. `stiffness` and `mass` are of K and M, `size` of K is what the terms
    of its diagonal are without their signs.
    """

    columns: np.ndarray  # (n, fields)
    stiffness: np.ndarray  # (fields, fields)
    mass: np.ndarray  # (fields, fields)
    size: np.ndarray  # (fields,)
    radius: float  # of the nodes about their mean place, in the mean square [m]
    dimension: int

    @property
    def gradients(self) -> slice:
        return slice(self.dimension, self.dimension * (self.dimension + 1))

    def turning(self, places: np.ndarray) -> np.ndarray:
        """Rigid rotations as sums of the fields, (fields, axes), with the nodes at `places` times
        x, (d, d).
        """
        d = self.dimension
        pairs = [(0, 1)] if d == 2 else [(1, 2), (2, 0), (0, 1)]
        made = np.zeros((len(self.size), len(pairs)))
        for axis, (i, j) in enumerate(pairs):
            skew = np.zeros((d, d))
            # A rotation about the axis is a shear of the places and a turn of the nodes in their
            # places.
            skew[i, j], skew[j, i] = -1, 1
            made[self.gradients, axis] = (skew @ places).ravel()
            made[self.gradients.stop + axis :, axis][:1] = 1
        return made

    def strains(self, motions: np.ndarray) -> np.ndarray:
        """Return the strain of each motion, as a share of what all parts of rotations strain."""
        energy = np.einsum("fa,fg,ga->a", motions, self.stiffness, motions)
        parts = np.sum(motions**2 * np.diag(self.stiffness)[:, None])
        rounding = ROUNDING * np.sum(motions**2 * self.size[:, None])
        shares: np.ndarray = np.maximum(energy - rounding, 0) / max(parts, np.finfo(float).tiny)
        return np.asarray(np.sqrt(shares))


def check_nodes(
    owner: str, stiffness: Matrix, mass: Matrix, positions: np.ndarray, rows: np.ndarray
) -> None:
    """Raise SceneError unless the rigid motions of the nodes leave K at rest, and have one mass in
    all directions, which some material can have; with what motion does not, how much, and the cure.

    `positions` (nodes, d) [m]; `rows` (nodes, k) of the matrices, as of `rows_of`.
    """
    fields = _fields(stiffness, mass, positions, rows)
    _check_translations(owner, stiffness, rows, fields)
    _check_rotations(owner, fields)
    _check_mass(owner, fields)
    _check_units(owner, stiffness.diagonal(), mass.diagonal(), positions, rows)
    whole = rows.size == stiffness.shape[0]
    if whole and positions.shape[1] == rows.shape[1] == 3:
        _check_density(owner, fields.mass[0, 0], positions)


def _fields(stiffness: Matrix, mass: Matrix, positions: np.ndarray, rows: np.ndarray) -> _Fields:
    nodes, d = positions.shape
    arms = positions - positions.mean(axis=0)[None]
    columns = np.zeros((stiffness.shape[0], d + d * d + rows.shape[1] - d))
    for i in range(d):
        columns[rows[:, i], i] = 1
        columns[rows[:, i], d + d * i : d + d * (i + 1)] = arms
    for i in range(d, rows.shape[1]):
        columns[rows[rows[:, i] >= 0, i], d * d + i] = 1
    return _Fields(
        columns,
        columns.T @ (stiffness @ columns),
        columns.T @ (mass @ columns),
        np.sum(abs(columns) * (abs(stiffness) @ abs(columns)), axis=0),
        float(np.sqrt(np.sum(arms**2) / nodes)),
        d,
    )


def _check_translations(owner: str, stiffness: Matrix, rows: np.ndarray, fields: _Fields) -> None:
    """Check that translations of the free body strain nothing, wherever the nodes are."""
    d, own = fields.dimension, np.diag(fields.stiffness)
    # Strains of unit gradients, over the square of the size of the body, are forces per length as
    # those of translations.
    elastic = np.sum(own[d:]) / max(fields.radius**2, np.finfo(float).tiny)
    excess = own[:d] - STRAIN**2 * elastic - ROUNDING * fields.size[:d]
    axis = int(np.argmax(excess))
    if excess[axis] <= 0:
        return
    forces = np.max(abs(stiffness @ fields.columns[:, axis])[rows[:, :d]], axis=1)
    node = int(np.argmax(forces))
    raise SceneError(
        f"{owner}: moving all of it along {_AXES[axis]} takes {own[axis]:.3g} N/m, most of it at "
        f"node {node}, but a free body has {'three' if d == 2 else 'six'} rigid motions, and they "
        "take nothing. Take the supports out of K, removed rows and springs to the ground; if it "
        "has none, dofs must say which rows belong to each node, and K needs all its digits: "
        "seven, of single precision, are too few for long slender bodies."
    )


def _check_rotations(owner: str, fields: _Fields) -> None:
    """Check that rotations of the free body strain nothing: else nodes and matrices do not fit."""
    d = fields.dimension
    strains = fields.strains(fields.turning(np.eye(d)))
    axis = int(np.argmax(strains))
    if strains[axis] <= STRAIN:
        return
    raise SceneError(
        f"{owner}: its nodes do not fit K. Turning them about {_AXES[axis] if d == 3 else 'z'} "
        f"strains it by {strains[axis]:.2g} of what its parts, shear and turning in place, do by "
        f"themselves; moving them strains nothing, so that it has no support. {_cure(fields)}"
    )


def _cure(fields: _Fields) -> str:
    """Say in what units or along which axes the nodes would fit, if in any."""
    d = fields.dimension
    turns = [
        np.array(signs)[:, None] * np.eye(d)[list(order)]
        for signs in itertools.product((1, -1), repeat=d)
        for order in itertools.permutations(range(d))
    ]
    # The least change is the likely one.
    for places in sorted(turns, key=lambda turn: np.sum(turn != np.eye(d))):
        motions, factor = fields.turning(places), 1.0
        if len(fields.size) > fields.gradients.stop:  # rotations in place have a scale of their own
            shear = np.where(np.arange(len(fields.size)) < fields.gradients.stop, 1, 0)[:, None]
            shears, turning = motions * shear, motions * (1 - shear)
            own = np.sum(shears * (fields.stiffness @ shears))
            factor = -np.sum(shears * (fields.stiffness @ turning)) / own if own > 0 else 1.0
            motions = factor * shears + turning
        if factor > 0 and np.max(fields.strains(motions)) <= STRAIN:
            break
    else:
        return (
            "Check the order of the nodes, dofs, and the axes and units of their places; a spring "
            "against turning, if it has one, must come out of K."
        )
    words = []
    if not np.isclose(factor, 1, rtol=STRAIN):
        words.append(f"all places times {factor:.6g}")
    if np.any(places != np.eye(d)):
        names = [f"{'-' if row.sum() < 0 else ''}{_AXES[np.argmax(abs(row))]}" for row in places]
        words.append(f"({', '.join(names)}) in place of ({', '.join(_AXES[:d])})")
    return (
        f"With {' and '.join(words)} they would fit: give the nodes in the units, the axes and the "
        "order of the matrices."
    )


def _check_mass(owner: str, fields: _Fields) -> None:
    """A rigid body has one mass, and one centre of it."""
    d = fields.dimension
    masses = fields.mass[:d, :d]
    mass = np.trace(masses) / d
    if not mass > 0 or np.max(abs(masses - mass * np.eye(d))) > MASS * mass:
        each = [f"{m:.6g} along {axis}" for m, axis in zip(np.diag(masses), _AXES[:d], strict=True)]
        across = np.max(abs(masses - np.diag(np.diag(masses))))
        raise SceneError(
            f"{owner}: its mass is {', '.join(each)} [kg], with {across:.3g} between axes, but it "
            "must be one number in all directions. Give the M that belongs to K, and dofs, the "
            "rows of each node; mass that moves along one axis only cannot be in it."
        )
    if d == 3:
        # Momenta of unit rotations are −m c̃, which is skew for one centre c.
        arm = fields.mass[:d] @ fields.turning(np.eye(d))
        if np.max(abs(arm + arm.T)) > MASS * mass * fields.radius:
            raise SceneError(
                f"{owner}: its centre of mass depends on the axis along which it is moved. Give "
                "the M that belongs to K, and dofs, the rows of each node."
            )


def _check_units(
    owner: str, stiffness: np.ndarray, mass: np.ndarray, positions: np.ndarray, rows: np.ndarray
) -> None:
    """Whether the fastest wave through an element, about √(K_ii / M_ii) times the distance of its
    nodes, is one that a solid can carry. Places in other units leave K at rest in a mesh without
    rotations, which has no length in its matrices.
    """
    import scipy.spatial  # here, since it takes long to load and few ask for it

    if len(positions) < 2:
        return
    near = scipy.spatial.cKDTree(positions).query(positions, k=2)[0][:, 1]
    displacements = rows[:, : positions.shape[1]]
    heavy = np.min(mass[displacements], axis=1) > 0
    if not np.any(heavy):
        return
    own = displacements[heavy]
    # The softest way of a node: connections that are to be rigid are stiff in some others.
    speed = np.median(near[heavy] * np.sqrt(np.min(abs(stiffness[own]) / mass[own], axis=1)))
    if speed > SOUND:
        raise SceneError(
            f"{owner}: sound would go through its elements at about {speed:.2g} m/s, but no solid "
            "carries it faster than 36000 m/s. Lengths or masses are in other units, such as "
            f"millimetres or tonnes; {_UNITS}. What shall be rigid is a RigidBody."
        )


def _check_density(owner: str, mass: float, positions: np.ndarray) -> None:
    """Check the density of a solid, its mass by the volume of the hull of its nodes."""
    import scipy.spatial  # here, since it takes long to load and few ask for it

    if len(positions) <= 3 or np.linalg.matrix_rank(positions - positions[:1], 1e-9) < 3:
        return
    volume = scipy.spatial.ConvexHull(positions).volume
    if mass > DENSITY * volume:
        raise SceneError(
            f"{owner}: its mass of {mass:.3g} kg is within {volume:.3g} m³ between its nodes, "
            f"{mass / volume:.2g} kg/m³, but no solid is denser than 23000. Lengths or masses are "
            f"in other units, such as kilometres or grams; {_UNITS}."
        )
