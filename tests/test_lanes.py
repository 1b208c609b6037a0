"""Batches with lanes last: the same results, by loops that run over lanes."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax.compiling import jaxprs, lanes
from romjax.compiling.lane_marks import marked

LANES = 16
A = np.random.default_rng(1).normal(size=(LANES, 3, 4))


def many_operations(a):
    """Each rule once: what is taken of a lane's matrix (3, 4), in loops and branches too."""
    a = marked(a)
    row, first = a[0], jnp.argmax(a[:, 0])
    fixed = jnp.stack([a[:, ::2].T @ a, jnp.broadcast_to(row, (2, 4))])
    moved = jnp.concatenate([a.reshape(2, 6)[:, :4], jnp.pad(a[1:], ((0, 1), (0, 0)))])
    by_index = a[np.array([2, 0, 2])].at[np.array([1])].set(row)
    own = a.at[first].add(a[first]) + jax.lax.dynamic_slice(a, (first, 0), (1, 4))
    sums = jnp.cumsum(a, axis=1).sum(axis=0) + a[::-1].max(axis=0) * (a > 0).any(axis=0)
    sorted_rows = jnp.sort(a, axis=1)

    def halve(x):
        return jax.lax.cond(True, lambda x: x / 2, lambda x: x, x) - 0.01 * row[0]

    halved = jax.lax.while_loop(lambda x: jnp.max(jnp.abs(x)) > 0.4, halve, a)
    carried, rows = jax.lax.scan(lambda c, x: (c * 0.5 + x, jnp.tanh(c)), row, a)
    counted = jax.lax.fori_loop(0, 3, lambda i, x: x.at[i].set(x[i] * row), a)
    return fixed, moved, by_index, own, sums, sorted_rows, halved, carried, rows, counted


@functools.cache
def batches(axis=0):
    """The jaxpr of all lanes as `jax.vmap` gives it, and with lanes last."""
    given = np.moveaxis(A, 0, axis)
    plain = jaxprs.merged(jax.make_jaxpr(jax.vmap(many_operations, axis))(given))
    return plain, lanes.held_last(plain)


@pytest.mark.parametrize("axis", range(3))
def test_the_same_results(axis):
    """Wherever lanes are in what is given."""
    batch = np.moveaxis(A, 0, axis)
    plain, last = (jax.jit(functools.partial(jaxprs.evaluate, x))([batch]) for x in batches(axis))
    for own, other in zip(last, plain, strict=True):
        assert own.shape == other.shape
        assert_close(own, other, IDENTITY)


def sum_of_many_digits(a):
    a = marked(a)
    return jax.lax.dot(a, a.T, preferred_element_type=jnp.float64)


def test_products_are_summed_in_the_digits_that_are_asked_for():
    given = A.astype(np.float32)
    last = lanes.held_last(jaxprs.merged(jax.make_jaxpr(jax.vmap(sum_of_many_digits))(given)))
    (found,) = jax.jit(functools.partial(jaxprs.evaluate, last))([given])
    assert found.dtype == np.float64
    wide = given.astype(float)
    assert_close(found, wide @ wide.swapaxes(1, 2), IDENTITY)


def test_loops_run_over_lanes():
    plain, last = batches()
    for closed, first in ((plain, True), (last, False)):
        loops = [e for e in jaxprs.equations(closed.jaxpr) if e.primitive.name in jaxprs.LOOPS]
        shapes = [x.aval.shape for e in loops for x in e.outvars if LANES in x.aval.shape]
        assert len(shapes) > 3
        assert all(shape.index(LANES) == len(shape) - 1 for shape in shapes) is not first
    # No mark is left over.
    assert "lanes" not in {e.primitive.name for e in jaxprs.equations(last.jaxpr)}


@jax.custom_vjp
def half(x):
    return 0.5 * x


half.defvjp(lambda x: (half(x), None), lambda _, slope: (0.5 * slope,))


def random_operations(seed, size):
    """A function of an array (size, size), and of numbers of places, by operations at random."""
    rng = np.random.default_rng(seed)

    def operate(x, i):
        x, i = marked((x, i))
        for _ in range(12):
            k, axis = rng.integers(16), int(rng.integers(2))
            order, table = rng.permutation(size), rng.integers(size, size=(2, 1))
            steps = [
                lambda x, axis=axis: jnp.cumsum(x, axis) - x.sum(axis, keepdims=True),
                lambda x: jnp.sin(x.T @ x) + x,
                lambda x, axis=axis: jnp.flip(x, axis) * jnp.max(x, axis, keepdims=True),
                lambda x, axis=axis: jnp.concatenate(jnp.split(x, [1], axis)[::-1], axis),
                lambda x: x.reshape(1, size * size).reshape(size, size) + x[i % size][None],
                lambda x, order=order, axis=axis: jnp.take(x, order, axis),
                lambda x, table=table: x.at[table].add(x[table[::-1]]),
                lambda x: x.at[i % size].set(jnp.tanh(x[:, (i + 1) % size])),
                lambda x: jnp.pad(x[:-1, 1:], ((1, 0), (0, 1))),
                lambda x, axis=axis: jnp.stack(list(jnp.moveaxis(x, axis, 0)), 1 - axis),
                lambda x: jnp.where(x > x.mean(), x, x[jnp.argmin(x[:, 0])][None]),
                lambda x: jax.lax.dynamic_update_slice(x, x[:1] * 0.5, (i % size, 0)),
                lambda x: jax.lax.scan(lambda c, y: (jnp.cos(c) + y, c * y), x[0], x)[1],
                lambda x: jax.lax.while_loop(lambda c: jnp.sum(c**2) > 1, lambda c: c / 3, x),
                lambda x: jax.vmap(jnp.outer)(x, x).sum(0) / (1 + jnp.sum(x**2)),
                lambda x: jnp.sort(x, 0) - jax.lax.cond(i > 3, jnp.sin, jnp.cos, x),
            ]
            x = jnp.tanh(steps[k](x))
        return x

    return operate


@pytest.mark.exhaustive
@pytest.mark.parametrize("size", [3, 8, 9])
@pytest.mark.parametrize("seed", range(20))
def test_operations_at_random(seed, size):
    """With as many lanes as numbers along an axis too, and batches in batches."""
    rng = np.random.default_rng(100 + seed)
    inner, lanes_of_both = int(rng.integers(3)), 8
    given = rng.normal(size=(lanes_of_both, size, size)), rng.integers(9, size=lanes_of_both)
    operate = random_operations(seed, size)
    batch = jax.vmap(operate)
    if inner:
        more = rng.integers(9, size=2 + inner)
        both = jax.vmap(operate, (None, 0))
        batch = jax.vmap(lambda x, i: both(x, i + more))
    plain = jaxprs.merged(jax.make_jaxpr(batch)(*given))
    last = lanes.held_last(plain)
    assert last is not plain
    found, wanted = (jaxprs.evaluate(x, given) for x in (last, plain))
    assert_close(found[0], wanted[0], SOLVED)


def test_functions_with_derivatives_of_their_own_beside_a_batch():
    def beside(a, k):
        return jax.vmap(lambda x: marked(x).sum())(a) * half(k)

    closed = lanes.held_last(jaxprs.merged(jax.make_jaxpr(beside)(A, 3.0)))
    (found,) = jax.jit(functools.partial(jaxprs.evaluate, closed))([A, 3.0])
    assert_close(found, 1.5 * A.sum((1, 2)), IDENTITY)


def test_functions_that_are_mapped_over_devices_beside_a_batch():
    mesh = jax.sharding.Mesh(np.array(jax.devices()[:1]), ("devices",))
    over = jax.sharding.PartitionSpec("devices")
    mapped = jax.shard_map(jnp.cos, mesh=mesh, in_specs=over, out_specs=over)

    def beside(a, x):
        return jax.vmap(lambda x: marked(x).sum())(a).sum() + mapped(x)

    closed = lanes.held_last(jaxprs.merged(jax.make_jaxpr(beside)(A, A[0, 0])))
    (found,) = jaxprs.evaluate(closed, [A, A[0, 0]])
    assert_close(found, A.sum() + np.cos(A[0, 0]), IDENTITY)


@pytest.mark.parametrize("width", [3, 4])
def test_loops_whose_condition_is_that_of_another_batch(width):
    """Of so many inner lanes, as many as numbers in each or not, that end at other steps."""
    ends = np.array([1, 2, 4])

    def counted(a, end):
        def step(carry):
            return carry[0] + 1, carry[1] * 0.5 + marked(a)

        return jax.lax.while_loop(lambda c: c[0] < end, step, (0, jnp.zeros_like(a)))[1]

    rows = A[:, 0, :width]
    both = jax.vmap(jax.vmap(counted, (None, 0)), (0, None))
    closed = lanes.held_last(jaxprs.merged(jax.make_jaxpr(both)(rows, ends)))
    (found,) = jax.jit(functools.partial(jaxprs.evaluate, closed))([rows, ends])
    assert_close(found, rows[:, None] * (2 - 0.5 ** (ends - 1.0))[:, None], IDENTITY)


def test_only_batches_change():
    alone = jax.make_jaxpr(many_operations)(A[0])
    assert lanes.held_last(alone) is alone
    few = jax.make_jaxpr(jax.vmap(many_operations))(A[:2])
    assert lanes.held_last(few) is few


def swung(mass):
    """How far a double pendulum has turned after a short time."""
    system = rj.assemble(zoo.bars((mass, 1.0), angles=(0.3, -0.4)))
    return zoo.run(system, np.array([0.0, 0.3])).q[-1, -1]


@pytest.mark.slow
def test_runs_and_their_slopes():
    """All lanes take the steps that each takes alone, and have its slope."""
    both, masses = jax.value_and_grad(swung), np.linspace(0.5, 2.0, LANES)
    found = np.transpose(rj.jit(jax.vmap(both))(masses))
    alone = rj.jit(both)
    assert_close(found[::5], [alone(mass) for mass in masses[::5]], SOLVED)
