"""Arrays that a user changes after they were given, as in a loop: scenes and runs do not change."""

import jax
import numpy as np
import pytest
import zoo

import romjax as rj
from romjax.common.arrays import as_array, as_jax


def aligned(numbers) -> np.ndarray:
    """The numbers at an address that is a multiple of 64, where JAX would share their memory."""
    numbers = np.asarray(numbers, float)
    room = np.zeros(8 * numbers.size + 64, np.uint8)
    first = -room.ctypes.data % 64
    own = room[first : first + 8 * numbers.size].view(float).reshape(numbers.shape)
    own[...] = numbers
    return own


def test_jax_shares_memory():
    """Else the other tests show nothing."""
    given = aligned([1.0, 2.0])
    shared = jax.device_put(given)
    given[:] = 0
    assert not np.any(shared)


@pytest.mark.parametrize("convert", [as_array, as_jax])
def test_numbers(convert):
    given = aligned([1.0, 2.0])
    own = convert(given)
    given[:] = 0
    assert own.tolist() == [1.0, 2.0]


def test_parts_and_runs():
    """Places and numbers of parts, starts, and output times."""
    place, q0, ts = aligned([0.5, 0.0]), aligned([1.0, 0.0]), aligned([0.0, 0.1, 0.2])
    body = rj.RigidBody("bar", 1.0, 0.1, position=place)
    system = zoo.point_pendulum()
    run = zoo.run(system, ts, q0=q0, rtol=1e-5)
    before = np.array(run.t), np.array(run.q)
    for given in (place, q0, ts):
        given += 1
    assert np.asarray(body.position).tolist() == [0.5, 0.0]
    assert np.array_equal(run.t, before[0])
    assert np.array_equal(run.q, before[1])
