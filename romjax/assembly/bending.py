"""Markers on bodies that bring local poses of their own."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..common.arrays import as_jax, pick
from ..compiling.program import program_once
from ..scene.body.bending import AbstractBendingBody


class Bending(eqx.Module):
    """Markers on equal bodies that bend.

    - `bodies`: stacked, one for each marker; `prepared`: what the body needs to know of its point.
    - `rows`: of the markers among all.
    """

    bodies: AbstractBendingBody
    prepared: Any
    rows: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, bodies: AbstractBendingBody, points: Any, rows: np.ndarray) -> "Bending":
        """Prepare the `points` (count, d) of stacked bodies."""
        prepared = _prepared(bodies, as_jax(points))
        return cls(bodies, prepared, tuple(rows.tolist()))

    def poses(self, amplitudes: Float[Array, "all most"]) -> tuple[Array, Array]:
        """Positions and turnings of these markers, from the amplitudes at all markers."""
        position, turn = jax.vmap(lambda body, *point: body.local_pose(*point))(
            self.bodies, self.prepared, self._own(amplitudes)
        )
        return position, turn

    def gradients(self, amplitudes: Float[Array, "all most"]) -> Array:
        """Displacements and turns of these markers per unit amplitude of their bodies."""
        slopes: Array = jax.vmap(lambda body, *point: body.local_gradient(*point))(
            self.bodies, self.prepared, self._own(amplitudes)
        )
        return slopes

    def among(self, rows: np.ndarray) -> "Bending | None":
        """The markers whose rows are among the given ones, numbered by their places there."""
        places = {row: place for place, row in enumerate(rows.tolist())}
        # The rest of a selection has other bodies.
        kept = np.array([i for i, row in enumerate(self.rows) if row in places], int)
        if not kept.size:
            return None
        bodies, prepared = jax.tree.map(lambda x: pick(x, kept), (self.bodies, self.prepared))
        return Bending(bodies, prepared, tuple(places[self.rows[i]] for i in kept))

    def _own(self, amplitudes: Array) -> Array:
        return amplitudes[np.array(self.rows), : self.bodies.modes]


@program_once
def _prepared(bodies: AbstractBendingBody, points: Float[Array, "count d"]) -> Any:
    return jax.vmap(lambda body, point: body.prepare(point))(bodies, points)
