"""What a trajectory says of its run: steps, settings, solver, and names of the release before."""

import dataclasses
import pickle
from copy import deepcopy

import diffrax
import jax
import numpy as np
import pytest
import zoo

import romjax as rj
from romjax.common.partition import Partitioned
from romjax.integrate import settings
from romjax.integrate.follow.branching import Branching
from romjax.integrate.statistics import Statistics
from romjax.integrate.status import Status

TS = np.linspace(0.0, 0.2, 5)


@pytest.fixture(scope="module")
def system():
    return zoo.point_pendulum()


@pytest.fixture(scope="module")
def run(system):
    keep = rj.Baumgarte(10.0, 25.0)
    return zoo.run(system, TS, rtol=1e-5, solver=zoo.RODAS5P, stabilization=keep)


def test_a_run_in_a_line(run):
    """Which Python shows at its prompt; while JAX traces, it is shown by its types."""
    named = "Trajectory(5 times, 2 coordinates: {}; success: {} steps of Rodas5P to t = 0.2 s"
    assert repr(run).startswith(named.format(", ".join(run.labels), int(run.stats.num_steps)))
    assert "\n" not in repr(run)
    batch = jax.tree.map(lambda x: np.stack([x, x]), run)
    assert "; 2 of 2 runs succeeded)" in repr(batch)
    seen = []
    jax.eval_shape(lambda x: seen.append(repr(x)), run)
    assert seen[0].startswith("Trajectory(\n")


def test_the_settings_of_a_run(run):
    stats = run.stats
    assert stats.num_steps == stats.num_accepted_steps + stats.num_rejected_steps > 0
    assert (stats.rtol, stats.atol) == (1e-5, 1e-5)
    assert (stats.stabilization.alpha, stats.stabilization.beta) == (10, 25)
    assert stats.fastest_frequency is None


@pytest.mark.parametrize("copy", [lambda x: pickle.loads(pickle.dumps(x)), deepcopy])
def test_a_run_from_another_process(run, copy):
    """It is a run like any other: its method, its system and what follows from both are there."""
    again = copy(run)
    assert again.solver_name == run.solver_name
    assert jax.tree.structure(again.system) == jax.tree.structure(run.system)
    assert np.array_equal(again.multipliers, run.multipliers)
    assert again.warnings() == run.warnings()


def test_numbers_are_printed_as_numbers(run):
    """Those of one run, of several, and while JAX traces."""
    steps = [int(run.stats[f"num_{kind}steps"]) for kind in ("", "accepted_", "rejected_")]
    assert str(run.stats) == repr(run.stats)
    assert "PyTreeDef" not in repr(run)  # of the system, which would fill pages
    assert str(run.stats) == (
        "Statistics(num_steps={}, num_accepted_steps={}, num_rejected_steps={}, rtol=1e-05, "
        "atol=1e-05, fastest_frequency=None, stabilization=Baumgarte(alpha=10.0, beta=25.0))"
    ).format(*steps)
    lanes = Statistics(*3 * [np.arange(20)], rtol=np.float32(0.1))
    assert "num_steps=[ 0,  1, ..., 18, 19]" in repr(lanes)
    assert "rtol=0.1," in repr(lanes)
    branching = Branching(np.asarray(0.5), np.asarray(1.0), np.asarray(2))
    assert repr(branching) == "Branching(ambiguity=0.5, time=1.0, repeated=2)"
    said = []
    jax.eval_shape(lambda x: said.append(repr(Statistics(x, x, x))), np.int64(1))
    assert "num_steps=i64[]" in said[0]


def test_what_does_not_apply_is_none(system):
    """No tolerances in fixed steps; a frequency where something was chosen by it."""
    fixed = zoo.run(system, TS, dt=0.01, stabilization=None).stats
    assert (fixed.rtol, fixed.atol, fixed.stabilization) == (None, None, None)
    chosen = zoo.run(system, TS, solver=None, stabilization=rj.Projection()).stats
    assert chosen.fastest_frequency > 0
    assert chosen.stabilization == rj.Projection()


def test_no_limit_of_steps(system, monkeypatch):
    """But within a transformation, where reverse mode must know one; forward mode needs none."""
    monkeypatch.setattr(settings, "_MOST_STEPS", 3)

    def steps(start, adjoint=None):
        made = {"max_steps": None, "throw": False, "adjoint": adjoint}
        made |= {"solver": diffrax.Tsit5(), "stabilization": None}
        run = zoo.run(system, TS, rtol=1e-5, v0=start, **made)
        return run.stats.num_steps, run.status

    wanted, status = steps(system.v0)
    assert wanted > 3
    assert status == Status.SUCCESS
    assert jax.jit(steps)(system.v0) == (3, Status.MAX_STEPS)
    found = jax.jit(lambda start: steps(start, diffrax.ForwardMode()))(system.v0)
    assert found == (wanted, Status.SUCCESS)
    with pytest.raises(rj.InputError, match="max_steps=0.*None stands for any number"):
        zoo.run(system, TS, max_steps=0)


def test_the_numbers_of_steps_are_items_too(run):
    """Without a warning."""
    for name in ("num_steps", "num_accepted_steps", "num_rejected_steps"):
        assert run.stats[name] == run.stats.get(name) == getattr(run.stats, name)
        assert name in run.stats


SOLVERS = {
    "explicit": diffrax.Dopri8(),
    "implicit": diffrax.Kvaerno5(),
    "own": rj.Rodas5P(),
    "with a number": diffrax.Kvaerno5(root_finder=diffrax.VeryChord(rtol=1e-3, atol=1e-3)),
}


@pytest.mark.parametrize("solver", SOLVERS.values(), ids=SOLVERS)
def test_the_solver_is_kept(run, solver):
    """Through all transformations, and as one program for equal solvers."""
    run = dataclasses.replace(run, solver_parts=Partitioned.of(solver))
    traced = []

    @jax.jit
    def same(run):
        traced.append(1)
        return run

    again = same(run)
    changed = dataclasses.replace(run, q=np.asarray(run.q) + 1)
    for other in (
        again,
        same(dataclasses.replace(run, solver_parts=Partitioned.of(solver))),
        jax.tree.map(lambda x: x, run),
        run.every(2),
        changed,
    ):
        assert other.solver == solver
        assert other.solver_name == type(solver).__name__
    assert len(traced) == 1
    batch = jax.tree.map(lambda x: np.stack([np.asarray(x)] * 3), run)
    assert batch.solver_name == run.solver_name


def test_every_other_output_of_a_batch(run):
    """All of its runs stay."""
    batch = jax.tree.map(lambda x: np.stack([np.asarray(x)] * 3), run)
    for one, all_of_them in zip(
        jax.tree.leaves(run.every(2)), jax.tree.leaves(batch.every(2)), strict=True
    ):
        assert np.array_equal(np.stack([np.asarray(one)] * 3), all_of_them)
    for stride in (np.array(2), jax.numpy.array(2)):
        assert np.array_equal(run.every(stride).t, run.t[::2])
    for stride in (0, -1, 1.5, True, np.array([2])):
        with pytest.raises(rj.InputError, match="whole number above zero"):
            run.every(stride)


def test_a_solver_with_a_traced_number():
    """It is an array of the trajectory then."""
    system = zoo.oscillator()

    def simulate(rtol):
        finder = diffrax.VeryChord(rtol=rtol, atol=rtol)
        solver = diffrax.Kvaerno5(root_finder=finder)
        return zoo.run(system, TS, dt=0.05, solver=solver, throw=False)

    run = jax.jit(simulate)(1e-4)
    assert run.solver.root_finder.rtol == 1e-4
    assert run.solver.order(None) == 5


def test_a_failed_run_is_not_valid(run):
    """And says so in its warnings."""
    failed = dataclasses.replace(run, status=np.asarray(int(rj.Status.MAX_STEPS)))
    assert run.is_valid
    assert not run.warnings()
    assert not failed.is_valid
    words = failed.warnings()
    assert "max_steps" in words


def test_statistics_of_plain_numbers():
    """Of a run that was not simulated."""
    stats = Statistics(3, 2, 1)
    assert stats["num_steps"] == 3
    assert stats.rtol is None
