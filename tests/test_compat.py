"""What romjax uses of other packages that is not public: each test fails where that has changed."""

import functools
import math
import sys

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache
from processes import KEPT

from romjax.common import compat
from romjax.compiling import functions, jaxprs
from romjax.integrate.adjoint import _forwards as forwards


@pytest.mark.instant
def test_the_newest_version_tested():
    """The bound of pyproject.toml: a newer JAX must pass these tests before it is allowed."""
    assert (0, 9) <= jax.__version_info__ < (0, 13), jax.__version__


@pytest.mark.instant
def test_compiler_flags_are_for_versions_that_have_them(monkeypatch):
    """That the compiler takes them is tested with `speed_up_xla`."""
    older = "--xla_cpu_use_fusion_emitters=false"
    for version, count in {(0, 8, 3): 0, (0, 9, 0): 3, (0, 10, 2): 3, (0, 11, 0): 2}.items():
        monkeypatch.setattr(jax, "__version_info__", version)
        assert len(compat.compiler_flags()) == count
        assert (older in compat.compiler_flags()) == (count == 3)
    monkeypatch.setattr(jax, "__version_info__", (0, 13, 0))
    assert compat.compiler_flags() == ()


def test_traced_numbers_are_told_from_others():
    seen = []

    def look(x):
        seen.append(compat.is_traced(x))
        return x

    for transform in (jax.jit, jax.grad, jax.vmap):
        transform(look)(jnp.ones(2) if transform is jax.vmap else 1.0)
    assert seen == [True] * 3
    assert not compat.is_traced(jnp.ones(2))
    assert not compat.is_traced(1.0)


def test_a_trace_context_is_part_of_the_key_of_compiled_functions():
    """Of all: another one than that of romjax would stay, and change the keys of all programs."""
    function = jax.jit(lambda x: x * (5 if forwards.value else 1))
    assert function(2.0) == 2
    with forwards(True):
        assert function(2.0) == 10
    assert function(2.0) == 2


@pytest.fixture
def cache_of_jax(tmp_path):
    """A folder that is that of JAX's own cache, of every program."""
    before = {name: getattr(jax.config, name) for name in KEPT}
    for name, value in zip(KEPT, (str(tmp_path), 0, -1), strict=True):
        jax.config.update(name, value)
    compilation_cache.reset_cache()
    yield tmp_path
    for name, value in before.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()


def test_programs_are_not_those_of_the_cache_of_jax(cache_of_jax):
    """`compiler_is_set_up` before anything is computed is tested with `speed_up_xla`."""
    lowered = jax.jit(lambda x: x + 1).lower(1.0)
    with compat.without_cache_of_jax():
        lowered.compile()
    assert compat.compiler_is_set_up()
    assert not list(cache_of_jax.iterdir())
    jax.jit(lambda x: x + 1).lower(1.0).compile()
    assert list(cache_of_jax.iterdir())


class Probe(diffrax.Euler):
    """Notes the terms that diffrax hands to a solver."""

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        inner, direction = compat.unwrap_term(terms)
        assert isinstance(inner, diffrax.ODETerm)
        again = compat.wrap_term(inner, direction)
        assert jax.tree.structure(again) == jax.tree.structure(terms)
        time = compat.unwrap_term(again)[1] * t0
        y = jnp.where(jnp.isnan(y0), y0, time)
        return y, None, {"y0": y0, "y1": y}, None, diffrax.RESULTS.successful


@pytest.mark.parametrize(("start", "end"), [(1.0, 2.0), (2.0, 1.0)])
def test_the_direction_of_time_around_a_term(start, end):
    """Inside of a step, t0 times the direction is the time at which the step starts."""
    term = diffrax.ODETerm(lambda t, y, args: -y)
    step = end - start
    found = diffrax.diffeqsolve(term, Probe(), start, end, step, jnp.zeros(())).ys
    assert found == start
    assert compat.unwrap_term(term) == (term, 1)


@pytest.mark.instant
def test_the_parts_of_a_term():
    one, other = (diffrax.ODETerm(lambda t, y, args: y) for _ in range(2))
    assert compat.parts_of_term(one) == ()
    assert compat.parts_of_term(diffrax.MultiTerm(one, other)) == (one, other)
    assert compat.parts_of_term(compat.wrap_term(one, -1)) == (one,)


def test_the_term_of_a_continuous_adjoint():
    """`BacksolveAdjoint` integrates a term of its own, made of the one that it is given."""
    seen = []

    class Watched(diffrax.Euler):
        def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
            inner, _ = compat.unwrap_term(terms)
            seen.append([type(x).__name__ for x in (inner, *compat.parts_of_term(inner))])
            return super().step(terms, t0, t1, y0, args, solver_state, made_jump)

    def loss(y):
        return diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, y, args: -y),
            Watched(),
            0.0,
            1.0,
            0.5,
            y,
            adjoint=diffrax.BacksolveAdjoint(),
        ).ys[-1]

    jax.make_jaxpr(jax.grad(loss))(1.0)
    assert ["ODETerm"] in seen
    assert ["AdjointTerm", "WrapTerm"] in seen


def test_the_kind_of_loop_over_stages():
    """Unset in a new solver, set by the adjoints of forward and direct differentiation."""
    seen = []

    class Watched(diffrax.Tsit5):
        def step(self, *args, **settings):
            seen.append(compat.scan_kind(self))
            return super().step(*args, **settings)

    assert compat.scan_kind(diffrax.Tsit5()) is None
    term = diffrax.ODETerm(lambda t, y, args: -y)
    kinds = {diffrax.ForwardMode: "lax", diffrax.DirectAdjoint: "bounded"}
    for adjoint, kind in kinds.items():
        seen.clear()
        settings = {"adjoint": adjoint(), "max_steps": 4}
        solve = functools.partial(diffrax.diffeqsolve, term, Watched(), 0.0, 1.0, 0.5, **settings)
        jax.eval_shape(lambda y, solve=solve: solve(y).ys, 1.0)
        assert set(seen) == {kind}


def unused(t, y, args):
    raise AssertionError("its shape is known")


@pytest.mark.parametrize("solver", [diffrax.Dopri8(), diffrax.Kvaerno5()])
def test_methods_start_without_the_vector_field(solver):
    """As they do with one that is traced for its shape."""
    start = 0.0, 0.1, (jnp.ones(2), jnp.ones(3)), None
    wanted = solver.init(diffrax.ODETerm(lambda t, y, args: jax.tree.map(jnp.sin, y)), *start)
    found = compat.state_of_method(solver, diffrax.ODETerm(unused), *start)
    assert eqx.tree_equal(found, wanted, typematch=True)


@pytest.mark.instant
def test_what_solvers_pass_on_to_controls():
    """One dict for each term; empty, but for methods that need areas of Brownian motion."""
    assert compat.control_arguments(diffrax.Tsit5()) == {}
    assert compat.control_arguments(diffrax.SPaRK()) != {}


@pytest.mark.instant
def test_statics_of_equinox_modules_are_compared_by_value():
    """Trajectories hold their solver in a static field; equal ones must share a program."""
    one, other = (eqx.partition(diffrax.Kvaerno5(), eqx.is_array)[1] for _ in range(2))
    assert one == other
    assert hash(one) == hash(other)


def test_the_outermost_program():
    """And what only differentiates: neither in a program nor in a batch."""
    inside = []

    def look(x):
        inside.append((compat.is_outermost(), compat.is_differentiating()))
        return x

    assert compat.is_outermost()
    assert not compat.is_differentiating()
    jax.jit(look)(1.0)
    jax.vmap(look)(jnp.ones(2))
    jax.vmap(jax.grad(look))(jnp.ones(2))
    jax.jit(jax.grad(look))(1.0)
    assert inside == [(False, False)] * 4
    del inside[:]
    jax.grad(look)(1.0)
    jax.jvp(jax.grad(look), (1.0,), (1.0,))
    assert inside == [(False, True)] * 2


def nested(x):
    y = jax.lax.while_loop(lambda y: y[0] < 3, lambda y: y + jnp.outer(y, y) @ y, x)
    return jnp.linalg.cholesky(jnp.diag(y))


def test_equations_of_programs():
    """Those inside of others too, what they call, and the size of their products."""
    equations = list(jaxprs.equations(jax.make_jaxpr(nested)(jnp.ones(3)).jaxpr))
    names = [equation.primitive.name for equation in equations]
    assert {"while", "dot_general", "cholesky"} <= set(names)
    calls = {e.primitive.name for e in equations if not jaxprs.is_written_out(e)}
    assert "cholesky" in calls
    assert not calls & {"while", "dot_general", "add", "lt", "mul"}
    assert max(map(jaxprs.product_terms, equations)) == 9


def test_operations_that_call_functions_are_bound_as_jaxprs_have_them():
    mesh = jax.sharding.Mesh(np.array(jax.devices()[:1]), ("devices",))
    over = jax.sharding.PartitionSpec("devices")
    mapped = jax.shard_map(jnp.cos, mesh=mesh, in_specs=over, out_specs=over)
    (equation,) = jax.make_jaxpr(mapped)(np.arange(3.0)).eqns
    (result,) = compat.bind(equation.primitive, [np.ones(3)], equation.params)
    np.testing.assert_allclose(result, np.cos(np.ones(3)))


def test_equal_quantities_are_computed_once():
    """In loops too; what is called twice stays one jaxpr, and what differs stays apart."""
    call = jax.jit(lambda x: jnp.cos(x) * jnp.cos(x))

    def function(x):
        def step(y):
            return y + jnp.sin(x) * jnp.sin(x) + jnp.tan(x) - jnp.arctan(x)

        return jax.lax.while_loop(lambda y: y < 9, step, x) + call(x) * call(x + 0.0)

    closed = jax.make_jaxpr(function)(1.5)
    merged = jaxprs.merged(closed)
    names = [e.primitive.name for e in jaxprs.equations(merged.jaxpr)]
    assert names.count("sin") == 1
    assert names.count("tan") == 1
    assert names.count("cos") == 2  # one in each call
    calls = [e for e in merged.jaxpr.eqns if "cos" in str(e)]
    assert len({id(e.params["jaxpr"]) for e in calls}) == 1
    assert jaxprs.evaluate(merged, [1.5]) == jaxprs.evaluate(closed, [1.5])


def test_equal_constants_and_calls_with_derivatives_of_their_own_are_one():
    """Each trace has constants and rules of its own, and calls are handed a constant twice."""

    def ruled(x):
        own = jax.custom_jvp(lambda x: jnp.sin(x * np.array([1.0, 2.0, 3.0])))
        own.defjvp(lambda x, rate: (own(*x), rate[0]))
        return own(x)

    def function(x):
        return ruled(x) + ruled(x) * jax.jit(lambda x: ruled(x) * ruled(x))(x)

    closed = jax.make_jaxpr(function)(1.5)
    merged = jaxprs.merged(closed)
    names = [e.primitive.name for e in jaxprs.equations(merged.jaxpr)]
    assert names.count("sin") == 2  # one in the call
    assert "custom_jvp_call" not in names
    ((mine,), (plain,)) = (jaxprs.evaluate(x, [1.5]) for x in (merged, closed))
    assert mine.tolist() == plain.tolist()


def written_out(equation):
    return all(map(jaxprs.is_written_out, jaxprs.equations_of(equation)))


RULE = functions.Rule(
    fits=lambda jaxpr, repeated: all(map(written_out, jaxpr.eqns)),
    size=lambda equation: 1 if written_out(equation) else math.inf,
    few=2,
    together=3,
    large=99,
)


def test_functions_of_a_program_carry_the_attribute():
    """It is one of the call alone, that of the loop; the compiler keeps that call."""
    whole = jax.make_jaxpr(nested)(jnp.ones(3))

    closed = functions.as_functions(whole, RULE)
    evaluate = lambda x: jaxprs.evaluate(closed, [x])  # noqa: E731
    lowered = jax.jit(evaluate, compiler_options=compat.compiler_options()).lower(jnp.ones(3))
    marked = [line for line in lowered.as_text().splitlines() if "xla_cpu_small_call" in line]
    assert any("call @" in line for line in marked)
    assert "xla_cpu_small_call" in lowered.compile().as_text()
    assert jnp.allclose(lowered.compile()(jnp.ones(3))[0], nested(jnp.ones(3)))


def test_groups_of_equations_are_functions():
    """Of a few equations each; none is handed an array of many numbers, which it would copy."""

    def f(x, rows):
        y = jnp.sin(jnp.cos(jnp.tan(jnp.exp(x))))
        return jnp.linalg.cholesky(jnp.diag(y))[0], rows.at[0].set(y[0] - 1), y[3:]

    given = jnp.ones(3), jnp.ones(99)
    closed = functions.as_functions(jax.make_jaxpr(f)(*given), RULE)
    names = [[e.primitive.name for e in jaxprs.equations_of(each)] for each in closed.jaxpr.eqns]
    assert {"exp", "tan", "cos"} <= set(names[0])
    assert "sin" in names[1]
    assert ["scatter"] in names
    for mine, plain in zip(jaxprs.evaluate(closed, given), f(*given), strict=True):
        assert mine.tolist() == plain.tolist()


class Part(eqx.Module):
    x: jax.Array


def test_executables_survive_on_disk(capfd):
    """Results that are trees, and arguments that nobody uses; nothing is said of it."""
    structs = [jax.ShapeDtypeStruct((5,), float)] * 2
    lowered = jax.jit(lambda x, y: {"a": (x, None), "b": Part(2 * x)}).lower(*structs)
    with compat.without_cache_of_jax():
        compiled = lowered.compile()
    again = compat.load_executable(*compat.dump_executable(compiled))
    assert not capfd.readouterr().err
    result = again(jnp.arange(5.0), jnp.ones(5))
    assert result["a"][1] is None
    assert result["b"].x.tolist() == [0, 2, 4, 6, 8]


@pytest.mark.instant
def test_the_mark_of_a_missing_field_is_found_by_its_name():
    """It is an object of the structure of a module, and found there again by pickling that name."""
    node = jax.tree.structure(eqx.nn.Identity()).node_data()
    mark = node[1][0]
    name = compat.name_of_missing(mark)
    assert getattr(sys.modules[type(mark).__module__], name) is mark
    assert compat.name_of_missing(eqx) is None


def test_settings_that_change_what_is_traced():
    before = compat.trace_settings()
    assert compat.trace_settings() == before
    with jax.default_matmul_precision("highest"):
        assert compat.trace_settings() != before
    with jax.numpy_dtype_promotion("strict"):
        assert compat.trace_settings() != before


def filled(x, y):
    return jax.lax.fori_loop(0, 3, lambda i, z: z.at[i].set(y[i]), x)


def put(x, y):
    return x.at[0].set(y[0])


def put_or_not(x, y):
    return jax.lax.cond(jnp.sum(y) > 0, put, lambda x, y: x, x, y)


def scanned(x, y):
    return jax.lax.scan(lambda z, row: (z.at[0].set(row), None), x, y)[0]


@pytest.mark.parametrize(
    "function", [filled, scanned, put, put_or_not, jax.jit(put), jax.vmap(put)]
)
def test_copies_are_of_arguments_that_are_changed(function):
    x = y = jax.ShapeDtypeStruct((3, 100), float)
    jaxpr = jax.make_jaxpr(function)(x, y).jaxpr
    assert jaxprs.largest_copy(jaxpr) == x.size * x.dtype.itemsize
    unchanged = jax.make_jaxpr(lambda x, y: function(2 * x, y))(x, y)
    assert jaxprs.largest_copy(unchanged.jaxpr) == 0


def test_loops_that_repeat_a_function_are_told():
    """A batch stores outputs in a loop within a loop, which would copy all of them each time."""
    told = []

    def fits(jaxpr, repeated):
        told.append((jaxprs.largest_copy(jaxpr) > 0, repeated))
        return False

    def repeat(x, y):
        return jax.lax.fori_loop(0, 2, lambda i, z: filled(z, y), x)

    shapes = [jax.ShapeDtypeStruct((9,), float)] * 2
    rule = RULE._replace(fits=fits, size=lambda equation: 1, few=1, together=0)
    functions.as_functions(jax.make_jaxpr(repeat)(*shapes), rule)
    # The whole and the loop around it once, and again the loop inside.
    assert told[:2] == [(True, False)] * 2
    assert (True, True) in told[2:]


class Pair(eqx.Module):
    one: jax.Array
    two: str = eqx.field(static=True, default="two")


def test_a_module_is_made_of_its_fields():
    made = compat.make_module(Pair, one=jnp.ones(2), two="two")
    called = Pair(jnp.ones(2))
    assert jax.tree.structure(made) == jax.tree.structure(called)
    assert eqx.tree_equal(made, called)
    assert eqx.tree_equal(jax.tree.map(lambda x: x, made), called)


@pytest.mark.instant
def test_equations_that_no_result_needs_are_left_out():
    closed = jax.make_jaxpr(lambda x, y: (jnp.sin(x), jnp.linalg.eigh(y)[0])[0])(
        1.0, jax.ShapeDtypeStruct((2, 2), float)
    )
    jaxpr, used = compat.without_unused(closed)
    assert [equation.primitive.name for equation in jaxpr.eqns] == ["sin"]
    assert used == [True, False]


def test_derivatives_in_forward_mode_alone():
    def doubled(x):
        return 2 * compat.forward_only("forward, please", x)[0]

    x = jnp.arange(3.0)
    assert jnp.all(jax.jit(jax.vmap(doubled))(x) == 2 * x)
    assert jnp.all(jax.jacfwd(doubled)(x) == 2 * jnp.eye(3))
    # In reverse mode it is refused before anything is taken apart, of which the values are a part.
    for reverse in (jax.grad, lambda f: functools.partial(jax.linearize, f)):
        with pytest.raises(ValueError, match="forward, please"):
            reverse(lambda x: jnp.sum(doubled(x)))(x)
    # What is known where JAX takes a program apart is no part of the derivative.
    scaled = jax.checkpoint(lambda x, y: x * doubled(y))
    assert jax.grad(scaled)(1.0, 3.0) == 6
