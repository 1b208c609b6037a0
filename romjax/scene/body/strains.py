"""Strains along a rod as combinations of shapes, and integrals along it by a few Gauss points."""

import dataclasses
import functools
import itertools
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ...common.arrays import as_jax


class Strains(eqx.Module):
    """Strain shapes of a rod: curvature times length, stretch and shear per unit amplitude.

    Each is a combination of Legendre polynomials of ξ = s/L, which only markers still see: a step
    knows the shapes by their values at the Gauss points, so that its cost is that of the amplitudes
    and not that of the polynomials.

    - `basis` (polynomials, modes): of curvature, then of stretch, then of shear; `counts` says how
      many of each.
    - `turn`, `stretch`, `shear` (points, modes): at the Gauss points, the turning θ against the
      `anchor`, a share of the length, where the frame sits, and both strains, None without.
    - `bending`, `pulling`, `shearing` (modes, modes): ∫ of products of two shapes over ξ.
    - `squares` (natural,): ω² in units of EI/(m L³) of the natural modes that the shapes were made
      of, and `mixing` (natural, modes) what amplitudes are in theirs, None if they are theirs.
    """

    basis: Float[Array, "polynomials modes"]
    turn: Float[Array, "points modes"]
    stretch: Float[Array, "points modes"] | None
    shear: Float[Array, "points modes"] | None
    bending: Float[Array, "modes modes"]
    pulling: Float[Array, "modes modes"] | None
    shearing: Float[Array, "modes modes"] | None
    squares: Float[Array, " natural"]
    mixing: Float[Array, "natural modes"] | None
    counts: tuple[int, int, int] = eqx.field(static=True)
    points: int = eqx.field(static=True)
    anchor: float = eqx.field(static=True)

    @classmethod
    def of(
        cls, basis: Any, squares: Any, counts: tuple[int, int, int], points: int, anchor: float
    ) -> "Strains":
        """Tabulate the shapes `basis` at so many Gauss `points`; the arguments are the fields."""
        xi, _ = gauss(points)
        own = [basis[i:j] for i, j in itertools.pairwise(np.cumsum([0, *counts]))]
        tables = [turning(counts[0], xi, anchor), *(legendre(n, xi) for n in counts[1:])]
        turn, stretch, shear = (
            as_jax(table @ part) if len(part) else None
            for table, part in zip(tables, own, strict=True)
        )
        # Legendre polynomials are orthogonal, ∫ P_k² dξ = 1 / (2k + 1).
        bending, pulling, shearing = (
            as_jax(part.T @ (part / (2 * np.arange(len(part)) + 1)[:, None])) if len(part) else None
            for part in own
        )
        assert turn is not None
        assert bending is not None
        return cls(
            basis=as_jax(basis),
            turn=turn,
            stretch=stretch,
            shear=shear,
            bending=bending,
            pulling=pulling,
            shearing=shearing,
            squares=as_jax(squares),
            mixing=None,
            counts=counts,
            points=points,
            anchor=anchor,
        )

    def in_span(self, combinations: Float[Array, "modes k"]) -> "Strains":
        """The shapes that are `combinations` of these, folded into tables of fewer columns."""
        folded = ("basis", "turn", "stretch", "shear", "mixing")
        both = ("bending", "pulling", "shearing")
        changed = {
            name: x @ combinations for name in folded if (x := getattr(self, name)) is not None
        }
        changed |= {
            name: combinations.T @ x @ combinations
            for name in both
            if (x := getattr(self, name)) is not None
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


@functools.cache
def gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points and weights on 0 to 1."""
    x, w = np.polynomial.legendre.leggauss(points)
    return 0.5 * (x + 1), 0.5 * w


def legendre(count: int, xi: Any, xp: Any = np) -> Any:
    """The first Legendre polynomials on 0 to 1, (..., count)."""
    x = 2 * xi - 1
    polynomials = [1 + 0 * x, x]
    # Bonnet's recurrence.
    for k in range(1, count - 1):
        polynomials.append(((2 * k + 1) * x * polynomials[k] - k * polynomials[k - 1]) / (k + 1))
    return xp.stack(polynomials, -1)[..., :count]


def turning(count: int, xi: Any, anchor: float, xp: Any = np) -> Any:
    """The integrals of the first Legendre polynomials from the anchor to ξ, (..., count)."""

    def from_start(xi: Any, xp: Any) -> Any:
        p = legendre(count + 1, xi, xp)
        # (2k + 1) P_k = d(P_k+1 − P_k−1)/dx, both of which agree at the start; dx = 2 dξ.
        higher = [(p[..., k + 1] - p[..., k - 1]) / (2 * (2 * k + 1)) for k in range(1, count)]
        return xp.stack([xi, *higher], -1)

    return from_start(xi, xp) - from_start(np.float64(anchor), np)


def weights_to(points: int, anchor: float, xi: Any, xp: Any = np) -> Any:
    """Weights (..., points) on values at the Gauss points of their integral from anchor to ξ.

    Exact for polynomials of a degree below the number of points: the spectral integration matrix.
    """
    x, w = gauss(points)
    # Coefficients by the quadrature itself, which is exact for products of these degrees.
    modal = (2 * np.arange(points) + 1)[:, None] * legendre(points, x).T * w
    return turning(points, xi, anchor, xp) @ modal
