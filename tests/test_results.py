"""Results that travel: runs and sweeps as datasets and netCDF files, tables as data frames."""

import dataclasses
import subprocess
import sys

import diffrax
import jax
import motions
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY

import romjax as rj
from romjax.assembly.disassemble import disassemble
from romjax.common import compat
from romjax.common.partition import Partitioned
from romjax.integrate.derived import LazyQuantities
from romjax.integrate.error_bar import ErrorBar
from romjax.integrate.status import REMEDIES, Status
from romjax.plot.motion.designs import course


def same(one, other):
    """Whether two pytrees of arrays are the same to the bit, types included."""
    ours, theirs = jax.tree.leaves(one), jax.tree.leaves(other)
    assert len(ours) == len(theirs)
    for a, b in zip(map(np.asarray, ours), map(np.asarray, theirs), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def opened(path):
    """A file as xarray reads it, which takes long to import: each process of the tests would."""
    import xarray

    return xarray.open_dataset(path)


def check_same_run(found, run):
    same((found.t, found.q, found.v, found.violation), (run.t, run.q, run.v, run.violation))
    same((found.multipliers, found.metric), (run.multipliers, run.metric))
    same((found.stats, found.status, found.flags), (run.stats, run.status, run.flags))
    same((found.balance, found.branching), (run.balance, run.branching))
    same(found.imbalance, run.imbalance)
    assert found.coordinates == run.coordinates


def made_up(scene, system, rank=None):
    """A motion of a scene that nobody integrated, and that knows its system, full or reduced."""
    run = motions.motion(scene, end=0.1, count=11)
    own = (run.q, run.v) if rank is None else 2 * [np.zeros((11, rank))]
    states = {"t": run.t, "q": own[0], "v": own[1], "chart": None, "stabilization": None}
    derived = compat.make_module(LazyQuantities, parts=Partitioned.of(system), **states)
    return dataclasses.replace(run, derived=derived)


@pytest.fixture(scope="module")
def run():
    return made_up(zoo.cart_pendulum(), zoo.system(zoo.cart_pendulum))


@pytest.fixture(scope="module")
def pendulum():
    return zoo.system(zoo.bar)


def swing(system, max_steps=1000, stop=-9.0):
    """An audited run with dense output and events, which gives up or stops early where told to."""
    height = rj.quantity.Coordinate("bar1.y")
    events = [rj.Crossing(height, -0.1), rj.Stop(height, stop)]
    settings = {"events": events, "dense": True, "audit": True, "throw": max_steps == 1000}
    return zoo.run(system, np.linspace(0.0, 1.0, 5), max_steps=max_steps, **settings)


@pytest.fixture(scope="module")
def swung(pendulum):
    return swing(pendulum)


def test_what_a_run_remembers_is_of_no_program():
    """Asked for while JAX traces, the metric belongs to that program; the run outlives it."""
    alone = zoo.run(rj.assemble(zoo.bar(mass=1.5)), np.linspace(0.0, 1.0, 5))
    inside = jax.jit(lambda factor: factor * alone.metric)(1.0)
    np.testing.assert_array_equal(alone.metric, inside)


def test_a_run_is_the_same_to_the_bit(run, tmp_path):
    run.save(tmp_path / "run.nc")
    found = rj.load(tmp_path / "run.nc")
    check_same_run(found, run)
    assert found.solver == run.solver
    assert found.summary() == run.summary()
    assert rj.compare(run, found).error == 0


def test_a_summary_says_how_it_went(pendulum, swung):
    """Steps, constraints, energy and flags; of several runs, which is the first that failed."""
    words = swung.summary()
    steps, method = int(swung.stats.num_steps), swung.solver_name
    assert words.startswith(f"success: {steps} steps of {method} to t = 1 s; constraints hold to ")
    assert f"{float(np.max(swung.violation)):.1e}; energy balances to " in words
    doubtful = dataclasses.replace(swung, flags=np.asarray(int(rj.Flag.CAPPED)))
    assert doubtful.summary().startswith(words + "; modes above the cap vibrate")
    wrong = ErrorBar(np.asarray(0.06), "local, 8 modes")
    told = dataclasses.replace(swung, flags=wrong.flags, bar=wrong).summary()
    assert told == f"{words}; {wrong.describe()}"
    both = dataclasses.replace(swung, status=np.array([0, int(rj.Status.MAX_STEPS)]))
    assert both.summary().startswith("1 of 2 runs succeeded; lane 1: MAX_STEPS: ")
    nested = dataclasses.replace(swung, status=int(rj.Status.MAX_STEPS) * np.eye(2, 3, 2, int))
    assert nested.summary().startswith("5 of 6 runs succeeded; lane 0, 2: MAX_STEPS: ")


def test_a_run_that_stopped_is_kept_and_drawn(pendulum, tmp_path):
    """Its outputs after the stop are all at the time of that."""
    stopped = swing(pendulum, stop=-0.3)
    assert stopped.t[-2] == stopped.t[-1] < 1.0
    stopped.save(tmp_path / "run.nc")
    check_same_run(rj.load(tmp_path / "run.nc"), stopped)
    same(course(stopped, np.asarray(stopped.t)), np.asarray(stopped.q))


def test_what_the_norm_of_errors_hides(run, tmp_path):
    """A deflection that is small beside the motion, and wrong; not one below the tolerance."""
    q, start = np.asarray(run.q), np.asarray(run.q[0])
    bends = np.array([label.startswith("pendulum.q") for label in run.labels])
    small, large = (start + np.where(bends, size, 1.0) * (q - start) for size in (1e-3, 1.3e-3))
    truth, wrong = (dataclasses.replace(run, q=x) for x in (small, large))
    report = rj.compare(truth, wrong)
    assert report.groups == (
        *("position of cart", "angle of cart"),
        *("position of pendulum", "angle of pendulum", "deflection of pendulum"),
    )
    assert report.error <= 1e-3
    assert_close(report.per_group, [0.0, 0.0, 0.0, 0.0, 0.3], IDENTITY)
    assert report.hidden() == "deflection of pendulum is wrong by 30 %"
    assert not rj.compare(truth, truth).hidden()
    loose = dataclasses.replace(wrong, stats=dataclasses.replace(run.stats, rtol=1e-4))
    assert rj.compare(truth, loose).per_group[-1] <= 0.1
    # As the estimate of a corrected run.
    bar = ErrorBar(report.error, "local, 2 modes", report.per_group, report.groups)
    corrected = dataclasses.replace(run, bar=bar)
    assert corrected.summary().endswith(f"(local, 2 modes), but {report.hidden()}")
    assert report.hidden() in corrected.warnings()
    corrected.save(tmp_path / "run.nc")
    assert rj.load(tmp_path / "run.nc").summary() == corrected.summary()
    turned = ErrorBar(report.error, "local, 2 modes", np.array([5.0]), ("angle of rod",))
    assert turned.hidden() == "angle of rod is wrong by 5 times its motion"
    # Of several runs at once.
    two = jax.tree.map(lambda *x: np.stack(x), rj.compare(truth, truth), report)
    assert two.hidden() == f"lane 1: {report.hidden()}"
    lanes = ErrorBar(two.error, "local, 2 modes", two.per_group, two.groups)
    assert lanes.hidden() == two.hidden()
    assert lanes.describe().endswith(f"; lane 1: {bar.describe()}")


def test_the_names_of_points_stay():
    """In the scene of a system, as runs and files have it, each at its own body."""
    bar = rj.RigidBody("bar", 1.0, 0.1, points={"pin": (0.2, 0.1)})
    scene = rj.Scene([rj.RigidBody("block", 1.0, 0.1), bar], [], [rj.Gravity()])
    again = disassemble(rj.assemble(scene))
    same(again.bodies[1].at("pin"), bar.at("pin"))


@pytest.mark.slow
def test_the_scene_of_a_run_is_that_of_its_system(swung):
    """Assembled again, it makes the same motion to the bit, and recompiles nothing."""
    system = rj.assemble(swung.scene)
    assert system.structure == swung.system.structure
    again = swing(system)
    same((again.q, again.v, again.multipliers), (swung.q, swung.v, swung.multipliers))


def test_a_file_simulates_the_same_scene_to_the_bit(swung, tmp_path):
    """From its text alone, by the same programs."""
    swung.save(tmp_path / "run.nc")
    found = rj.load(tmp_path / "run.nc")
    again = swing(found.system)
    check_same_run(again, swung)
    assert again.scene == found.scene
    found.save(tmp_path / "again.nc")
    assert opened(tmp_path / "again.nc").scene == found.to_xarray().scene


def test_a_scene_that_cannot_be_made_leaves_the_numbers(run, tmp_path):
    """As where a part of one's own was not imported."""
    data = run.to_xarray()
    data.attrs["scene"] = data.attrs["scene"].replace("RigidBody", "Boulder")
    data.to_netcdf(tmp_path / "run.nc")
    with pytest.warns(UserWarning, match=r"no scene here.*\n?.*Boulder"):
        found = rj.load(tmp_path / "run.nc")
    check_same_run(found, run)
    for ask in (lambda: found.scene, found.animate):
        with pytest.raises(
            rj.InputError, match="transformation of JAX, or saved without its scene"
        ):
            ask()


def test_a_file_says_what_it_is_by_functions_of_xarray(run, tmp_path):
    """Dimensions, units, names and words."""
    run.save(tmp_path / "run.nc", tip=(np.zeros((11, 2)), "m"))
    with opened(tmp_path / "run.nc") as d:
        assert d["q"].dims == ("time", "coordinate")
        units = [d[name].units for name in ("q", "v", "time", "tip")]
        assert units == ["m or rad or kg^1/2 m", "m/s or rad/s or kg^1/2 m/s", "s", "m"]
        assert d["multipliers"].dims == ("time", "constraint")
        assert d["coordinate"].values[:3].tolist() == ["cart.x", "cart.y", "cart.phi"]
        assert d["coordinate_unit"].values[:3].tolist() == ["m", "m", "rad"]
        rows = ["joint 'rail'", "joint 'cart angle'", "joint 'hinge' 1", "joint 'hinge' 2"]
        assert d["constraint"].values.tolist() == rows
        assert d.status_words.partition(":")[0] == "success"
        assert (d.solver, d.warnings) == (run.solver_name, "none")
        assert d["status"].flag_meanings.split()[int(d["status"])] == "success"
        assert (d["tip"].dims, d.romjax_version) == (("time", "tip_1"), rj.__version__)


@pytest.mark.slow
def test_a_file_is_read_without_romjax(run, tmp_path):
    """In a process that does not import it."""
    run.save(tmp_path / "run.nc")
    code = "import sys, xarray; d = xarray.load_dataset('run.nc'); print('romjax' in sys.modules)"
    code += "; print(*d['q'].dims, d['q'].shape, d.solver, sep=', ')"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == [
        "False",
        f"time, coordinate, {run.q.shape}, {run.solver_name}",
    ]


def test_values_are_found_by_name(run):
    data = run.to_xarray()
    same(data["q"].sel(coordinate="pendulum.phi").values, run["pendulum.phi"])
    same(
        data["multipliers"].sel(constraint="joint 'rail'").values, np.asarray(run.multipliers)[:, 0]
    )


def test_a_measurement_has_all_its_quantities(pendulum, swung):
    tip = rj.measure(pendulum, swung, rj.Marker("bar1", (0.5, 0.0), 0.0))
    data = swung.to_xarray(tip=tip, joints=rj.joint_forces(pendulum, swung))
    same(data["tip.velocity"].sel(axis="y").values, np.asarray(tip.velocity)[:, 1])
    assert data["tip.acceleration"].units == "m/s^2"
    assert data["tip.angular_velocity"].units == "rad/s"
    assert data["joints.Revolute(bar1, ground).force"].dims == ("time", "axis")
    assert data["joints.Revolute(bar1, ground).torque"].units == "N m"
    energy = swung.to_xarray(energy=rj.energy(pendulum, swung))["energy.total"]
    assert (energy.dims, energy.units) == (("time",), "J")
    with pytest.raises(rj.InputError, match=r"half is an array of shape \(3,\).*5 outputs"):
        swung.to_xarray(half=np.zeros(3))


@pytest.mark.parametrize("name", ["estimate", "group", "q", "time", "column", "event_time"])
def test_a_measured_quantity_takes_no_name_of_the_file(run, name):
    with pytest.raises(rj.InputError, match=f"'{name}' is what files of runs call something"):
        run.to_xarray(**{name: np.zeros(len(run.t))})


def test_an_older_file_with_a_measured_estimate_has_no_error_bar(run, tmp_path):
    data = run.to_xarray().assign(estimate=("time", np.zeros(len(run.t))))
    data.to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    assert rj.load(tmp_path / "run.nc").bar is None


def test_a_measurement_in_space_has_a_rotation_for_its_angle(run):
    class Measured:
        position, angular_velocity = np.zeros((11, 3)), np.ones((11, 3))
        rotation = np.zeros((11, 3, 3))

        @property
        def angle(self):
            raise AssertionError("in space there is none")

    data = run.to_xarray(tip=Measured())
    assert data["tip.position"].dims == data["tip.angular_velocity"].dims == ("time", "axis")
    assert data["axis"].values.tolist() == ["x", "y", "z"]
    assert data["tip.rotation"].shape == (11, 3, 3)
    assert "tip.angle" not in data


def test_reduced_runs_say_so(pendulum, tmp_path):
    """The numbers are physical, the scene is that of the full system."""
    turned = rj.Basis.from_modes(np.array([[0.0], [0.5], [1.0]]), pendulum.q0)
    rom = rj.reduce(pendulum, turned, "minimal")
    approx = made_up(zoo.bar(), rom, rank=1)
    approx.save(tmp_path / "rom.nc")
    found = rj.load(tmp_path / "rom.nc")
    check_same_run(found, approx)
    assert opened(tmp_path / "rom.nc").model == f"reduced: {rom.summary}"
    assert approx.system.summary == rom.summary
    assert rj.assemble(approx.scene).structure == found.system.structure == pendulum.structure


def test_failed_runs_events_and_dense_output(pendulum, swung, tmp_path):
    """A run that failed keeps what it has; of dense output, only what `at` says is missing."""
    path = tmp_path / "run.nc"
    swung.save(path)
    found = rj.load(path)
    check_same_run(found, swung)
    same(found.events.times(), swung.events.times())
    assert found.events.count == swung.events.count > 0
    with pytest.raises(rj.InputError, match="simulate it with dense=True"):
        found.at([0.1])
    failed = swing(pendulum, max_steps=3)
    assert failed.status == Status.MAX_STEPS
    assert int(failed.flags) == 0  # what it has not got to is no motion below its tolerances
    for seen in (failed.q, failed.imbalance[:, None]):
        assert np.array_equal(np.all(np.isnan(seen), axis=1), np.arange(5) > 0)
    failed.save(path)
    check_same_run(rj.load(path), failed)
    assert REMEDIES[Status.MAX_STEPS] in opened(path).status_words


def test_a_method_with_settings_of_its_own_is_asked_for(run, tmp_path):
    other = diffrax.Kvaerno5(root_finder=diffrax.VeryChord(rtol=1e-3, atol=1e-3))
    changed = dataclasses.replace(run, solver_parts=type(run.solver_parts).of(other))
    changed.save(tmp_path / "run.nc")
    with pytest.raises(rj.InputError, match=r"made by Kvaerno5.*solver="):
        rj.load(tmp_path / "run.nc")
    assert rj.load(tmp_path / "run.nc", other).solver == other


@pytest.mark.instant
@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ({}, "was not written by romjax.*xarray.open_dataset"),
        ({"format": "romjax sweep"}, "holds a romjax sweep"),
        ({"format": "romjax run", "format_version": 99}, "version 99.*newer romjax"),
    ],
)
def test_other_files_are_refused(attributes, words, tmp_path):
    import xarray

    xarray.Dataset({"time": ("time", [0.0])}, attrs=attributes).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(rj.InputError, match=f"other.nc.*{words}"):
        rj.load(tmp_path / "other.nc")


def unreadable(_):
    raise RuntimeError("incorrect metadata checksum after all read attempts")


def test_what_is_no_file_is_refused(run, tmp_path, monkeypatch):
    with pytest.raises(rj.InputError, match="there is no file.*run.nc"):
        rj.load(tmp_path / "run.nc")
    (tmp_path / "run.nc").write_text("t,x\n")
    with pytest.raises(rj.InputError, match="no netCDF file.*Trajectory.save"):
        rj.load(tmp_path / "run.nc")
    with monkeypatch.context() as patched:
        patched.setattr("xarray.load_dataset", unreadable)  # as HDF5 does, where a bit has turned
        with pytest.raises(rj.InputError, match="a damaged one.*Trajectory.save"):
            rj.load(tmp_path / "run.nc")
    run.to_xarray().drop_vars("violation").to_netcdf(tmp_path / "part.nc")
    with pytest.raises(rj.InputError, match="part.nc is damaged.*'violation'"):
        rj.load(tmp_path / "part.nc")


def test_another_scene_than_that_of_the_run_is_refused(run, tmp_path):
    with pytest.raises(rj.InputError, match="scene has the coordinates bar1.x, .*run cart.x"):
        run.save(tmp_path / "run.nc", zoo.bar())
    assert not list(tmp_path.iterdir())
    run.save(tmp_path / "run.nc", run.scene)
    check_same_run(rj.load(tmp_path / "run.nc"), run)


def changed(data, **values):
    return data.assign({name: (data[name].dims, value) for name, value in values.items()})


def spoilt(name, index, value):
    """One number of an array is another."""

    def spoil(data):
        values = data[name].values.copy()
        values[index] = value
        return changed(data, **{name: values})

    return spoil


DAMAGES = {
    "turned": (lambda d: d.assign(q=d["q"].T), r"'q' has the dimensions \(coordinate, time\)"),
    "shorter": (
        lambda d: d.assign(v=(("other", "coordinate"), d["v"].values[:-1])),
        r"'v' has the dimensions \(other, coordinate\) instead of \(time, coordinate\)",
    ),
    "another size": (
        lambda d: d.assign(metric=(("coordinate", "column"), d["metric"].values[:, :-1])),
        r"'metric' has the shape \(8, 7\)",
    ),
    "a vector": (lambda d: d.assign(status=("time", np.zeros(11, int))), "'status' has the dim"),
    "texts": (lambda d: d.assign(q=d["q"].astype(str)), "'q' has the type"),
    "mixed": (lambda d: d.assign(v=d["v"].astype(np.float32)), "float32, float64"),
    "NaN": (spoilt("q", (3, 1), np.nan), "'q' holds numbers that are not finite"),
    "infinite": (spoilt("time", -1, np.inf), "'time' holds numbers that are not finite"),
    "back": (spoilt("time", 4, 0.0), "'time' does not increase"),
    "twice the end": (lambda d: d.isel(time=[0, 1, 1]), "'time' does not increase"),
    "empty": (lambda d: d.isel(time=slice(0)), "'time' is empty"),
    "status": (spoilt("status", (), 77), "status is 77, which means nothing"),
    "flags": (spoilt("flags", (), 1 << 20), "flags is 1048576, which means nothing"),
    "steps": (spoilt("num_steps", (), -1), "'num_steps' is negative"),
    "no times": (lambda d: d.drop_vars("time"), "it has no 'time'"),
    "no states": (lambda d: d.drop_vars("q"), "is damaged.*'q'"),
    "constraints": (lambda d: d.isel(constraint=slice(3)), "3 constraints, but its scene has 4"),
    "coordinates": (
        lambda d: d.isel(coordinate=slice(7), column=slice(7)),
        r"coordinates are cart.x, .*, but those of its scene are cart.x",
    ),
    "another scene": (
        lambda d: d.assign_attrs(scene=d.scene.replace("cart", "cork")),
        "those of its scene are cork.x",
    ),
    "version": (lambda d: d.assign_attrs(format_version="one"), "is of version one"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_arrays_that_do_not_fit_are_refused(run, damage, tmp_path):
    """Each other, a run that went well, or the scene."""
    change, words = DAMAGES[damage]
    change(run.to_xarray()).to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    with pytest.raises(rj.InputError, match=f"run.nc.*{words}"):
        rj.load(tmp_path / "run.nc")


def test_numbers_of_a_run_that_failed_may_be_anything(run, tmp_path):
    q = np.asarray(run.q).copy()
    q[5:] = np.nan
    failed = dataclasses.replace(run, q=jax.numpy.asarray(q), status=jax.numpy.asarray(2))
    failed.save(tmp_path / "run.nc")
    same(rj.load(tmp_path / "run.nc").q, q)


@pytest.mark.parametrize("package", ["xarray", "h5netcdf", "h5py"])
def test_what_is_missing_can_be_installed(run, package, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=rf"{package}: pip install 'romjax\[files\]'"):
        run.save(tmp_path / "run.nc")
    with pytest.raises(ImportError, match=rf"{package}: pip install 'romjax\[files\]'"):
        rj.load(tmp_path / "run.nc")


@pytest.fixture(scope="module")
def swept():
    """Runs of a point on a bar with three speeds, the last one impossible, and their ends."""
    ts = np.linspace(0.0, 0.2, 5)

    def swing(parameters):
        system = zoo.point_pendulum(v0=(0.0, parameters["speed"]))
        run = zoo.run(system, ts, solver=diffrax.Tsit5(), dt=0.05, stabilization=None, throw=False)
        return {"run": run, "end": run.q[-1], "speed": run["q2"][-1]}

    return rj.sweep(swing, {"speed": np.array([1.0, 2.0, np.nan])})


def test_a_run_of_a_transformation_knows_no_system(swept):
    runs = swept.values["run"]
    with pytest.raises(rj.InputError, match="within a transformation"):
        _ = runs.scene
    data = runs.to_xarray()
    assert data["q"].dims == ("lane", "time", "coordinate")
    assert list(data["constraint"].values) == ["constraint 1"]


def test_runs_that_are_stacked_have_no_scene_in_common(run):
    """Their numbers would be lists in the text, which no file of a scene has."""
    stacked = jax.tree.map(lambda x: np.stack([np.asarray(x)] * 2), run)
    words = stacked.to_xarray().attrs
    assert "batch" in words["scene_missing"]
    assert "scene" not in words


def test_a_sweep_has_its_parameters_as_coordinates(swept, tmp_path):
    swept.save(tmp_path / "sweep.nc")
    with opened(tmp_path / "sweep.nc") as stored:
        data = stored.load()
    assert data["q"].dims == ("lane", "time", "coordinate")
    np.testing.assert_array_equal(data.coords["speed"], [1.0, 2.0, np.nan])
    np.testing.assert_array_equal(data["q"], swept.values["run"].q)
    np.testing.assert_array_equal(data["end"], swept.values["end"])
    np.testing.assert_array_equal(data["value.speed"], swept.values["speed"])
    np.testing.assert_array_equal(data["time"], swept.values["run"].t[0])
    assert data["status"].values.tolist() == swept.status.tolist()
    assert data["failure"].values.tolist() == ["", "", swept.failures()[2]]
    with pytest.raises(rj.InputError, match=r"holds a romjax sweep.*open_dataset"):
        rj.load(tmp_path / "sweep.nc")
    twice = dataclasses.replace(swept, values=[swept.values["run"]] * 2)
    with pytest.raises(rj.InputError, match="each lane holds 2 runs"):
        twice.to_xarray()


def test_tables_of_errors_and_modes(run, monkeypatch):
    q = np.asarray(run.q) * [1.001, 1.0, 1.5, *np.ones(5)]
    moved = dataclasses.replace(run, q=q)
    report = rj.compare(run, moved)
    table = report.table()
    assert table["coordinate"][0] == "cart.x"
    assert sorted(table["coordinate"]) == sorted(run.labels)
    assert table["error"][0] == report.per_coordinate[0]
    found = rj.Modes(np.array([2.0, 5.0]), np.array([0.1, 0.0]), *4 * [np.zeros(2)])
    same(found.table()["frequency"].to_numpy(), found.frequencies / (2 * np.pi))
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"Comparison.table needs pandas: pip install .*study"):
        report.table()
