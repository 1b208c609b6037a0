"""Systems written as FMUs, in another tool: its checks, its runs, and wrong uses."""

import ctypes
import functools
import subprocess
import zipfile
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from test_driven_reduction import swung
from test_drives import shortened
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax.export import equations
from romjax.export import library as libraries
from romjax.export.description import Variables
from romjax.export.leaving import model_of

fmpy = pytest.importorskip("fmpy")
fmi3 = pytest.importorskip("fmpy.fmi3")
validate_fmu = pytest.importorskip("fmpy.validation").validate_fmu

TS = np.linspace(0.0, 1.0, 101)
# Required: co-simulation against `simulate` at a hundredth of its tolerance, and the importer's own
# method in tolerances; derivatives as shares of the largest.
COSIMULATED, EXCHANGED, DERIVED = 1e-8, 100, 1e-13
TOLERANCE, TIGHT = 1e-9, 1e-11
STRICT = ("-std=c11", "-pedantic", "-Wall", "-Wno-unused-parameter", "-Werror")


def bar_of(mass, length):
    return rj.RigidBody("bar", mass, mass * length**2 / 12, position=(length / 2, 0.0))


def pendulum(mass, length, force=0.0):
    """A bar, pushed by a force and by a torque that begins and ends at corners of its signal."""
    bar = bar_of(mass, length)
    hinge = rj.Revolute(bar.at((-length / 2, 0.0)), rj.ground.at(), name="hinge")
    kick = rj.Torque(bar.at(), rj.Table([0.0, 0.3, 0.4, 0.6], [0.0, 0.0, 4.0, 0.0]))
    push = rj.Force(bar.at(), (1.0, 0.5), rj.Constant(force))
    return rj.assemble(rj.Scene([bar], [hinge], [rj.Gravity((0.0, -9.81)), kick, push]))


GIVEN = {
    "inputs": {"push": rj.Force(bar_of(1.0, 1.0).at(), (1.0, 0.5), rj.Constant(1.0))},
    "outputs": {
        "bar.x": "bar.x",
        "rise": "bar.y'",
        "away": rj.quantity.Gap(bar_of(1.0, 1.0).at((0.3, 0.0)), rj.ground.at()),
    },
    "parameters": {"mass": 1.0, "length": 1.0},
}


class Unpacked:
    """An FMU with the references of its variables, and instances of it."""

    def __init__(self, file, folder):
        self.file, self.folder = str(file), str(folder)
        self.description = fmpy.read_model_description(self.file)
        fmpy.extract(self.file, self.folder)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}

    def instance(self, kind=fmi3.FMU3Slave):
        found = kind(
            guid=self.description.instantiationToken,
            unzipDirectory=self.folder,
            modelIdentifier=self.description.modelName,
            instanceName="one",
        )
        found.instantiate()
        return found


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bar")
    made = rj.export.fmu(pendulum, folder / "bar.fmu", **GIVEN, name="bar")
    return made, Unpacked(made.path, folder / "unpacked")


@pytest.fixture(scope="module")
def references(bar):
    return bar[1].references


def errors(file, names, usual, kind, **settings):
    """The largest errors of some outputs of an FMU at TIGHT or as it is asked."""
    given = {"relative_tolerance": TOLERANCE, "record_events": False, **settings}
    found = fmpy.simulate_fmu(
        file, fmi_type=kind, stop_time=1.0, output_interval=0.01, output=names, **given
    )
    assert_close(found["time"], TS, IDENTITY)
    return max(np.max(np.abs(found[name] - np.asarray(usual[name]))) for name in names)


@pytest.mark.slow
def test_the_description_is_valid(bar):
    made, unpacked = bar
    assert validate_fmu(unpacked.file) == []
    assert made.states == ("bar.x", "bar.y", "bar.phi", "bar.x'", "bar.y'", "bar.phi'")
    variables = {v.name: v for v in unpacked.description.modelVariables}
    assert variables["bar.x"].causality == "output"
    assert float(variables["bar.x"].start) == 0.5
    assert variables["der(bar.phi')"].unit == "rad/s2"
    assert variables["mass"].variability == "tunable"
    assert len(variables) == 1 + 2 * 6 + 1 + 2 + 2
    with zipfile.ZipFile(unpacked.file) as archive:
        names = set(archive.namelist())
    assert {"sources/bar.c", "sources/buildDescription.xml"} < names
    assert f"binaries/{made.platform}/bar.so" in names


@pytest.mark.slow
def test_both_kinds_run_as_simulate_does(bar):
    _, unpacked = bar
    run = zoo.run(pendulum(1.0, 1.0), TS, rtol=TIGHT)
    usual = {"bar.x": run["bar.x"], "bar.phi": run["bar.phi"]}
    names = list(usual)
    assert errors(unpacked.file, names, usual, "CoSimulation") <= COSIMULATED
    exchanged = errors(unpacked.file, names, usual, "ModelExchange", solver="CVode")
    assert exchanged <= EXCHANGED * TOLERANCE


@pytest.mark.slow
def test_a_stiff_reduced_and_a_stiff_full_model_run(tmp_path):
    """By Rodas5P, and with what the model stands for as outputs."""
    system = zoo.system(zoo.cart_pendulum)
    rom = rj.reduce(system, rj.pod(zoo.motion(zoo.cart_pendulum), rank=3), rj.Minimal())
    for each in (system, rom):
        made = rj.export.fmu(each, tmp_path / "cart.fmu", name="cart")
        assert validate_fmu(str(made.path)) == []
        assert ("model_linear" in made.operations) == (each is system)
        run = rj.simulate(each, TS, rtol=TIGHT, audit=False, max_steps=1_000_000)
        names = ["cart.x", "pendulum.phi"]
        usual = {name: run[name] for name in names}
        assert errors(str(made.path), names, usual, "CoSimulation") <= COSIMULATED


@pytest.mark.slow
def test_a_model_that_starts_later_begins_then(tmp_path):
    """Of a driven one the start holds at that time, at which the default experiment begins, and the
    example in C.
    """
    _, system, rom = swung()
    truth = zoo.run(system, np.linspace(0.0, 1.0, 51))
    later = rom.starting_at(truth.q[20], truth.v[20], truth.t[20])
    made = rj.export.fmu(later, tmp_path / "arm.fmu", outputs=["bar2.phi"])
    assert validate_fmu(str(made.path)) == []
    given = {"stop_time": 1.0, "output_interval": 0.02, "relative_tolerance": TOLERANCE}
    found = fmpy.simulate_fmu(str(made.path), output=["bar2.phi"], record_events=False, **given)
    assert_close(found["time"], np.asarray(truth.t[20:]), IDENTITY)
    assert_close(found["bar2.phi"], np.asarray(truth["bar2.phi"][20:]), COSIMULATED)
    rj.export.c(later, tmp_path / "c", outputs=["bar2.phi"])
    subprocess.run(["make", "-s", "main"], cwd=tmp_path / "c", check=True, capture_output=True)
    done = subprocess.run(
        ["./main", "0.6", "1e-3"], cwd=tmp_path / "c", check=True, capture_output=True, text=True
    )
    rows = np.array([[float(x) for x in line.split(",")] for line in done.stdout.split()])
    assert_close(rows[[0, -1], 0], [0.4, 1.0], SOLVED)
    assert_close(rows[[0, -1], 1], np.asarray(truth["bar2.phi"])[[20, -1]], SOLVED)


@pytest.mark.slow
def test_joints_of_a_small_mechanism_that_come_apart_are_told(tmp_path):
    """By what it is large, and not by a metre."""
    from fmpy.fmi1 import FMICallException

    given = {"stabilization": rj.Baumgarte(alpha=12.0, beta=36.0), "name": "line"}
    made = rj.export.fmu(shortened(1e-3), tmp_path / "line.fmu", **given)
    one = Unpacked(made.path, tmp_path / "unpacked").instance()
    one.enterInitializationMode()
    one.exitInitializationMode()
    one.doStep(0.0, 0.4)
    with pytest.raises(FMICallException):
        one.doStep(0.4, 0.6)
    one.terminate()
    one.freeInstance()


@functools.cache
def bent_cart():
    """A local model of the cart."""
    system = zoo.system(zoo.cart_pendulum)
    return rj.reduce(system, rj.pod(zoo.motion(zoo.cart_pendulum), rank=5), rj.Local())


@pytest.mark.slow
def test_regions_are_judged_as_far_as_states_tell(tmp_path):
    """Of local and of hyper-reduced models too."""
    chain = zoo.system(zoo.bars)
    hyper = rj.reduce(chain, rj.pod(zoo.motion(zoo.bars, end=0.5), rank=2), rj.HyperReduced())
    for rom in (bent_cart(), hyper):
        made = rj.export.fmu(rom, tmp_path / "model.fmu", binary=False)
        assert "model_flags" in made.operations
        for far, wanted in ((0.0, 0), (1e3, int(rj.Flag.OUTSIDE_TRAINING))):
            x = np.concatenate([np.asarray(rom.q0) + far, np.asarray(rom.v0)])
            flags = int(judged(rom, x)["flags"])
            assert flags & int(rj.Flag.OUTSIDE_TRAINING) == wanted


@eqx.filter_jit
def judged(rom, x):
    return equations.flags(rom, jnp.zeros(()), x, jnp.asarray(1e-6))


def test_coordinates_of_a_reduced_model_have_names_of_their_own():
    """Of a local one some are called as those of its bodies, which are outputs."""
    rom = bent_cart()
    held = rj.Baumgarte(alpha=12.0, beta=36.0)
    found = Variables.of(model_of("test", rom, {}, None, {}, held, "cart"), "cart")
    assert {"own.cart.phi", "own.cart.phi'"} < {*found.states}
    assert {"cart.phi", "own.cart.phi", "own.cart.phi'"} < {x.name for x in found.variables}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_derivatives_are_exact(bar, references, kind):
    _, unpacked = bar
    model = model_of("test", pendulum, *GIVEN.values(), "default", "bar")
    x = np.array([0.5, 0.1, -0.2, 0.3, -0.1, 0.4])
    u, p = np.array([0.7]), np.array([1.3, 1.1])

    def both(t, x, u, p):
        return jnp.concatenate([model.rates(t, x, u, p), model.measured(t, x, u, p)])

    at = np.asarray(0.35), x, u, p
    jacobians = jax.jit(jax.jacfwd(both, argnums=(1, 2, 3)))(*at)
    wanted = np.concatenate(jacobians, axis=1)
    one = unpacked.instance(fmi3.FMU3Slave if kind == "CoSimulation" else fmi3.FMU3Model)
    one.enterInitializationMode(startTime=0.35)
    states = [references[name] for name in model_names(model)]
    knowns = [*states, references["push"], references["mass"], references["length"]]
    one.setFloat64(knowns, [*x, *u, *p])
    unknowns = [references[f"der({name})"] for name in model_names(model)]
    unknowns += [references[name] for name in GIVEN["outputs"]]
    columns = [one.getDirectionalDerivative(unknowns, knowns, row) for row in np.eye(9)]
    rows = [one.getAdjointDerivative(unknowns, knowns, row, nSensitivity=9) for row in np.eye(9)]
    one.freeInstance()
    largest = np.max(np.abs(wanted))
    assert_close(np.array(columns).T, wanted, DERIVED, scale=largest)
    assert_close(np.array(rows), wanted, DERIVED, scale=largest)


def model_names(model):
    labels = [coordinate.label for coordinate in model.nominal.structure.coordinates]
    return [*labels, *(f"{label}'" for label in labels)]


def step(one, start, end, count=50):
    for t in np.linspace(start, end, count + 1)[:-1]:
        one.doStep(t, (end - start) / count)


@pytest.mark.slow
def test_inputs_and_parameters_that_change_make_a_new_scene(bar, references):
    """Before the run, where the start follows a length, and within it; and from a kept state."""
    _, unpacked = bar
    one = unpacked.instance()
    mass, length, push, x = (references[name] for name in ("mass", "length", "push", "bar.x"))
    one.setFloat64([mass, length, push], [1.7, 1.2, 0.8])
    one.enterInitializationMode(tolerance=1e-10)
    one.exitInitializationMode()
    assert one.getFloat64([x]) == [0.6]
    step(one, 0.0, 0.5)
    kept = one.getFMUState()
    states = [references[name] for name in ("bar.x", "bar.y", "bar.phi")]
    first = zoo.run(pendulum(1.7, 1.2, 0.8), np.array([0.0, 0.5]), rtol=TIGHT)
    assert_close(np.array(one.getFloat64(states)), np.asarray(first.q[-1]), COSIMULATED)
    found = []
    for through_bytes in (False, True):
        one.setFloat64([mass, push], [2.5, -3.0])
        step(one, 0.5, 1.0)
        found.append(one.getFloat64(states))
        if through_bytes:
            kept = one.deserializeFMUState(one.serializeFMUState(kept))
        one.setFMUState(kept)
        assert one.getFloat64([mass, push]) == [1.7, 0.8]
    assert found[0] == found[1]
    settings = {"q0": first.q[-1], "v0": first.v[-1], "rtol": TIGHT}
    second = zoo.run(pendulum(2.5, 1.2, -3.0), np.array([0.5, 1.0]), **settings)
    assert_close(np.array(found[0]), np.asarray(second.q[-1]), COSIMULATED)
    one.freeFMUState(kept)
    one.terminate()
    one.freeInstance()


@pytest.mark.slow
def test_casadi_runs_it_with_derivatives(bar):
    """A second tool, whose own method takes the steps, at inputs and parameters of its own."""
    casadi = pytest.importorskip("casadi", minversion="3.7")
    system = casadi.DaeBuilder("bar", bar[1].folder)
    names = [system.x(), system.u(), system.p(), system.y()]
    model = model_of("test", pendulum, *GIVEN.values(), "default", "bar")
    assert names == [[*model_names(model)], ["push"], ["mass", "length"], [*GIVEN["outputs"]]]
    at = np.array([0.6, 0.1, -0.2, 0.3, -0.1, 0.4]), np.array([0.7]), np.array([1.3, 1.1])
    rates, values = system.create("f", ["x", "u", "p"], ["ode", "y"])(*at)
    assert_close(rates.full()[:, 0], np.asarray(jax.jit(model.rates)(0.0, *at)), SOLVED, scale=10.0)
    assert_close(values.full()[:, 0], np.asarray(jax.jit(model.measured)(0.0, *at)), IDENTITY)
    found = system.create("j", ["x", "u", "p"], ["jac_ode_x", "jac_ode_u"])(*at)
    wanted = jax.jit(jax.jacfwd(model.rates, (1, 2)))(0.0, *at)
    for one, other in zip(found, wanted, strict=True):
        assert_close(one.full(), np.asarray(other), SOLVED, scale=100.0)
    t, x = casadi.MX.sym("t"), casadi.MX.sym("x", 6)
    rate = system.create("g", ["t", "x", "u", "p"], ["ode"])(t, x, 0.5, [1.3, 1.0])
    settings = {"reltol": TOLERANCE, "abstol": TOLERANCE}
    step = casadi.integrator("s", "cvodes", {"t": t, "x": x, "ode": rate}, 0.0, 0.3, settings)
    end = step(x0=model.start())["xf"].full()[:3, 0]
    run = zoo.run(pendulum(1.3, 1.0, 0.5), np.array([0.0, 0.3]), rtol=TIGHT)
    assert_close(end, np.asarray(run.q[-1]), EXCHANGED * TOLERANCE)


@pytest.mark.slow
def test_corners_of_signals_are_events_in_time(bar):
    one = bar[1].instance(fmi3.FMU3Model)
    one.enterInitializationMode(startTime=0.0)
    one.exitInitializationMode()
    assert one.updateDiscreteStates()[-2:] == (True, 0.3)
    one.enterContinuousTimeMode()
    one.setTime(0.6)
    one.enterEventMode()
    assert one.updateDiscreteStates()[-2] is False
    one.freeInstance()


@pytest.mark.slow
def test_its_sources_build(bar, tmp_path):
    """By the tool, and without a warning against the headers of the standard."""
    from fmpy.build import build_platform_binary

    _, unpacked = bar
    folder = tmp_path / "again"
    fmpy.extract(unpacked.file, str(folder))
    (library,) = folder.glob("binaries/*/*")
    library.unlink()
    (tmp_path / "build").mkdir()
    build_platform_binary(folder, tmp_path / "build")
    run = zoo.run(pendulum(1.0, 1.0), TS, rtol=TIGHT)
    assert errors(str(folder), ["bar.x"], {"bar.x": run["bar.x"]}, "CoSimulation") <= COSIMULATED
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = [*STRICT, "-I", str(headers), "-include", "fmi3Functions.h", "-fsyntax-only"]
    subprocess.run(["cc", *flags, str(folder / "sources" / "bar.c")], check=True)


# Wrong uses: an error each, and the instance goes on.

NAN, X, DX, U, P, Y = float("nan"), 1, 7, 13, 14, 16
ADDRESS = ctypes.c_void_p(12345)
WRONG = {
    "before": [
        lambda one: one.getFloat64([X]),
        lambda one: one.doStep(0.0, 0.1),
        lambda one: one.exitInitializationMode(),
        lambda one: one.terminate(),
        lambda one: one.setFloat64([99], [1.0]),
        lambda one: one.setFloat64([X], [NAN]),
        lambda one: one.setFloat64([X], [1.0, 2.0]),
        lambda one: one.setFloat64([DX], [1.0]),
        lambda one: one.setFloat64([Y], [1.0]),
        lambda one: one.setFloat64([0], [1.0]),
        lambda one: one.setInt32([X], [1]),
        lambda one: one.enterInitializationMode(tolerance=-1.0),
        lambda one: one.enterInitializationMode(startTime=NAN),
        lambda one: one.enterInitializationMode(startTime=1.0, stopTime=0.5),
        lambda one: one.enterConfigurationMode(),
        lambda one: one.setFMUState(ADDRESS),
        lambda one: one.setDebugLogging(True, ["colours"]),
    ],
    "stepping": [
        lambda one: one.enterInitializationMode(),
        lambda one: one.setFloat64([X], [0.3]),
        lambda one: one.getFloat64([4_000_000_000]),
        lambda one: one.getFloat64([X], nValues=2),
        lambda one: one.getBoolean([X]),
        lambda one: one.doStep(0.0, -0.1),
        lambda one: one.doStep(0.0, NAN),
        lambda one: one.doStep(0.4, 0.1),
        lambda one: one.doStep(0.0, 3.0),
        lambda one: one.enterEventMode(),
        lambda one: one.enterStepMode(),
        lambda one: one.getDirectionalDerivative([X + 90], [X], [1.0]),
        lambda one: one.getDirectionalDerivative([DX], [DX], [1.0]),
        lambda one: one.getDirectionalDerivative([DX], [X], [1.0, 2.0]),
        lambda one: one.getAdjointDerivative([DX, Y], [X], [1.0, 1.0]),
        lambda one: one.deserializeFMUState(b"nothing of ours"),
        lambda one: one.getOutputDerivatives([Y], [1]),
    ],
}


@pytest.mark.slow
def test_wrong_uses_are_errors_and_crash_nothing(bar, capsys):
    from fmpy.fmi1 import FMICallException

    _, unpacked = bar
    one = unpacked.instance()
    for use in WRONG["before"]:
        with pytest.raises(FMICallException):
            use(one)
    one.setFloat64([X], [3.0])
    one.enterInitializationMode(stopTime=2.0)
    with pytest.raises(FMICallException):
        one.exitInitializationMode()
    one.reset()
    one.enterInitializationMode(stopTime=2.0)
    one.exitInitializationMode()
    for use in WRONG["stepping"]:
        with pytest.raises(FMICallException):
            use(one)
    one.doStep(0.0, 0.1)
    assert one.getFloat64([0]) == [0.1]
    # Nothing at all, and a token of another model.
    library = one.dll
    for name in ("fmi3Reset", "fmi3Terminate", "fmi3ExitInitializationMode"):
        assert getattr(library, name)(None) == fmi3.fmi3Error
    library.fmi3FreeInstance(None)
    silent = fmi3.fmi3LogMessageCallback()
    exchange = library.fmi3InstantiateModelExchange
    exchange.restype = ctypes.c_void_p
    assert exchange(b"one", b"{other}", None, False, False, None, silent) is None
    one.freeInstance()


@pytest.mark.slow
def test_sources_alone_need_no_compiler(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    libraries.compiler.cache_clear()
    system = zoo.system(zoo.bar)
    try:
        with pytest.raises(rj.InputError, match="apt install gcc"):
            rj.export.fmu(system, tmp_path / "bar.fmu")
        assert list(tmp_path.iterdir()) == []
        made = rj.export.fmu(system, tmp_path / "bar.fmu", binary=False)
    finally:
        libraries.compiler.cache_clear()
    assert made.platform is None
    assert made.path.stat().st_size > 1000


def test_names_are_told_apart(tmp_path):
    given = {"inputs": {"bar1.x": lambda t, q, v: q}, "stabilization": rj.Baumgarte(1.0, 1.0)}
    with pytest.raises(rj.InputError, match=r"several variables of the name 'bar1\.x'"):
        rj.export.fmu(zoo.system(zoo.bar), tmp_path / "bar.fmu", **given)


def test_contacts_are_refused(tmp_path):
    with pytest.raises(rj.InputError, match="where contacts begin"):
        rj.export.fmu(rj.assemble(rj.gallery.bouncing_ball()), tmp_path / "ball.fmu")
