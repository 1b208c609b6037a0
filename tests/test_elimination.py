"""Sparse factors of small blocks, against dense solutions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import IDENTITY

from romjax.linalg.block_cholesky import Factor
from romjax.linalg.ordering import order


def graph(random, nodes, most):
    """Edges between some of the nodes."""
    ends = random.integers(0, nodes, (most, 2))
    return tuple(sorted({(int(min(e)), int(max(e))) for e in ends if e[0] != e[1]}))


@pytest.mark.parametrize("nodes", [1, 3, 5, 12, 30])
def test_the_solution_is_that_of_the_dense_matrix(nodes):
    random = np.random.default_rng(nodes)
    for edges in (graph(random, nodes, most) for most in (0, nodes // 2, nodes, 2 * nodes)):
        b = 2
        couplings = 0.2 * random.normal(size=(len(edges), b, b))
        diagonal = random.normal(size=(nodes, b, b))
        diagonal = diagonal + diagonal.swapaxes(1, 2) + 10 * np.eye(b)
        matrix = np.zeros((nodes, b, nodes, b))
        matrix[np.arange(nodes), :, np.arange(nodes)] = diagonal
        for (i, j), block in zip(edges, couplings, strict=True):
            matrix[i, :, j], matrix[j, :, i] = block, block.T
        right = random.normal(size=(nodes, b, 3))
        wanted = np.linalg.solve(matrix.reshape(nodes * b, -1), right.reshape(nodes * b, 3))
        found = jax.jit(lambda d, c, r, edges=edges: Factor(d, c, edges).solve(r))(
            jnp.asarray(diagonal), jnp.asarray(couplings), jnp.asarray(right)
        )
        assert_close(found, wanted.reshape(right.shape), IDENTITY)


def test_chains_and_trees_gain_no_edges():
    """Each node has one neighbour at most when it is eliminated, and a chain needs one slot."""
    chain = tuple((i, i + 1) for i in range(19))
    star = tuple((0, 1 + 3 * i) for i in range(5)) + tuple(
        (1 + 3 * i + k, 2 + 3 * i + k) for i in range(5) for k in range(2)
    )
    for edges, slots in ((chain, 1), (star, 2)):
        schedule = order(1 + max(max(edge) for edge in edges), edges)
        assert schedule.degree == 1
        assert schedule.slots[0] == slots + 1
