"""The coding of moving outlines: nothing that a picture shows is lost."""

import numpy as np
import pytest
from page_data import decode

from romjax.plot.motion.coding import encode

pytestmark = pytest.mark.instant


@pytest.mark.parametrize("shape", [(40, 7), (7, 40), (1, 6), (5, 1)])
def test_any_numbers_survive_the_coding(shape):
    """Also those without fewer shapes than columns."""
    values = np.random.default_rng(3).normal(size=shape) * 1e3
    block = encode(values, 0.5)
    error = np.max(np.abs(decode(block, shape[0]) - values))
    # Half a quantum is left out, half of one is the mean's, and a whole one each shape's.
    assert error <= 0.5 * (1 + len(block["reach"]))


def test_what_rests_is_sent_once():
    block = encode(np.tile([1.25, -3.0, 1e4], (50, 1)), 1e-3)
    assert (block["weights"], block["shapes"], block["reach"]) == ("", "", [])
    np.testing.assert_allclose(decode(block, 50), np.tile([1.25, -3.0, 1e4], (50, 1)))


def test_what_moves_as_one_is_a_few_shapes():
    """A rigid outline in the plane: two of its place, two of its angle."""
    angle = np.linspace(0, 3, 60)
    points = np.random.default_rng(1).normal(size=(30, 2))
    turned = [np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in angle]
    values = np.array(
        [(points @ r.T + [a, a**2]).ravel() for a, r in zip(angle, turned, strict=True)]
    )
    assert len(encode(values, 1e-3)["reach"]) == 4
