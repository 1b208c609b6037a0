"""Sparse factors of small blocks, against dense solutions."""

import functools

import jax
import numpy as np
import pytest
from comparison import assert_close
from tolerances import IDENTITY

from romjax.linalg.block_cholesky import Factor
from romjax.linalg.block_lu import BlockLU
from romjax.linalg.ordering import order


def graph(random, nodes, most):
    """Edges between some of the nodes."""
    ends = random.integers(0, nodes, (most, 2))
    return tuple(sorted({(int(min(e)), int(max(e))) for e in ends if e[0] != e[1]}))


@functools.partial(jax.jit, static_argnums=3)
def solution(diagonal, couplings, right, edges):
    return Factor(diagonal, couplings, edges).solve(right)


# Nodes, and the most edges between them: none, forests, and loops that fill.
@pytest.mark.parametrize(
    ("nodes", "most"), [(1, 2), (3, 0), (5, 10), (12, 6), (12, 24), (30, 30), (30, 60)]
)
def test_the_solution_is_that_of_the_dense_matrix(nodes, most):
    random = np.random.default_rng(nodes)
    edges = graph(random, nodes, most)
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
    found = solution(diagonal, couplings, right, edges)
    assert_close(found, wanted.reshape(right.shape), IDENTITY)


@functools.partial(jax.jit, static_argnums=(3, 4))
def both_solutions(diagonal, couplings, right, edges, after):
    factor = BlockLU(diagonal, couplings, edges, after)
    return factor.solve(right), factor.solve_transposed(right)


# The first node has no pivot of its own, but where it is the only one.
@pytest.mark.parametrize(("nodes", "most"), [(1, 2), (4, 6), (12, 24)])
def test_solutions_without_symmetry(nodes, most):
    """By a matrix and its transpose; the first node is regular once all others are eliminated."""
    random = np.random.default_rng(nodes)
    edges, b = graph(random, nodes, most), 2
    edges = tuple(sorted({*edges, *((0, i) for i in range(1, nodes))}))
    after = tuple((0, i) for i in range(1, nodes))
    couplings = 0.2 * random.normal(size=(len(edges), 2, b, b))
    diagonal = random.normal(size=(nodes, b, b)) + 5 * np.eye(b)
    diagonal[0] *= nodes == 1
    matrix = np.zeros((nodes, b, nodes, b))
    matrix[np.arange(nodes), :, np.arange(nodes)] = diagonal
    for (i, j), block in zip(edges, couplings, strict=True):
        matrix[i, :, j], matrix[j, :, i] = block
    matrix = matrix.reshape(nodes * b, -1)
    right = random.normal(size=(nodes, b, 3))
    found = both_solutions(diagonal, couplings, right, edges, after)
    for x, a in zip(found, (matrix, matrix.T), strict=True):
        wanted = np.linalg.solve(a, right.reshape(nodes * b, 3))
        scale = np.linalg.cond(a) * np.max(np.abs(wanted))
        assert_close(x, wanted.reshape(right.shape), IDENTITY, scale=scale)


@pytest.mark.instant
def test_nodes_come_after_those_that_they_need():
    """The closing node of a loop after its bodies, and no sooner or later for the others."""
    edges = ((0, 1), (0, 2), (1, 2), (2, 3))
    assert order(4, edges, ((0, 1), (0, 2))).nodes.index(0) > 1
    assert sorted(order(4, edges, ((0, 3),)).nodes) == [0, 1, 2, 3]
    assert order(4, edges, ()).nodes == order(4, edges).nodes


@pytest.mark.instant
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
