"""Strains along a rod in space as combinations of shapes, by their values at a few points."""

import dataclasses
import functools
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ....common.arrays import as_jax, namespace
from ....linalg import magnus
from ..strains import gauss, legendre, turning, weights_to

# How many kinds of strain turn a rod: twist and two curvatures.
TURNS = 3


class SpatialStrains(eqx.Module):
    """Strain shapes of a rod in space per unit amplitude, as `Strains` are those in the plane.

    Kinds, in this order: twist and curvature about y and z, times length; then stretch and shear
    along y and z, of which only those that the rod has.

    - `basis` (kinds, polynomials, modes): by Legendre polynomials of ξ = s/L.
    - `steps` (points, 12, modes): moments of curvature, those of `magnus`, from each Gauss point to
      the next one that is farther from the `anchor`. `strain` (points, 3, modes): stretch and shear
      at the Gauss points, None without.
    - `squares` (natural,): ω² in units of EI_z/(m L³) of the natural modes that the shapes were
      made of, and `mixing` (natural, modes) what amplitudes are in theirs, None if they are theirs.
    """

    basis: Float[Array, "kinds polynomials modes"]
    steps: Float[Array, "points 12 modes"]
    strain: Float[Array, "points 3 modes"] | None
    squares: Float[Array, " natural"]
    mixing: Float[Array, "natural modes"] | None
    points: int = eqx.field(static=True)
    anchor: float = eqx.field(static=True)

    @classmethod
    def of(cls, basis: Any, squares: Any, points: int, anchor: float) -> "SpatialStrains":
        """Tabulate the shapes `basis` at so many Gauss `points`; the arguments are the fields."""
        steps, strain = tables(basis, points, anchor)
        return cls(
            basis=as_jax(basis),
            steps=as_jax(steps),
            strain=None if strain is None else as_jax(strain),
            squares=as_jax(squares),
            mixing=None,
            points=points,
            anchor=anchor,
        )

    def in_span(self, combinations: Float[Array, "modes k"]) -> "SpatialStrains":
        """The shapes that are `combinations` of these, folded into tables of fewer columns."""
        folded = ("basis", "steps", "strain", "mixing")
        changed = {
            name: x @ combinations for name in folded if (x := getattr(self, name)) is not None
        }
        changed.setdefault("mixing", combinations)
        return dataclasses.replace(self, **changed)

    def positions(self) -> np.ndarray:
        """Weights (points, points) of ∫ dξ from the anchor to each Gauss point."""
        weights: np.ndarray = weights_to(self.points, self.anchor, gauss(self.points)[0])
        return weights

    def weights(self) -> np.ndarray:
        """Weights (points,) of ∫ dξ over the rod."""
        return gauss(self.points)[1]

    def path(self) -> "Path":
        """How rotations go from the anchor to the Gauss points."""
        return path(self.points, self.anchor)


def tables(basis: Any, points: int, anchor: float) -> tuple[Any, Any]:
    """The `steps` and the `strain` of shapes (kinds, polynomials, modes)."""
    xp, (kinds, count, modes) = namespace(basis), basis.shape
    xi, starts = gauss(points)[0], path(points, anchor).starts
    along = moments(count, starts, xi - starts).reshape(4 * points, count)
    turned = along @ xp.swapaxes(basis[:3], 0, 1).reshape(count, 3 * modes)
    if kinds == TURNS:
        return turned.reshape(points, 12, modes), None
    own = xp.swapaxes(legendre(count, xi) @ basis[3:], 0, 1)
    none = np.zeros((points, 1, modes))
    missing = {4: [own, none, none], 5: [none, own], 6: [own]}[kinds]
    return turned.reshape(points, 12, modes), xp.concatenate(missing, 1)


def moments(count: int, start: Any, size: Any, xp: Any = np) -> Any:
    """The moments (..., 4, count) of Legendre polynomials in steps of a `size` from a `start`."""
    positions = [start + share * size for share in magnus.POINTS]
    values = xp.stack([legendre(count, position, xp) for position in positions], -2)
    own = size[..., None, None] * (magnus.MOMENTS @ values)
    whole = turning(count, start + size, 0.0, xp) - turning(count, start, 0.0, xp)
    return xp.concatenate([whole[..., None, :], own], -2)


class Path(NamedTuple):
    """How rotations go from the anchor outwards: a step to each Gauss point from the one before.

    - `starts` (points,): where steps begin. `before` (points, points + 1): one for what is there,
      the anchor or a Gauss point. `sums` (points, points): one for each step on the way to a point.
    - `levels`, each (points + 1,): what the product of a section goes on from, the anchor first;
      each time products are twice as long.
    """

    starts: np.ndarray
    before: np.ndarray
    sums: np.ndarray
    levels: tuple[np.ndarray, ...]


@functools.cache
def path(points: int, anchor: float) -> Path:
    """The path to the Gauss points of a rod."""
    xi = gauss(points)[0]
    positions, after, own = np.append(anchor, xi), xi >= anchor, np.arange(1, points + 1)
    before = np.where(after, own - 1, own + 1)
    outside = (before == 0) | (before > points)
    outside |= after != after[np.clip(before, 1, points) - 1]
    before = np.where(outside, 0, before)
    levels, reach = [], np.append(0, before)
    sums = np.eye(points + 1, points, -1)
    while np.any(reach > 0):
        levels.append(reach.astype(np.uint32))
        sums = sums + sums[reach]
        reach = reach[reach]
    return Path(positions[before], np.eye(points + 1)[before], sums[1:], tuple(levels))
