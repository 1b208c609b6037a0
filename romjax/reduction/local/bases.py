"""q_f = Φ z: how bodies with few modes stand for those with more."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...assembly.grouping import stack
from ...common.arrays import Numbers, as_jax, pick, untraced
from ...linalg.indexing import Index, spread
from ...system.reduced import Physical, Reduced


class BodyBases(eqx.Module):
    """q_f = Φ z of all bodies, stacked where they are of one size; frames are the same in q and z.

    - `modes` Φ (count, K, k), and `duals` ΦᵀM_ff (count, k, K), with the modal mass M_ff in which
      modes are orthonormal. Rigid bodies have none, K = k = 0.
    - `wide`, `narrow`: where frames and amplitudes of these bodies are in q and in z.
    """

    # Each of a shape of its own, so that the annotation can bind none.
    modes: tuple[Float[Array, "_ _ _"], ...]
    duals: tuple[Float[Array, "_ _ _"], ...]
    wide: tuple[Index, ...] = eqx.field(static=True)
    narrow: tuple[Index, ...] = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        modes: Sequence[Array],
        metrics: Sequence[Array],
        columns: Sequence[tuple[int, ...]],
    ) -> "BodyBases":
        """Make the bases from one Φ (K, k), one M_ff (K, K) and the columns in q for each body.

        Bodies are in the order of their coordinates.
        """
        n, shapes = 0, dict[tuple[int, ...], list[int]]()
        narrow = []
        for i, basis in enumerate(modes):
            # Counters of angles have neither modes nor the frame of a rigid body.
            shapes.setdefault((len(columns[i]), *basis.shape), []).append(i)
            size = len(columns[i]) - basis.shape[0] + basis.shape[1]
            narrow.append(range(n, n + size))
            n += size
        groups = list(shapes.values())
        stacked = [stack([modes[i] for i in group]) for group in groups]
        metric = [stack([metrics[i] for i in group]) for group in groups]
        pairs = [untraced(*pair) for pair in zip(stacked, metric, strict=True)]
        return cls(
            tuple(stacked),
            # Modes are orthonormal in M_ff: z = Φᵀ M_ff q_f is the nearest one.
            tuple(as_jax(x.swapaxes(1, 2) @ y) for x, y in pairs),
            tuple(Index.of([columns[i] for i in group]) for group in groups),
            tuple(Index.of([narrow[i] for i in group]) for group in groups),
        )

    def expand(self, z: Reduced) -> Physical:
        """Physical coordinates of z; velocities and accelerations alike."""
        return _mapped(self.modes, z, self.narrow, self.wide)

    def project(self, q: Physical) -> Reduced:
        """The nearest z, in the modal mass of each body; velocities alike."""
        return _mapped(self.duals, q, self.wide, self.narrow)

    def by_body(self) -> list[Array]:
        """Φ (K, k) of each body, in the order of their coordinates."""
        modes = {
            columns[0]: pick(group, row)
            for group, index in zip(self.modes, self.wide, strict=True)
            for row, columns in enumerate(index.rows)
        }
        return [modes[column] for column in sorted(modes)]


def _mapped(
    matrices: tuple[Numbers, ...], x: Array, source: tuple[Index, ...], target: tuple[Index, ...]
) -> Array:
    blocks = []
    for matrix, index in zip(matrices, source, strict=True):
        own, frame = index.take(x), index.width - matrix.shape[2]
        amplitudes = jnp.einsum("bij,bj->bi", matrix, own[:, frame:])
        blocks.append(jnp.concatenate([own[:, :frame], amplitudes], axis=1))
    tables = [index.array for index in target]
    return spread(blocks, tables, (sum(table.size for table in tables),))
