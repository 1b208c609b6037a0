"""Strain shapes of the natural modes of a rod, for the supports of its ends."""

from typing import Any, NamedTuple

import numpy as np

from .strain_modes import STATIC, Vibrations, anchor_of
from .strains import Strains, gauss, legendre, turning, weights_to

# Shapes by the supports of the start and of the end, and those that suit any support.
SUPPORTS = ("free", "pinned", "clamped")
SHAPES = (STATIC, *(f"{a}-{b}" for a in SUPPORTS for b in SUPPORTS))
# Gauss points beyond the number of amplitudes: of polynomials, and of natural modes, which are
# polynomials of a higher degree; and the fewest, for a rod that turns by a full circle.
_MORE, _MORE_NATURAL, _FEWEST = 2, 6, 12


class Ratios(NamedTuple):
    """The numbers that a rod's modes depend on: `stretch` EA L²/EI and `shear` GA L²/EI, None where
    infinite, `rotary` ρI/(ρA L²), and the coefficients (k,) of its initial `curvature` times
    length, or None.
    """

    stretch: Any
    shear: Any
    rotary: Any
    curvature: Any


def natural_strains(
    shapes: str, modes: int, loaded: bool, points: int | None, ratios: Ratios, xp: Any
) -> Strains:
    """Return the first strain shapes of a rod, (modes) of them, for one of `SHAPES`.

    The modes of the rod as it is undeformed are those of a fine space of Legendre polynomials.
    Static shapes are the modes of the free rod among polynomials that are no more than they are; so
    any end force is exact. `loaded`: two of curvature, and one of each other strain, are such
    polynomials, and the shapes are the free modes in the span of both kinds. `xp`: NumPy, or
    `jax.numpy` where numbers are traced.
    """
    kinds = 1 + (ratios.stretch is not None) + (ratios.shear is not None)
    static, anchor = shapes == STATIC, anchor_of(shapes)
    count = -(-modes // kinds) if static else modes + (8 if kinds > 1 else 4 + modes)
    count = max(count, 1)
    counts = (count, count * (ratios.stretch is not None), count * (ratios.shear is not None))
    ends = ("free", "free") if static else shapes.split("-")
    problem = _vibrations(counts, anchor, ends, ratios, xp)
    size = sum(counts)
    if loaded and not static:
        starts = np.cumsum([0, *counts])[:3]
        given = [0, 1, *(int(i) for i, n in zip(starts[1:], counts[1:], strict=True) if n)]
        vectors, squares = problem.with_static(given, modes)
    else:
        vectors, squares = problem.modes(np.eye(size), modes)
    if points is None:
        points = max(_FEWEST, count + _MORE if static else modes + _MORE_NATURAL)
    return Strains.of(vectors, squares, counts, points, anchor)


def _vibrations(
    counts: tuple[int, int, int], anchor: float, ends: Any, ratios: Ratios, xp: Any
) -> Vibrations:
    """The vibrations of the rod whose strains are all polynomials."""
    points = 2 * counts[0] + 8
    xi, w = gauss(points)
    at = np.concatenate([xi, [0.0, 1.0]])
    theta = np.zeros(points)
    if ratios.curvature is not None:
        theta = turning(len(ratios.curvature), xi, anchor) @ ratios.curvature
    c, s = xp.cos(theta)[:, None], xp.sin(theta)[:, None]
    turn = turning(counts[0], at, anchor)
    strain = legendre(counts[1] or counts[2] or 1, xi)
    x, y = [-s * turn[:points]], [c * turn[:points]]
    for count, (along, across) in zip(counts[1:], ((c, s), (-s, c)), strict=True):
        if count:
            x, y = [*x, along * strain], [*y, across * strain]
    to = weights_to(points, anchor, at)
    position = to @ xp.concatenate([c, s], 1)
    one, none = np.ones((points + 2, 1)), np.zeros((points + 2, 1))
    turned = np.concatenate([turn, np.zeros((points + 2, sum(counts[1:])))], 1)
    jacobian = [
        xp.concatenate([one, none, -position[:, 1:], to @ xp.concatenate(x, 1)], 1),
        xp.concatenate([none, one, position[:, :1], to @ xp.concatenate(y, 1)], 1),
        np.concatenate([none, none, one, turned], 1),
    ]
    mass = sum(
        factor * (own[:points].T * w[None]) @ own[:points]
        for own, factor in zip(jacobian, (1.0, 1.0, ratios.rotary), strict=True)
    )
    # Legendre polynomials are orthogonal, ∫P_k² dξ = 1 / (2k + 1); rigid motion has no stiffness.
    stiffness = [
        np.zeros(3),
        *(
            factor / (2 * np.arange(count) + 1.0)
            for factor, count in zip((1.0, ratios.stretch, ratios.shear), counts, strict=True)
            if count
        ),
    ]
    # The first support holds its end along the rod too: one end alone is to move along.
    rows = list[Any]()
    for end, support in enumerate(ends):
        count = {"free": 0, "pinned": 2, "clamped": 3}[support]
        rows += [jacobian[i][points + end] for i in range(count) if not (rows and i == 0)]
    held = xp.stack(rows) if rows else np.zeros((0, 3 + sum(counts)))
    return Vibrations(mass, xp.diag(xp.concatenate(stiffness)), held, 3, xp)
