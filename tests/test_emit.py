"""Functions of JAX as functions of C: every operation, loops, and what is refused."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from jax import lax
from native import called, library
from tolerances import IDENTITY

import romjax as rj
from romjax.common import compat
from romjax.export.control import _PLAIN, Control
from romjax.export.emit import emit, emit_split

RNG = np.random.default_rng(0)
X, Y = RNG.uniform(-0.9, 0.9, (2, 2, 3))
X[0, 1] = Y[0, 1]
TABLE = RNG.normal(size=(4, 3))
POINT = {"x": (2, 3), "y": (2, 3)}


def number(z):
    """An index that depends on the state."""
    return jnp.floor(2 * z[0, 0] + 2).astype(int)


def whole(z):
    return jnp.floor(4 * z).astype(int)


WHOLE = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "bool")


def beyond(x):
    """The least and the largest number of each type, of which the program does not know any."""
    for kind in WHOLE[:-1]:
        ends = np.array([np.iinfo(kind).min, np.iinfo(kind).max], kind)
        yield jnp.where(x[0, :2] > 2, ends[::-1], ends)


def doubled(x, most):
    """Numbers that grow until they reach one."""

    def go(state):
        return state[0] * 2 + 0.1, state[1] + 1

    return lax.while_loop(lambda state: jnp.max(state[0]) < most, go, (jnp.abs(x), 0))


def counted_up(x, most):
    return lax.while_loop(lambda state: state[0] < most, lambda s: (s[0] + 1, s[1] * x), (0, x))[1]


@jax.custom_vjp
def own_reverse(x):
    return jnp.sin(x)


own_reverse.defvjp(lambda x: (jnp.sin(x), x), lambda x, g: (g * x,))


def newton(x, y):
    """A linear solve of its own, with its transpose."""
    matrix = jnp.eye(3) * 3 + jnp.outer(x[0], y[0])
    return lax.custom_linear_solve(
        lambda z: matrix @ z, x[1], lambda mv, b: 0.3 * b + mv(b), lambda mv, b: 0.3 * b
    )


def halving(x, y):
    """A loop whose end depends on the state, with a row that changes at a place that does."""

    def go(state):
        i, z, rows = state
        return i + 1, 0.5 * z, lax.dynamic_update_index_in_dim(rows, z, jnp.minimum(i, 1), 0)

    start = jnp.zeros((), int), x[0] + 2.0, y
    return lax.while_loop(lambda state: jnp.max(jnp.abs(state[1])) > 0.1, go, start)


def sums(x, y, reverse=False):
    """A loop over rows with a carried sum and rows of its own."""

    def go(total, row):
        one, two = row
        return total + one * jnp.sin(two), {"row": total * two, "last": total[0]}

    return lax.scan(go, x[0], (x, y), reverse=reverse)


def branch(x, y):
    cases = [jnp.sin, lambda z: z @ jnp.ones((3, 2)) @ jnp.ones((2, 3)), lambda z: 0.0 * z]
    return lax.switch(number(x), cases, y)


CASES = {
    "add sub mul div": lambda x, y: (x + y) * (x - y) / (2.0 + x) - y * -1.0 + 0.0 * x,
    "neg abs sign": lambda x, y: -jnp.abs(x) + jnp.sign(y),
    "functions": lambda x, y: [
        f(x) for f in (jnp.sin, jnp.cos, jnp.tan, jnp.exp, jnp.tanh, jnp.sinh, jnp.cosh, jnp.exp2)
    ],
    "gamma": lambda x, y: [lax.lgamma(5 * x), lax.lgamma(jnp.array([-1.0, 0.0, 3.5]))],
    "inverses": lambda x, y: [
        f(x) for f in (jnp.arcsin, jnp.arccos, jnp.arctan, jnp.arctanh, jnp.arcsinh)
    ],
    "slopes of inverses": lambda x, y: [
        jax.jvp(f, (x,), (y,))[1] for f in (jnp.arcsin, jnp.arccos, jnp.arctanh)
    ],
    "more": lambda x, y: [
        jnp.sqrt(1 + x), lax.rsqrt(1 + x), jnp.log(2 + x), jnp.log1p(x), jnp.expm1(x), jnp.cbrt(x)
    ],
    "error functions": lambda x, y: lax.erf(x) + lax.erfc(y) + lax.logistic(x),
    "arccosh": lambda x, y: jnp.arccosh(2 + x),
    "two": lambda x, y: jnp.arctan2(x, y) + (2 + x) ** y + jnp.fmod(x, 0.3),
    "powers": lambda x, y: [(2 + x) ** k for k in (-3, -1, 0, 1, 2, 3, 7, 20)] + [lax.square(x)],
    "rounding": lambda x, y: [
        jnp.floor(3 * x) + jnp.ceil(3 * y), jnp.round(9 * x),
        *(lax.round(2.5 + 0 * x + jnp.round(y), method) for method in lax.RoundingMethod),
    ],
    "polynomials": lambda x, y: jnp.polyval(jnp.array([0.3, -1.0, 0.0, 2.0]), x + y),
    "comparisons": lambda x, y: [x > y, x >= y, x < y, x <= y, x == y, x != y],
    "logic": lambda x, y: [
        (x > 0) & (y > 0), (x > 0) | (y > 0), (x > 0) ^ (y > 0), ~(x > 0), jnp.isfinite(x)
    ],
    "no numbers": lambda x, y: [
        f(jnp.log(x)) for f in (jnp.sign, jnp.argmax, functools.partial(jnp.argmin, axis=1))
    ],
    "choices among many": lambda x, y: [
        jnp.select([x > 0.3, x > 0], [x, y], 0.5), lax.select_n(whole(x) % 3, x, y, x * y),
        lax.select_n(np.arange(3), x[0], y[0], x[1]),
    ],
    "choices": lambda x, y: jnp.where(x > y, x, 2.0) + jnp.maximum(x, 0.1) + jnp.minimum(0.1, y),
    "clamp": lambda x, y: lax.clamp(-0.2, x, 0.3) + jnp.clip(y, -0.1, 0.1),
    "kinds": lambda x, y: (3 * x).astype(int) * 1.5 + (x > 0) * y + (x != 0).astype(int),
    "whole numbers": lambda x, y: number(x) // 2 + number(y) % 2 - abs(-number(x)) * 3,
    "division by zero": lambda x, y: [
        f(*pair) for f in (lax.div, lax.rem)
        for pair in ((whole(x), whole(y) * 0), (whole(x), -3), (jnp.array(-7), jnp.array(2)))
    ],
    "bits": lambda x, y: [
        whole(x) & whole(y), whole(x) | whole(y), whole(x) ^ whole(y), ~whole(x),
        whole(x) << 2, whole(x) >> 1, lax.shift_right_logical(whole(x), 3), whole(x) << 70,
        lax.shift_right_arithmetic(whole(x), 99), jnp.array(-5) >> 1, 2 ** jnp.abs(whole(x)),
        jnp.bitwise_and.reduce(whole(x)), jnp.bitwise_or.reduce(whole(x), axis=1),
        lax.reduce_xor(whole(x), (0, 1)),
    ],
    "bits of doubles": lambda x, y: [
        jnp.copysign(x, y), jnp.signbit(x), jnp.frexp(3 * x), jnp.ldexp(x, whole(y)),
        jnp.copysign(x, -2.0), lax.bitcast_convert_type(x, float),
    ],
    "without a sign": lambda x, y: [
        f(number(x).astype(jnp.uint32), jnp.uint32(5)) for f in (lax.sub, lax.add, lax.mul)
    ] + [(300 - 2 * number(x)).astype(t).astype(int) for t in (jnp.uint8, jnp.int8, jnp.uint32)]
    + [~number(x).astype(jnp.uint8), jnp.uint32(3) - jnp.uint32(5) + 0 * number(x)],
    "beyond their range": lambda x, y: [
        f(z) for z in beyond(x) for f in (
            lambda a: a + a, lambda a: a - 1, lambda a: a * a, lambda a: -a, jnp.abs, jnp.sign,
            lambda a: a**11, lambda a: lax.div(a, lax.neg(jnp.ones_like(a))), jnp.cumsum,
            lambda a: lax.rem(a, a * 0 - 1), lambda a: lax.div(a, a * 0),
            lambda a: jnp.sum(a, dtype=a.dtype), lambda a: a @ a, jnp.cumprod,
            lambda a: jnp.zeros(2, a.dtype).at[0].add(a[1]).at[0].multiply(3),
            lambda a: jnp.take(a, number(x) + 9, mode="fill"),
        )
    ],
    "as whole numbers": lambda x, y: [
        (z * unlike).astype(t) for t in WHOLE for z in (x[0, 0] ** 0, jnp.ones(()))
        for unlike in np.array([np.nan, np.inf, -np.inf, 1e30, -1e30, 3e9, -3e9, -0.5, 300.7, 0])
    ],
    "known": lambda x, y: 0 * x + jnp.sin(TABLE[:2]) + jnp.arange(3.0)[None] + jnp.minimum(9, y),
    "stop": lambda x, y: lax.stop_gradient(x) + lax.optimization_barrier(y),
    "shapes": lambda x, y: x.reshape(3, 2) @ y[:, :2] + jnp.squeeze(x[None]).T[:, ::-1][:, :2],
    "parts": lambda x, y: [*jnp.unstack(x), *jnp.split(y, [1], axis=1), x[:, ::2], x[::-1]],
    "together": lambda x, y: jnp.concatenate([x, y], axis=1) + jnp.stack([x, y]).reshape(2, 6),
    "tile": lambda x, y: [jnp.tile(x, (2, 1, 3)), jax.grad(lambda x: jnp.sum(jnp.tile(x, 2)))(x)],
    "pad": lambda x, y: lax.pad(x, 1.5, [(1, -1, 0), (0, 2, 1)]),
    "diagonal": lambda x, y: jnp.diagonal(x @ y.T),
    "iota": lambda x, y: lax.broadcasted_iota(float, (2, 3), 1) * x + jnp.arange(2.0)[:, None],
    "sums": lambda x, y: [jnp.sum(x), jnp.sum(x, axis=0), jnp.prod(y, axis=1), jnp.mean(x)],
    "extremes": lambda x, y: [jnp.max(x, axis=1), jnp.min(y), jnp.argmax(x), jnp.argmin(y, axis=1)],
    "any and all": lambda x, y: [jnp.any(x > y, axis=1), jnp.all(x > y)],
    "cumulative": lambda x, y: [
        jnp.cumsum(x, axis=1), lax.cumprod(y, reverse=True), lax.cummax(x), lax.cummin(y)
    ],
    "products": lambda x, y: [x @ y.T, jnp.einsum("bi,bj->bij", x, y), jnp.vdot(x, y)],
    "gather": lambda x, y: [x[:, np.array([2, 0])], x[np.array([1, 0]), np.array([2, 2])]],
    "gather by state": lambda x, y: [
        jnp.asarray(TABLE)[number(x)],
        x[:, number(y) - 1],
        jnp.take(x, number(x) + jnp.arange(5), axis=1, mode="fill", fill_value=7.0),
        x[(number(x) + jnp.arange(2)) % 2],
    ],
    "searches": lambda x, y: [
        jnp.searchsorted(jnp.cumsum(jnp.abs(x[1])), jnp.stack([y[0, 1], jnp.nan * x[0, 0]])),
        jnp.searchsorted(np.arange(-0.6, 0.9, 0.3), y[0], side="right"),
    ],
    "gather in a batch": lambda x, y: jax.vmap(lambda a, i: a[i])(x, jnp.argmax(y, axis=1)),
    "scatter": lambda x, y: [x.at[:, 1].add(y[:, 0]), x.at[1].set(y[0]), x.at[0, 7].add(3.0)],
    "scatter by state": lambda x, y: [
        x.at[0, number(x)].add(y[0, 1]), x.at[:, number(y) - 1].set(y[:, 0]),
        jnp.zeros(5).at[whole(x[0])].max(y[0]), jnp.ones(5).at[whole(x[0])].multiply(y[0]),
        x.at[np.array([0, 0]), 1].min(y[0, :2]), x.at[number(x) + 1].set(y[0]),
        jax.grad(lambda x: jnp.sum(jnp.sort(x, axis=1) * y))(x),
    ],
    "scatter within": lambda x, y: [
        x.at[0, 7].set(3.0, mode="clip"), x.at[number(x) - 3, 1].add(3.0, mode="clip"),
        x.at[0].apply(jnp.sin),
    ],
    "scatter twice": lambda x, y: jnp.zeros(4).at[np.array([0, 2, 0])].add(x[0]),
    "dynamic slice": lambda x, y: [
        lax.dynamic_slice(x, (0, number(y)), (2, 2)),
        lax.dynamic_update_slice(x, y[:, :2], (0, number(y))),
        lax.dynamic_slice(x, (5, 1), (1, 2)),
        lax.dynamic_update_slice(x, y[:1], (1, 0)),
    ],
    "scan": lambda x, y: sums(x, y),
    "reversed scan": functools.partial(sums, reverse=True),
    "while": halving,
    "lanes of a loop": lambda x, y: [
        jax.vmap(doubled)(x, 1 + jnp.abs(y[:, 0])), jax.vmap(doubled)(x, np.array([1.0, 3.0])),
        jax.vmap(counted_up)(x[0], np.array([1, 3, 2])),
    ],
    "counted": lambda x, y: lax.fori_loop(0, 4, lambda i, z: jnp.cos(z) + i, x),
    "cond": lambda x, y: [branch(x, y), lax.cond(x[0, 0] > 0, jnp.sin, jnp.cos, y)],
    "linear solve": newton,
    "by JAX": lambda x, y: [jnp.linalg.pinv(jnp.asarray(TABLE)) @ x.reshape(6)[:4] + jnp.sum(y)],
    "factors": lambda x, y: [
        jnp.linalg.solve(y @ y.T + x[:, :2], x),
        jnp.linalg.inv(jnp.stack([x[:, :2], y[:, 1:]])),
        jnp.linalg.cholesky(x @ x.T + jnp.eye(2)),
        jax.scipy.linalg.solve_triangular(x[:, :2], y, trans=1, unit_diagonal=True),
    ],
    "sorting": lambda x, y: [
        jnp.sort(x, axis=0), jnp.argsort((3 * y).astype(int), axis=1),
        jnp.argsort(jnp.where(x > 0.3, jnp.nan, x), axis=1),
        jax.vjp(lambda z: jnp.linalg.solve(y @ y.T + x[:, :2], z), x)[1](y)[0],
    ],
    "its derivative": lambda x, y: jax.jvp(newton, (x, y), (y, x))[1],
    "own derivatives": lambda x, y: jax.grad(lambda x: jnp.sum(own_reverse(x) * y))(x)
    + jax.nn.relu(x) + own_reverse(y),
    "calls": lambda x, y: jax.jit(lambda x: jax.checkpoint(jnp.sin)(x))(x),
    "reverse mode": lambda x, y: jax.grad(lambda x: jnp.sum(sums(x, y)[0] ** 2))(x),
}  # fmt: skip


def results(case, x, y):
    leaves = jax.tree.leaves(CASES[case](x, y))
    return {f"o{k}": jnp.asarray(leaf, float) for k, leaf in enumerate(leaves)}


@pytest.fixture(scope="module")
def both():
    """All cases, by C with loops unrolled, with loops as loops, and by JAX."""
    names = {case: f"case{k}" for k, case in enumerate(CASES)}
    functions = {}
    for unrolled in (10_000, 0):
        for case, name in names.items():
            made = functools.partial(results, case)
            functions[case, unrolled] = emit(made, f"{name}_{unrolled}", POINT, unrolled=unrolled)
    code = library(list(functions.values()))
    expected = jax.jit(lambda x, y: {case: results(case, x, y) for case in CASES})(X, Y)
    found = {key: called(code, function, X, Y) for key, function in functions.items()}
    return found, expected


@pytest.mark.parametrize("unrolled", [10_000, 0])
@pytest.mark.parametrize("case", CASES)
def test_operations(both, case, unrolled):
    found, expected = both
    for key, value in expected[case].items():
        here, value = found[case, unrolled][key], np.asarray(value)
        finite = np.isfinite(value)
        np.testing.assert_array_equal(here[~finite], value[~finite])
        scale = np.maximum(1, np.abs(value[finite]))
        assert_close(here[finite], value[finite], IDENTITY, scale)


@pytest.mark.instant
def test_every_operation_has_a_case():
    """And no case is needed for what is only another name of JAX for the same."""
    seen = set()

    def look(jaxpr):
        for equation in jaxpr.eqns:
            seen.add(equation.primitive.name)
            for value in jax.tree.leaves(
                list(equation.params.values()), is_leaf=lambda x: hasattr(x, "jaxpr")
            ):
                inner = getattr(value, "jaxpr", value)
                if hasattr(inner, "eqns"):
                    look(inner)

    for case in CASES:
        traced = jax.make_jaxpr(functools.partial(results, case))(X, Y)
        look(compat.of_plain_operations(traced).jaxpr)
    program = control()
    known = {*program.arithmetic.elementwise, *program.arithmetic.sums, *program.operations}
    known |= {"scan", "while", "cond", "select_n", "clamp", "integer_pow", "convert_element_type"}
    others = {*_PLAIN, "add_any", "copy", "copy_p", "expand_dims", "square", "cummax", "cummin"}
    others |= {"reduce_prod", "stop_gradient", "polynomial"}
    if not hasattr(lax, "one_minus_square"):  # before JAX 0.12
        others.add("one_minus_square")
    assert known - seen - others == set()


def control():
    from romjax.export.arithmetic import Arithmetic
    from romjax.export.arrays import Arrays
    from romjax.export.terms import Writer

    writer = Writer("f", 100, 100)
    arithmetic = Arithmetic(writer)
    return Control(writer, arithmetic, Arrays(arithmetic))


# What is written.


def one(function, **settings):
    return emit(lambda x, y: {"z": function(x, y)}, "f", POINT, **settings)


@pytest.mark.instant
def test_what_is_known_is_computed_and_what_nobody_needs_is_left_out():
    made = one(lambda x, y: x[0] * jnp.sin(2.0) + jnp.sum(jnp.exp(y)) * 0.0)
    assert made.operations == 3
    assert "sin" not in made.source
    assert "exp" not in made.source
    assert made.prototype == "void f(const double *x, const double *y, double *z);"


@pytest.mark.instant
def test_equal_terms_are_computed_once():
    assert one(lambda x, y: jnp.sin(x[0, 0]) + jnp.sin(x[0, 0])).operations == 2


@pytest.mark.instant
def test_signs_and_zeros_cost_nothing():
    """Signs go into the sums around them, and the zeros of a sparse row are one number."""
    assert one(lambda x, y: x[0, 0] - -(x[0, 1] * -y[0, 0]) * 2.0).operations == 3
    assert one(lambda x, y: x[0, 0] * y[0, 0] + y[0, 0] * x[0, 0] * 2.0).operations == 3
    assert one(lambda x, y: jnp.max(jnp.zeros((9, 9)).at[3, 4].set(x[0, 0]))).operations == 2


@pytest.mark.instant
def test_long_loops_are_loops():
    def many(x, y):
        return lax.scan(lambda z, _: (jnp.cos(z), None), x, None, length=10_000)[0]

    made = one(many)
    assert made.operations < 100
    assert "for (int i" in made.source


@pytest.mark.instant
def test_numbers_are_named():
    labels = {"x": [f"bar.x{k}" for k in range(6)], "z": ["height of */ the bar"]}
    made = emit(lambda x, y: {"z": x[0, 0]}, "f", POINT, labels, "Heights.")
    assert "/* Heights.\n * x[0]: bar.x0" in made.source
    assert "z[0] = x[0];  /* height of * / the bar */" in made.source


# What is refused.


@pytest.mark.instant
@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda x, y: jnp.linalg.eigh(x @ x.T)[0], "`eigh`"),
        (lambda x, y: x.astype(jnp.float32), "float32"),
        (lambda x, y: jnp.real(x + 1j), "complex128"),
        (lambda x, y: jnp.tri(3) @ x[0], "float32.*ask for dtype=float"),
        (lambda x, y: number(x) << number(y), "`shift_left` by a number that depends"),
        (lambda x, y: number(x).astype(jnp.int32) << 3, "`shift_left` of numbers of type int32"),
        (
            lambda x, y: number(x).astype(jnp.uint64) - 3,
            "numbers of type uint64 that depend on the state",
        ),
        (lambda x, y: lax.bitcast_convert_type(x, jnp.uint64), "the bits of a number as uint64"),
        (lambda x, y: jax.grad(lambda x: jnp.sum(halving(x, y)[1]))(x), "`f` is the derivative"),
        (lambda x, y: jax.random.normal(jax.random.key(number(x)), (3,)), "random numbers"),
        (lambda x, y: jax.pure_callback(np.sin, x, x), "`pure_callback`"),
    ],
)
def test_what_cannot_leave_is_named(function, words):
    with pytest.raises(rj.InputError, match=words):
        one(function)


@pytest.mark.instant
def test_what_is_too_long_is_refused():
    def long(x, y):
        return functools.reduce(lambda z, _: jnp.sin(z), range(30), x)

    with pytest.raises(rj.InputError, match="180 operations"):
        one(long, most=100)
    with pytest.raises(rj.InputError, match="more than 40 operations"):
        one(long, most=10)


def test_what_needs_no_later_argument_is_computed_once():
    """Of a derivative: sines, loops and factors of the point are in the first function alone."""

    def value(x):
        rows = lax.linalg.lu(jnp.eye(3) * 3 + jnp.outer(x[0], x[1]))[0]
        return jnp.sin(halving(x, x)[1]) @ rows

    def both(x, v):
        result, along = jax.jvp(value, (x,), (v,))
        return {"z": result}, {"dz": along}

    shapes = {"x": (2, 3)}, {"v": (2, 3)}
    parts = emit_split(both, ("f", "f_jvp"), *shapes, {}, ("", ""))
    code = library(parts)
    first = called(code, parts[0], X)
    assert_close(first["z"], value(X), IDENTITY)
    for v in (X, Y):
        wanted = jax.jvp(value, (X,), (v,))[1]
        assert_close(called(code, parts[1], first["kept"], v)["dz"], wanted, IDENTITY)
    assert not any(word in parts[1].source for word in ("sin(", "cos(", "best"))


def test_bits_are_not_handed_on_as_doubles():
    """Which do not hold all of them."""

    def both(x, v):
        bits = lax.bitcast_convert_type(jnp.sin(x), int)
        return {"z": x}, {"dz": lax.bitcast_convert_type(bits | 1, float) * v}

    parts = emit_split(both, ("f", "f_jvp"), {"x": (2, 3)}, {"v": (2, 3)}, {}, ("", ""))
    code = library(parts)
    kept = called(code, parts[0], X)["kept"]
    wanted = jax.jit(lambda: both(X, Y)[1]["dz"])()
    assert np.array_equal(called(code, parts[1], kept, Y)["dz"], wanted)
