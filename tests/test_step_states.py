"""States at the ends of steps: bases of motions with contacts, which outputs may miss."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from tolerances import IDENTITY

import romjax as rj
from romjax.basis.passed import passed
from romjax.basis.snapshots import SnapshotSet
from romjax.march.states import States

ROWS = 9


@pytest.fixture(scope="module")
def pair():
    """A ball that hits another one, which hangs on a spring."""
    one = rj.RigidBody("one", 0.4, 0.01, velocity=(1.0, 0.2))
    other = rj.RigidBody("other", 0.4, 0.01, position=(0.25, 0.0))
    touch = rj.Contact(one.at(), other.at(), rj.Circle(0.1), stiffness=2e6)
    hold = rj.Spring(other.at(), rj.ground.at((0.3, 0.1)), 200.0)
    return rj.assemble(rj.Scene([one, other], [], [touch, hold]))


@pytest.fixture(scope="module")
def runs(pair):
    return [zoo.run(pair, np.linspace(0.0, 1.0, count), rtol=1e-8) for count in (7, 19)]


def test_states_are_thinned_evenly():
    """Of any number of steps, at least half of the rows are filled, at equal distances."""
    start = States(jnp.asarray(1), jnp.asarray(0), jnp.asarray(1), jnp.zeros(ROWS), jnp.zeros(ROWS))

    def put(states, step):
        states = states.put(step % 10 != 3, step * 1.0, -1.0 * step)
        return states, states

    steps = jnp.arange(1, 200)
    seen = jax.tree.map(np.asarray, jax.jit(lambda: jax.lax.scan(put, start, steps)[1])())
    kept = [0, *[int(k) for k in steps if k % 10 != 3]]
    for k, number, stride in zip(steps, seen.number, seen.stride, strict=True):
        accepted = [x for x in kept if x <= k]
        expected = accepted[:: int(stride)]
        row = int(k) - 1
        assert seen.t[row][:number].tolist() == expected
        assert seen.y[row][:number].tolist() == [-x for x in expected]
        assert number < ROWS
        assert stride == 1 or number > ROWS // 2


@pytest.mark.parametrize("thinned", [False, True])
def test_what_a_bouncing_ball_passes(thinned):
    """A flight is one step, until an impact after which the state is kept; g = 2, e = 1/2.

    Of steps that were thinned to more than one flight, nothing is known but their ends.
    """
    t = np.array([0.0, 1.5, 2.25, 2.25] if thinned else [0.0, 1.0, 2.0, 2.25, 2.25])

    def height(t):
        return np.select([t < 1, t < 2], [1 - t**2, (t - 1) * (2 - t)], (t - 2) * (2.5 - t))

    rates = np.select([t < 1, t < 2], [-2 * t, 3 - 2 * t], 4.5 - 2 * t)
    q, v, unused = height(t)[:, None], rates[:, None], [np.inf, np.inf]
    impacts = np.array([True, True, False, False])
    motion = SimpleNamespace(
        t=t[:2],
        q=q[:2],
        v=v[:2],
        metric=np.eye(1),
        labels=(),
        states=SimpleNamespace(t=t, q=q, v=v),
        events=SimpleNamespace(time=np.array([1.0, 2.0, *unused]), is_impact=impacts),
    )
    shares = np.array([] if thinned else [0.25, 0.5, 0.75])
    within = t[:-2] + shares[:, None] * np.diff(t)[:-1]
    found = np.asarray(passed(SnapshotSet.of(motion)))[:, 0]
    np.testing.assert_allclose(found, height(np.append(t, within)), atol=IDENTITY)


def test_a_basis_does_not_depend_on_the_outputs(runs):
    """With 6 outputs a second, no row lies within the contact, of a few milliseconds."""
    for make in (rj.pod, rj.sod):
        few, many = (make(run) for run in runs)
        assert few.rank == many.rank
        assert np.array_equal(few.values, many.values)
    states = runs[0].states
    times = np.asarray(states.t)
    assert (times[0], times[-1]) == (0.0, 1.0)
    assert np.min(np.diff(np.unique(times))) < 1e-3


def test_states_are_saved(runs, tmp_path):
    runs[0].save(tmp_path / "run.nc")
    loaded = rj.load(tmp_path / "run.nc")
    for name in ("t", "q", "v"):
        assert np.array_equal(getattr(loaded.states, name), getattr(runs[0].states, name))
    assert np.array_equal(rj.pod(loaded).values, rj.pod(runs[0]).values)


@pytest.mark.slow
def test_who_has_none(pair):
    """Mechanisms without contacts, and lanes of a batch, in which they would need much room."""
    assert zoo.motion(zoo.bar).states is None
    lanes = jax.vmap(lambda v: zoo.run(pair, np.linspace(0.0, 1.0, 7), v0=v, rtol=1e-6))
    assert lanes(jnp.stack([pair.v0, 2 * pair.v0])).states is None
