"""Random runs through change points: right, refused or doubted, and never silently wrong."""

import dataclasses

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from groups import in_groups
from mechanisms import linkage
from motions import through
from parallelogram import parallelogram
from tolerances import IDENTITY
from zoo import bar, unit_mass
from zoo import run as moved

import romjax as rj
from romjax.integrate.follow.branching import _least_but

LANES = 28
TS = np.linspace(0.0, 3.0, 61)
GRAVITY = 9.81
# Required: errors of energy and angle in tolerances, and the distance to the parallel branch [m].
ENERGY, BRANCH = 100.0, 1e-2
# Required: the least share of right runs with nothing set; while JAX traces, they are projected.
RIGHT = 0.9
# Methods, and whether constraints repeat each other everywhere.
METHODS = [(name, twice) for name in ("Dopri8", "Rodas5P") for twice in (False, True)]
STABILIZATIONS = {"default": "default", "terms": (10.0, 100.0)}
CASES = [(method, name, twice) for method, twice in METHODS for name in STABILIZATIONS]
SLOW = [("Dopri8", "default", True)]
# With terms some lanes take all steps there are: worth compiling longer than tests do.
LONG = {"xla_backend_optimization_level": 1}


def lot(seed: int) -> dict[str, np.ndarray]:
    """Numbers of parallelograms: half of them with equal masses, a fifth at a change point."""
    chance = np.random.default_rng(seed)
    masses = chance.uniform(0.3, 2.0, (LANES, 2))
    masses[::2, 1] = masses[::2, 0]
    angle = chance.uniform(0.2, np.pi - 0.2, LANES)
    angle[::5] = 0.0
    return {
        "masses": masses,
        "angle": angle,
        "speed": chance.uniform(0.5, 8.0, LANES) * chance.choice([-1, 1], LANES),
        "crank": chance.uniform(0.8, 1.5, LANES),
        "coupler": chance.uniform(1.6, 2.4, LANES),
        "rtol": 10.0 ** chance.choice([-6, -9], LANES),
    }


def angles(numbers) -> jax.Array:
    """The angle of the bars over time, in minimal coordinates: both masses move on equal circles,
    like one pendulum.
    """

    def motion(angle, speed, crank):
        swing = rj.CustomSystem(
            unit_mass,
            lambda t, q, v: -GRAVITY / crank * jnp.cos(q),
            q0=angle[None],
            v0=(speed / crank)[None],
        )
        return rj.simulate(swing, TS, solver=diffrax.Dopri8(), rtol=1e-12, audit=False).q[:, 0]

    return jax.jit(jax.vmap(motion))(*(numbers[x] for x in ("angle", "speed", "crank")))


@pytest.mark.parametrize(("method", "name", "twice"), in_groups(CASES, slow=SLOW))
def test_no_run_is_silently_wrong(method, name, twice):
    """With `twice`, the middle bar is made twice: constraints that repeat each other everywhere."""
    solver = diffrax.Dopri8() if method == "Dopri8" else rj.Rodas5P()
    numbers = lot(len(name) + 10 * twice)

    def motion(masses, angle, speed, crank, coupler, rtol):
        keep = STABILIZATIONS[name]
        keep = rj.Baumgarte(*keep) if isinstance(keep, tuple) else keep
        scene = parallelogram(masses, speed, angle, crank, coupler, twice)
        settings = {"solver": solver, "stabilization": keep, "max_steps": 5000, "throw": False}
        return rj.simulate(rj.assemble(scene), TS, rtol=rtol, **settings)

    options = {} if name == "default" else LONG
    together = jax.jit(jax.vmap(motion), compiler_options=options)
    runs = together(*numbers.values())
    truth, q, v = np.asarray(angles(numbers)), np.asarray(runs.q), np.asarray(runs.v)
    first, second = numbers["masses"].T[:, :, None]
    energy = GRAVITY * (first * q[:, :, 1] + second * q[:, :, 4])
    energy += 0.5 * (first * np.sum(v[:, :, :2] ** 2, 2) + second * np.sum(v[:, :, 3:5] ** 2, 2))
    lost = np.max(np.abs(energy - energy[:, :1]), axis=1) / np.asarray(runs.balance.extent)
    along = numbers["crank"][:, None, None] * np.stack([np.cos(truth), np.sin(truth)], axis=2)
    coupled = along + np.stack([numbers["coupler"], np.zeros(LANES)], axis=1)[:, None]
    off = np.max(np.abs(np.concatenate([q[:, :, :2] - along, q[:, :, 3:5] - coupled], 2)), (1, 2))
    wrong = ~(lost <= ENERGY * numbers["rtol"]) | ~(off <= BRANCH)
    silent = wrong & np.asarray(runs.is_valid)
    assert not np.any(silent), [
        (i, f"{lost[i]:.1e}", f"{off[i]:.1e}", f"{numbers['rtol'][i]:.0e}")
        for i in np.flatnonzero(silent)
    ]
    if name == "default":
        assert np.mean(~wrong) >= RIGHT


def test_a_parallelogram_of_short_cranks():
    """It loses its branch in small steps, in which branches are told apart ten times better than
    where others lose theirs.
    """
    crank, base = 0.31051975278676497, 2.2067291235116704
    s, spin = -2.1937337258134573, -11.72046169011649
    masses, ts = (0.2346661389812438, 2.100958843713906, 3.56937255991144), np.linspace(0, 2.4, 101)
    way = crank * np.array([np.cos(s), np.sin(s)])
    points = {"O": (0.0, 0.0), "a": way, "b": way + np.array([base, 0.0]), "B": (base, 0.0)}
    turning = dict.fromkeys("ab", spin * np.array([-way[1], way[0]]))
    bars = [("O", "a"), ("a", "b"), ("B", "b")]
    system = rj.assemble(linkage(points, bars, turning, gravity=True, masses=masses))
    run = rj.simulate(system, ts)
    assert run.is_valid
    # Cranks of Σ m turn alike, the coupler M does not: (Σ m/3 + M) r φ'' = -(Σ m/2 + M) g cos φ.
    moved = (masses[0] + masses[2]) / 3 + masses[1], (masses[0] + masses[2]) / 2 + masses[1]
    pull = GRAVITY * moved[1] / moved[0] / crank
    swing = rj.CustomSystem(
        unit_mass, lambda t, q, v: -pull * jnp.cos(q), q0=np.array([s]), v0=np.array([spin])
    )
    angle = rj.simulate(swing, ts, solver=diffrax.Dopri8(), rtol=1e-12, audit=False).q[:, 0]
    assert_close(run["Oa.phi"], angle, 1e-4)


def flagged(kinds) -> dict[str, jax.Array]:
    """How a lane went, as numbers."""
    return {"status": kinds[0], "flags": kinds[1], "x": 1.0 * kinds[0]}


def test_a_sweep_tells_lanes_that_are_doubtful():
    kinds = [(0, 0), (0, rj.Flag.ENERGY), (0, rj.Flag.OUTSIDE_TRAINING), (rj.Status.MAX_STEPS, 0)]
    sweep = rj.sweep(flagged, np.array(kinds))
    assert sweep.success.tolist() == [True, False, True, False]
    assert sweep.is_valid.tolist() == [True, False, False, False]
    assert set(sweep.failures()) == {1, 3}
    assert "energy" in sweep.failures()[1]
    assert np.isnan(sweep.values["x"]).tolist() == [False, False, False, True]


@pytest.mark.slow
def test_the_default_passes_a_change_point():
    """By projection, where the terms of the default lose energy."""
    run = rj.simulate(rj.assemble(parallelogram()), TS, solver=diffrax.Dopri8(), rtol=1e-9)
    assert run.is_valid
    assert float(run.balance.largest) <= 1e-7 * float(run.balance.extent)


@pytest.mark.slow
def test_where_constraints_lose_rank():
    scene = parallelogram(twice=True)
    system = rj.assemble(scene)
    run = moved(system, TS, rtol=1e-6, stabilization=rj.Projection())
    singular = rj.singular_position(system, run)
    q = np.asarray(run.q)
    level = np.abs(q[:, 1])
    assert singular.is_passed
    assert level[np.argmin(np.abs(np.asarray(run.t) - singular.time))] == np.min(level)
    assert {"joint 'middle'", "joint 'again'"} & set(singular.joints)
    assert "singular position" in singular.describe()
    # Of a run that failed later.
    failed = jnp.where(run.t > singular.time, jnp.inf, 0.0)
    again = rj.singular_position(system, dataclasses.replace(run, q=run.q + failed[:, None]))
    assert again.time == singular.time
    assert again.is_passed == singular.is_passed


def test_a_row_that_vanishes_shows_even_if_it_is_left_out():
    """Of three pivots but for the least, which has no length."""
    least = jax.jit(_least_but)(np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.5, 1.0]), 1)
    assert_close(least, 0.1, IDENTITY)


@pytest.mark.slow
def test_repeated_joints_are_no_singular_position():
    scene = bar()
    system = rj.assemble(rj.Scene(scene.bodies, 2 * scene.joints, scene.effects))
    singular = rj.singular_position(system, moved(system, TS))
    assert not singular.is_passed
    assert singular.condition < 10
    free = rj.assemble(rj.Scene(scene.bodies))
    assert rj.singular_position(free, through(free)) is None


@pytest.mark.slow
def test_joint_coordinates_go_on_where_a_loop_is_stretched():
    """A four-bar that folds flat, with nothing set, in coordinates of joints as in those of bodies
    with projection. There the rows of the loop vanish, instead of repeating each other.
    """
    coupler, rocker, base = 0.8, 0.4, np.array([0.7, 0.0])
    pin = 0.3 * np.array([np.cos(1.0), np.sin(1.0)])
    apart = np.linalg.norm(base - pin)
    along = (coupler**2 - rocker**2 + apart**2) / (2 * apart)
    way = (base - pin) / apart
    across = np.sqrt(coupler**2 - along**2) * np.array([-way[1], way[0]])
    points = {"A": (0.0, 0.0), "b": pin, "c": pin + along * way + across, "D": base}
    scene = linkage(points, [("A", "b"), ("b", "c"), ("D", "c")], {}, gravity=True)
    system, ts = rj.assemble(scene), np.linspace(0.0, 0.8, 21)
    run = rj.simulate(rj.reduce(system, formulation="joint"), ts)
    other = rj.simulate(system, ts, stabilization=rj.Projection())
    assert run.success
    assert_close(run.q, other.q, BRANCH)
