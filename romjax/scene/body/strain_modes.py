"""Strain shapes of the natural modes of a rod, in the plane and in space."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

# Shapes that suit any supports.
STATIC = "static"


def anchor_of(shapes: str) -> float:
    """The place of the frame, a share of the length: the supported end, or the middle."""
    if shapes == STATIC:
        return 0.5
    start, end = shapes.split("-")
    if start != "free":
        return 0.0
    return 0.5 if end == "free" else 1.0


class Vibrations(NamedTuple):
    """Small vibrations about an undeformed rod in units of its length, mass and EI.

    - `mass`, `stiffness`: of the frame, so many `rigid` coordinates, then of all strains.
    - `held`: rows of what the supports hold. `xp`: NumPy, or `jax.numpy` where numbers are traced.
    """

    mass: Any
    stiffness: Any
    held: Any
    rigid: int
    xp: Any

    def with_static(self, given: Sequence[int], count: int) -> tuple[Any, Any]:
        """The first `count` modes, as of `modes`, of the free rod in the span of the strains of the
        numbers `given` and of as many modes as there is room for beside them.
        """
        own = np.eye(len(self.mass) - self.rigid)
        static = own[:, list(given)[:count]]
        few = self.modes(own, count - static.shape[1])[0]
        # Supports would take out of this span what loads at the ends need.
        free = self._replace(held=self.held[:0])
        return free.modes(self.xp.concatenate([static, few], 1), count)

    def modes(self, span: Any, count: int) -> tuple[Any, Any]:
        """The strains of the first `count` modes within a `span` of strains, of unit modal mass,
        and the squares of their frequencies.
        """
        xp, rigid = self.xp, self.rigid
        if not count:
            return np.zeros((len(span), 0)), np.zeros(0)
        own, _ = xp.linalg.qr(span)
        wide = xp.concatenate(
            [
                np.eye(rigid, rigid + own.shape[1]),
                xp.concatenate([np.zeros((len(own), rigid)), own], 1),
            ]
        )
        held = self.held @ wide
        # Columns beyond the first span what the supports leave free.
        full, _ = xp.linalg.qr(held.T, mode="complete")
        wide = wide @ full[:, len(held) :]
        mass, stiffness = (wide.T @ x @ wide for x in (self.mass, self.stiffness))
        # The inverse problem, shifted by the rigid motion, gives the slow modes accurately.
        half = xp.linalg.inv(xp.linalg.cholesky(stiffness + mass))
        inverse, vectors = xp.linalg.eigh(half @ mass @ half.T)
        # Motions that supports leave rigid have the largest eigenvalues, and are no shapes.
        free = max(rigid - len(held), 0)
        chosen = np.arange(len(mass))[::-1][free : free + count]
        inverse, vectors = inverse[chosen], vectors[:, chosen]
        # The modal mass is one, and the eigenvalues are 1 / (ω² + 1).
        strains = (wide @ half.T @ vectors)[rigid:] / xp.sqrt(inverse)[None]
        largest = xp.argmax(xp.abs(strains), 0)
        return strains * xp.sign(strains[largest, np.arange(count)])[None], 1 / inverse - 1
