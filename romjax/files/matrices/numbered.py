"""Rows of matrices that are only numbered: which node and component each is."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .entries import wrong

# Components by rows of each node, where nobody says.
_DEFAULT = {2: {2: (1, 2), 6: (1, 2, 3, 4, 5, 6)}, 3: {3: (1, 2, 3), 6: (1, 2, 3, 4, 5, 6)}}


class Degrees(NamedTuple):
    """Nodes by rising number, each with the same components.

    - `numbers`: of the nodes. `components`: of each; None for x and y of two rows for each node,
      in space x, y and z of three, and all six of six. `dimension`: 2 or 3.
    """

    numbers: np.ndarray
    components: Sequence[int] | None
    dimension: int

    def of(self, path: Path, ids: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
        """The degrees of freedom of rows and columns `ids` (k, 2), from 1, of a matrix of `size`.

        Where components are given, rows after those of the nodes are modal coordinates. Raises
        InputError where rows and nodes do not fit.
        """
        each, left = divmod(size, max(len(self.numbers), 1))
        components = self.components or _DEFAULT[self.dimension].get(each, ())
        if self.components and len(self.components) * len(self.numbers) <= size:
            each = len(self.components)
            left = size - each * len(self.numbers)
        elif left or len(components) != each:
            raise wrong(
                path,
                0,
                f"has {size} rows for {len(self.numbers)} nodes; give the components of each node, "
                "such as components=(1, 2, 6), and nodes that are in the matrix only",
            )
        known = np.stack(
            [np.repeat(self.numbers, each), np.tile(np.array(components), len(self.numbers))],
            axis=1,
        )
        modal = np.stack([self.numbers.max() + 1 + np.arange(left), np.zeros(left, int)], axis=1)
        known = np.concatenate([known, modal])
        return known[ids[:, 0] - 1], known[ids[:, 1] - 1]
