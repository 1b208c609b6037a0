"""Systems written as sources of C, built by their own Makefile, against JAX."""

import ctypes
import subprocess

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from native import called
from tolerances import IDENTITY

import romjax as rj
from romjax.export.emit import Emitted
from romjax.system.dynamics import gamma

HELD = rj.Baumgarte(alpha=12.0, beta=36.0)
SHAPES = {"t": (), "x": (6,), "u": (1,), "p": (2,)}


def make(mass, gravity):
    return rj.assemble(zoo.bar(mass=mass, gravity=gravity))


def push(t, q, v):
    return jnp.array([jnp.cos(t), q[0], 0.0])


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    """The bar of the zoo with its mass and gravity as parameters, and what it was written as."""
    folder = tmp_path_factory.mktemp("bar")
    end = zoo.bar().bodies[0].at((0.5, 0.0))
    outputs = {"reach": "bar1.x", "rise": "bar1.y'", "away": rj.quantity.Gap(end, rj.ground.at())}
    made = rj.export.c(
        make,
        folder,
        inputs={"push": push},
        outputs=outputs,
        parameters={"mass": 1.0, "gravity": 9.81},
        stabilization=HELD,
        name="bar",
    )
    flags = "CFLAGS=-O1 -Wall -Wextra -Werror -pedantic"
    subprocess.run(["make", "-s", flags], cwd=folder, check=True, capture_output=True)
    return made, ctypes.CDLL(str(folder / "libbar.so"))


def call(code, name, results, *args, **more):
    shapes = {**SHAPES, **{key: np.shape(x) for key, x in more.items()}}
    form = Emitted(f"bar_{name}", "", "", 0, shapes, results)
    return called(code, form, *args, *more.values())


def rates_of(t, x, u, p):
    system = make(*p)
    q, v = x[:3], x[3:]
    push_there = u[0] * push(t, q, v)
    state = system.state(t, q, v)
    a, _ = state.kkt().solve(state.force() + push_there, gamma(system, t, q, v, HELD))
    return jnp.concatenate([v, a])


POINT = (
    np.asarray(0.3),
    np.array([0.4, -0.2, -0.3, 0.1, 0.2, 0.5]),
    np.array([0.7]),
    np.array([1.3, 9.0]),
)


@pytest.mark.slow
def test_functions_and_derivatives(bar):
    made, code = bar
    assert made.states[:4] == ("bar1.x", "bar1.y", "bar1.phi", "bar1.x'")
    assert (made.inputs, made.parameters) == (("push",), ("mass", "gravity"))
    dx = call(code, "f", {"dx": (6,)}, *POINT)["dx"]
    wanted = np.asarray(jax.jit(rates_of)(*POINT))
    assert_close(dx, wanted, IDENTITY, scale=np.max(np.abs(wanted)))
    z = call(code, "lift", {"z": (6,)}, *POINT)["z"]
    np.testing.assert_array_equal(z, POINT[1])
    y = call(code, "outputs", {"y": (3,)}, *POINT)["y"]
    tip = POINT[1][:2] + 0.5 * np.array([np.cos(-0.3), np.sin(-0.3)])
    assert_close(y, np.array([0.4, 0.2, np.hypot(*tip)]), IDENTITY)
    # J, by columns and by rows.
    jacobians = jax.jit(jax.jacfwd(rates_of, argnums=(1, 2, 3)))(*POINT)
    whole = np.concatenate(jacobians, axis=1)
    along = [np.split(row, [6, 7]) for row in np.eye(9)]
    columns = [
        call(code, "f_jvp", {"jv": (6,)}, *POINT, vx=x, vu=u, vp=p)["jv"] for x, u, p in along
    ]
    results = {"wx": (6,), "wu": (1,), "wp": (2,)}
    rows = [
        np.concatenate([*call(code, "f_vjp", results, *POINT, w=w).values()]) for w in np.eye(6)
    ]
    largest = np.max(np.abs(whole))
    assert_close(np.stack(columns, axis=1), whole, IDENTITY, scale=largest)
    assert_close(np.stack(rows), whole, IDENTITY, scale=largest)


@pytest.mark.slow
def test_the_example_runs_as_simulate_does(bar):
    made, _ = bar
    run = zoo.run(make(1.0, 9.81), np.array([0.0, 0.5]), stabilization=HELD)
    for steps in ([], ["1e-3"]):
        done = subprocess.run(
            ["./main", "0.5", *steps], cwd=made.folder, check=True, capture_output=True, text=True
        )
        last = [float(x) for x in done.stdout.splitlines()[-1].split(",")]
        assert last[0] == pytest.approx(0.5, abs=1e-12)
        # The tolerance of the example, which is relative to one.
        assert_close(np.array(last[1]), float(run["bar1.x"][-1]), 1e-6)


@pytest.mark.slow
def test_casadi_takes_it_with_both_derivatives(bar):
    casadi = pytest.importorskip("casadi")
    made, code = bar
    flags = "-std=c99 -pedantic -Wall -Wextra -Werror -Wno-unused-parameter -fPIC -shared"
    command = ["cc", *flags.split(), "-o", "libcasadi_bar.so", "casadi.c", "bar.c", "-lm"]
    subprocess.run(command, cwd=made.folder, check=True)
    library = str(made.folder / "libcasadi_bar.so")
    f, y = (casadi.external(name, library) for name in ("bar_rates", "bar_measured"))
    dx = call(code, "f", {"dx": (6,)}, *POINT)["dx"]
    np.testing.assert_array_equal(np.array(f(*POINT)).ravel(), dx)
    np.testing.assert_array_equal(np.array(y(*POINT)).ravel()[:2], [0.4, 0.2])
    x, u, p = (casadi.MX.sym(name, size) for name, size in (("x", 6), ("u", 1), ("p", 2)))
    rates, given = f(0.3, x, u, p), casadi.vertcat(x, u, p)
    weights = np.arange(1.0, 7.0)
    forward = casadi.Function("jacobian", [x, u, p], [casadi.jtimes(rates, given, np.eye(9))])
    reverse = casadi.gradient(casadi.dot(weights, rates), given)
    reverse = casadi.Function("gradient", [x, u, p], [reverse])
    wanted = np.concatenate(jax.jit(jax.jacfwd(rates_of, argnums=(1, 2, 3)))(*POINT), axis=1)
    largest = np.max(np.abs(wanted))
    assert_close(np.array(forward(*POINT[1:])), wanted, IDENTITY, scale=largest)
    assert_close(
        np.array(reverse(*POINT[1:])).ravel(), weights @ wanted, IDENTITY, scale=10 * largest
    )


@pytest.mark.slow
def test_sanitizers_find_nothing(bar):
    made, _ = bar
    flags = "CFLAGS=-O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all"
    subprocess.run(["make", "-s", "-B", "main", flags], cwd=made.folder, check=True)
    subprocess.run(["./main", "0.1"], cwd=made.folder, check=True, capture_output=True)


@pytest.mark.slow
def test_a_reduced_model_leaves_with_what_it_stands_for(tmp_path):
    """And with CMake, under any optimisation."""
    system = zoo.system(zoo.cart_pendulum)
    rom = rj.reduce(system, rj.pod(zoo.motion(zoo.cart_pendulum), rank=3), rj.Minimal())
    made = rj.export.c(rom, tmp_path)
    assert made.outputs == zoo.motion(zoo.cart_pendulum).labels
    found = []
    for level in ("-O0", "-O3"):
        build = tmp_path / level
        choose = ["cmake", "-S", tmp_path, "-B", build, f"-DCMAKE_C_FLAGS={level}"]
        subprocess.run(choose, check=True, capture_output=True)
        subprocess.run(["cmake", "--build", build], check=True, capture_output=True)
        done = subprocess.run([build / "main", "0.05"], check=True, capture_output=True, text=True)
        found.append([float(x) for x in done.stdout.splitlines()[-1].split(",")])
    run = rj.simulate(rom, np.array([0.0, 0.05]), rtol=1e-10, audit=False)
    for last in found:
        assert_close(np.array(last[1:]), np.asarray(run.q[-1]), 1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"parameters": {"mass": 1.0}}, "whose numbers are frozen"),
        ({"name": "2 bars"}, "letters, digits"),
        ({"outputs": []}, "outputs are empty"),
        ({"inputs": {"push": 3.0}}, "input 'push'"),
        ({"stabilization": rj.Projection()}, "between steps"),
    ],
)
def test_wrong_arguments_are_refused(tmp_path, arguments, words):
    with pytest.raises(rj.InputError, match=words):
        rj.export.c(zoo.system(zoo.bar), tmp_path, **{"stabilization": HELD, **arguments})
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_output_is_named(tmp_path):
    with pytest.raises(rj.InputError, match=r"bar1\.z"):
        rj.export.c(zoo.system(zoo.bar), tmp_path, outputs=["bar1.z"], stabilization=HELD)


def test_a_scene_is_no_system(tmp_path):
    with pytest.raises(rj.InputError, match=r"export\.c: the system"):
        rj.export.c(zoo.bar(), tmp_path)
