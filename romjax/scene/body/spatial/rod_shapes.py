"""Strain shapes of the natural modes of a rod in space, for the supports of its ends."""

from typing import Any, NamedTuple

import numpy as np

from ....common.arrays import untraced
from ....linalg import quaternions
from ..strain_modes import STATIC, Vibrations, anchor_of
from ..strains import gauss, weights_to
from .rod_kinematics import Line, columns, gradient, material, pose, sections, turning
from .rod_strains import TURNS, SpatialStrains

# What supports hold of the position, and of the turn about the axes of the section.
SUPPORTS = {"free": (0, 0), "pinned": (3, 0), "hinged": (3, 2), "clamped": (3, 3)}
SHAPES = (STATIC, *(f"{a}-{b}" for a in SUPPORTS for b in SUPPORTS))
# Gauss points beyond the number of amplitudes in a kind of strain, and the fewest: more than in the
# plane, since the steps of rotations between them have errors of their own.
_MORE, _FEWEST = 6, 16


class Ratios(NamedTuple):
    """The numbers that a rod's modes depend on: the `law` (kinds, kinds) of its sections by EI_z,
    with lengths as its unit, `rotary` ρI/(ρA L²) (3,), and the coefficients (3, k) of its initial
    `curvature` times length, or None.
    """

    law: Any
    rotary: Any
    curvature: Any


def natural_strains(
    shapes: str, modes: int, loaded: bool, points: int | None, ratios: Ratios, xp: Any
) -> SpatialStrains:
    """Return the first strain shapes of a rod, (modes) of them, for one of `SHAPES`.

    They are made as those in the plane: static shapes are the modes of the free rod among few
    polynomials; `loaded` has two of curvature about each axis, and one of each other strain.
    """
    kinds = ratios.law.shape[0]
    static, anchor = shapes == STATIC, anchor_of(shapes)
    count = -(-modes // kinds) if static else modes + 8
    problem = _vibrations(shapes, count, anchor, ratios, xp)
    if loaded and not static:
        own = count * np.arange(kinds)
        given = [*own[:TURNS], *(own[1:TURNS] + 1), *own[TURNS:]]
        vectors, squares = problem.with_static(given, modes)
    else:
        vectors, squares = problem.modes(np.eye(kinds * count), modes)
    if points is None:
        points = max(_FEWEST, _MORE + (count if static else modes))
    return SpatialStrains.of(vectors.reshape(kinds, count, modes), squares, points, anchor)


def _vibrations(shapes: str, count: int, anchor: float, ratios: Ratios, xp: Any) -> Vibrations:
    """The vibrations of the rod whose strains are all polynomials."""
    kinds = ratios.law.shape[0]
    size, points = kinds * count, 2 * count + 8
    every = np.eye(size).reshape(kinds, count, size)
    strains = SpatialStrains.of(every, np.zeros(0), points, anchor)
    line, none = Line(strains, np.float64(1.0), ratios.curvature), np.zeros(size)
    at = sections(line, none)
    turned = turning(at)
    to = weights_to(points, anchor, gauss(points)[0])
    moved = (to @ columns(line, at, turned).reshape(points, -1)).reshape(turned.shape)
    position = line.origin() + to @ at.slope
    both = _moving(position, moved, xp), _turning(at.axes[1:], turned, xp)
    factors = np.ones(3), ratios.rotary
    mass = 0.0
    for own, factor in zip(both, factors, strict=True):
        weighted = strains.weights()[:, None, None] * xp.asarray(factor)[None, :, None] * own
        mass = mass + weighted.reshape(-1, size + 6).T @ own.reshape(-1, size + 6)
    # ∫P_k² dξ of Legendre polynomials.
    grams = np.diag(1 / (2 * np.arange(count) + 1.0))
    stiffness = xp.kron(ratios.law, grams)
    held = _held(line, shapes, xp)
    return Vibrations(mass, xp.pad(stiffness, ((6, 0), (6, 0))), held, 6, xp)


def _moving(position: Any, own: Any, xp: Any) -> Any:
    """Rows (points, 3, 6 + strains) of how points at a `position` move."""
    one = np.broadcast_to(np.eye(3), (len(own), 3, 3))
    return xp.concatenate([one, -quaternions.skew(position), own], 2)


def _turning(axes: Any, own: Any, xp: Any) -> Any:
    """Rows (points, 3, 6 + strains) of how sections turn about their `axes`."""
    one = np.broadcast_to(np.eye(3), (len(own), 3, 3))
    return xp.swapaxes(axes, 1, 2) @ xp.concatenate([0 * one, one, own], 2)


def _held(line: Line, shapes: str, xp: Any) -> Any:
    """Return the conditions of the supports, as rows on the rigid motion and on all strains."""
    ends = ("free", "free") if shapes == STATIC else shapes.split("-")
    size = line.strains.steps.shape[2]
    none, rows = np.zeros(size), list[Any]()
    for support, along in zip(ends, (-0.5, 0.5), strict=True):
        positions, turns = SUPPORTS[support]
        if not positions:
            continue
        point = material(line, np.array([along, 0.0, 0.0]))
        position, turn = untraced(*pose(line, point, none))
        own = gradient(line, point, none)
        moved = _moving(position[None], own[None, :3], xp)[0]
        turned = _turning(quaternions.matrix(turn)[None], own[None, 3:], xp)[0]
        # The first support holds its end along the rod too: one end alone is to move along.
        rows += [*moved[1 if rows else 0 :], *turned[:turns]]
    return xp.stack(rows) if rows else np.zeros((0, 6 + size))
