"""Effects with first-order states: against closed forms, and in all that asks for a state."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize
import zoo
from comparison import assert_close
from tolerances import IDENTITY
from zoo import run

import romjax as rj

MASS, STIFFNESS, TARGET = 2.0, 50.0, 0.3
GAINS = 200.0, 400.0, 20.0
LAG = 0.05
CART = rj.RigidBody("cart", MASS, 0.1)
RAIL, GROUND = CART.at(), rj.ground.at()
TIMES = np.linspace(0.0, 1.0, 21)
# Required of closed forms.
EXACT = 1e-8


def cart(*effects, **start) -> rj.Scene:
    body = rj.RigidBody("cart", MASS, 0.1, **start)
    return rj.Scene([body], [rj.Prismatic(RAIL, GROUND)], effects)


def controlled(gains=GAINS, **options) -> rj.Scene:
    """A mass on a spring whose place is controlled."""
    proportional, integral, derivative = gains
    pid = rj.PID(
        RAIL,
        GROUND,
        rj.Constant(TARGET),
        proportional,
        integral,
        derivative,
        motion="travel",
        name="pid",
        **options,
    )
    return cart(pid, rj.Spring(RAIL, rj.ground.at((-1.0, 0.0)), STIFFNESS, rest_length=1.0))


def linear(lag=None, gains=GAINS) -> np.ndarray:
    """The matrix of (x, x', z, [f], 1)."""
    p, i, d = gains
    command = np.array([-p, -d, 1.0, p * TARGET])
    force = command if lag is None else np.zeros(4)
    matrix = np.zeros((4, 4))
    matrix[0, 1] = 1.0
    matrix[1] = force / MASS - np.array([STIFFNESS / MASS, 0, 0, 0])
    matrix[2] = [-i, 0, 0, i * TARGET]
    if lag is None:
        return matrix
    wide = np.zeros((5, 5))
    wide[np.ix_([0, 1, 2, 4], [0, 1, 2, 4])] = matrix
    wide[1, 3] = 1 / MASS
    wide[3] = [*command[:3] / lag, -1 / lag, command[3] / lag]
    return wide


def closed_form(matrix) -> np.ndarray:
    start = np.eye(len(matrix))[-1]
    return np.stack([scipy.linalg.expm(matrix * t) @ start for t in TIMES])


@pytest.mark.parametrize(
    "solver",
    [None, pytest.param(rj.Rodas5P(), marks=pytest.mark.slow)],
    ids=["explicit", "implicit"],
)
def test_pid_of_a_mass_is_the_solution_of_linear_equations(solver):
    system, lag = rj.assemble(controlled(lag=LAG)), LAG
    moved = run(system, TIMES, audit=True, rtol=1e-11, **({"solver": solver} if solver else {}))
    wanted = closed_form(linear(lag))
    sizes = np.max(np.abs(wanted), axis=0)
    for column, label in enumerate(("cart.x", "cart.x'", "pid.integral", "pid.force")):
        assert np.max(np.abs(moved[label] - wanted[:, column])) <= EXACT * sizes[column]
    assert moved.is_valid
    # The work of the controlled force is in the balance.
    assert np.max(np.abs(moved.imbalance)) <= EXACT


def test_linear_model_has_the_states():
    system = rj.assemble(controlled())
    push = rj.Force(RAIL, (1.0, 0.0), rj.Constant(1.0))
    model = rj.linearize(system, {"push": push}, ["cart.x", "pid.integral"])
    assert model.states == ("z1", "z1'", "pid.integral")
    wanted = np.linalg.eigvals(linear()[:3, :3])
    found = np.linalg.eigvals(np.asarray(model.A))
    assert np.allclose(np.sort_complex(found), np.sort_complex(wanted), rtol=1e-11)
    # By integral action no constant push shifts the mass: C A⁻¹ B + D of it is zero.
    static = -model.C @ np.linalg.solve(model.A, model.B)
    assert np.allclose(static[:, 0], [0.0, -1.0], atol=1e-12)
    assert model.shapes.shape == (4, 1)
    pid = dataclasses.replace(controlled().effects[0], name="other")
    with pytest.raises(rj.InputError, match="input other has states of its own"):
        rj.linearize(system, {"control": pid}, ["cart.x"])


@pytest.mark.slow
def test_equilibrium_finds_states_and_runs_stay_there():
    system = rj.assemble(controlled())
    q = rj.equilibrium(system)
    assert np.allclose(q, [TARGET, 0, 0, STIFFNESS * TARGET], atol=1e-9)
    assert np.allclose(rj.measure(system, q, RAIL).acceleration, 0.0, atol=1e-9)
    moved = run(system, TIMES[:2], q0=q)
    assert np.allclose(moved["cart.x"], TARGET, atol=1e-12)
    assert np.allclose(moved["pid.integral"], STIFFNESS * TARGET)


@pytest.mark.parametrize("age", [1e9, pytest.param(None, marks=pytest.mark.slow)])
def test_integral_part_does_not_wind_up(age):
    """With tracking the command stays near what is left of it; in an age, or without tracking, it
    changes nothing.
    """
    free, held = (
        run(rj.assemble(controlled(largest=20.0, tracking=time)), TIMES) for time in (age, 0.1)
    )
    assert np.max(held["pid.integral"]) < 0.7 * np.max(free["pid.integral"])


def test_low_pass_of_a_sine():
    """τ f' + f = sin ωt, and the mass that it pushes."""
    w, lag = 2 * np.pi * 3.0, 0.1
    push = rj.LowPass(RAIL, GROUND, rj.Sine(1.0, 3.0), lag, motion="travel", name="motor")
    moved = run(rj.assemble(cart(push)), TIMES, rtol=1e-11)
    decay = w * lag * np.exp(-TIMES / lag)
    force = (np.sin(w * TIMES) - w * lag * np.cos(w * TIMES) + decay) / (1 + (w * lag) ** 2)
    assert np.max(np.abs(moved["motor.force"] - force)) <= EXACT
    speed = (1 - np.cos(w * TIMES)) / w - lag * np.sin(w * TIMES) + w * lag**2 - lag * decay
    assert np.max(np.abs(moved["cart.x'"] - speed / (1 + (w * lag) ** 2) / MASS)) <= EXACT


CYLINDER = {
    "area": 2e-3,
    "rod_area": 1.2e-3,
    "retracted": 0.4,
    "stroke": 0.5,
    "supply": 1.5e7,
    "flow": 3e-8,
    "dead_volume": 5e-5,
    "leakage": 1e-13,
    "damping": 200.0,
}


def hydraulics(t, y) -> list[float]:
    """The mass, its speed, and the pressures, by hand."""
    x, v, a, b = y
    k, size, rod = CYLINDER["flow"], CYLINDER["area"], CYLINDER["rod_area"]
    u, out = np.sin(2 * np.pi * 2 * t), x - CYLINDER["retracted"]

    def root(drop):
        return drop / (drop**2 + 1e8) ** 0.25

    if u > 0:
        into = k * u * root(CYLINDER["supply"] - a), k * u * root(1e5 - b)
    else:
        into = k * u * root(a - 1e5), k * u * root(b - CYLINDER["supply"])
    leak = CYLINDER["leakage"] * (a - b)
    rates = (
        1.6e9 * (into[0] - size * v - leak) / (CYLINDER["dead_volume"] + size * out),
        1.6e9 * (into[1] + rod * v + leak) / (CYLINDER["dead_volume"] + rod * (0.5 - out)),
    )
    return [v, (size * a - rod * b - CYLINDER["damping"] * v) / 500.0, *rates]


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.exhaustive)])
def test_hydraulic_cylinder_is_that_of_another_integration(dimension):
    """In the plane and in space, where the same mass slides."""
    start = {"pressure_a": 4e6, "pressure_b": 6e6}
    place, ends = (0.6, *[0.0] * (dimension - 1)), (1.0, *[0.0] * (dimension - 1))
    if dimension == 2:
        mass = rj.RigidBody("mass", 500.0, 1.0, position=place)
        guide = rj.Prismatic(mass.at(), rj.ground.at())
    else:
        mass = rj.spatial.RigidBody("mass", 500.0, np.eye(3), position=place)
        guide = rj.spatial.Prismatic(mass.at(axis=ends), rj.ground.at((0.0, 0.0, 0.0), axis=ends))
    eye = rj.ground.at((0.0,) * dimension)
    valve = rj.Sine(1.0, 2.0)
    jack = rj.HydraulicCylinder(mass.at(), eye, valve, name="jack", **CYLINDER, **start)
    times = np.linspace(0.0, 0.4, 11)
    system = rj.assemble(rj.Scene([mass], [guide], [jack]))
    moved = run(system, times, rtol=1e-9, solver=rj.Rodas5P())
    given = {"method": "Radau", "rtol": 1e-11, "atol": 1e-11, "t_eval": times}
    known = scipy.integrate.solve_ivp(hydraulics, (0.0, 0.4), [0.6, 0.0, 4e6, 6e6], **given).y
    labels = "mass.x", "jack.pressure_a", "jack.pressure_b"
    for label, wanted in zip(labels, known[[0, 2, 3]], strict=True):
        assert np.max(np.abs(moved[label] - wanted)) <= 1e-7 * np.max(np.abs(wanted))


@pytest.mark.slow
def test_gradients_and_batches():
    """By the gains, three ways, and of several at once."""

    def late(gains):
        moved = run(rj.assemble(controlled(gains)), TIMES, max_steps=4000)
        return moved["cart.x"][-1] + moved["pid.integral"][-1]

    gains = jnp.asarray(GAINS)
    checked = rj.check_gradient(late, gains)
    assert checked.error <= 1e-6, checked
    many = jax.vmap(late)(jnp.stack([gains, 1.1 * gains]))
    assert np.allclose(many, [late(gains), late(1.1 * gains)], rtol=1e-9)


@pytest.mark.slow
def test_an_impact_of_what_is_controlled():
    """A mass that hits a wall on its way to the target: two pieces of one linear motion."""
    wall, restitution, start, matrix = 0.2, 0.5, np.eye(4)[-1], linear()

    def place(t: float) -> float:
        return (scipy.linalg.expm(matrix * t) @ start)[0] - wall

    hit = scipy.optimize.brentq(place, 0.0, 0.2)
    rebound = scipy.linalg.expm(matrix * hit) @ start * [1.0, -restitution, 1.0, 1.0]
    wanted = scipy.linalg.expm(matrix * 0.02) @ rebound
    gap = rj.Impact(rj.quantity.Travel(GROUND, RAIL), restitution, level=-wall)
    system, times = rj.assemble(controlled()), np.array([0.0, hit + 0.02])
    moved = run(system, times, events=[gap], rtol=1e-11)
    assert moved.events.count == 1
    for column, label in enumerate(("cart.x", "cart.x'", "pid.integral")):
        assert abs(moved[label][-1] - wanted[column]) <= EXACT * np.max(np.abs(wanted))


@pytest.mark.slow
def test_files_and_events(tmp_path):
    scene = controlled(lag=LAG, start=1.5)
    scene.save(tmp_path / "pid.toml")
    read = rj.load_scene(tmp_path / "pid.toml")
    assert isinstance(read.effects[0], rj.PID)
    system = rj.assemble(read)
    assert system.v0[-1] == 1.5
    crossing = rj.Crossing(rj.quantity.Coordinate("pid.integral"), 10.0)
    moved = run(system, TIMES, events=[crossing])
    assert np.all(moved.events.happened[:1])
    moved.save(tmp_path / "run.nc")
    again = rj.load(tmp_path / "run.nc")
    assert np.array_equal(again["pid.force"], moved["pid.force"])
    assert again.scene.effects[0].name == "pid"


def test_the_last_configuration_of_a_run_holds_the_states():
    """As that of an equilibrium does: statics, linear models and runs begin there with them, and
    not with their integrals. The integral part, which nothing changes without its gain, stays.
    """
    part, (p, _, d) = 5.0, GAINS
    steady = (p * TARGET + part) / (p + STIFFNESS)
    # Cut off where the integral part would be its integral.
    gains, limit = (p, 0.0, d), STIFFNESS * steady + part / 2
    system = rj.assemble(controlled(gains, lag=LAG, start=part, largest=limit))
    moved = run(system, 3 * TIMES)
    last, force = moved.q[-1], moved["pid.force"][-1]
    resting = rj.measure(system, last, RAIL).acceleration
    assert np.allclose(resting[0], (force - STIFFNESS * moved["cart.x"][-1]) / MASS, atol=1e-9)
    assert run(system, TIMES[:2], q0=last)["pid.integral"][0] == part
    balance = np.asarray(rj.equilibrium(system, last))
    assert np.allclose(balance[[0, 3, 4]], [steady, part, STIFFNESS * steady], atol=1e-9)
    model = rj.linearize(system, {}, [], at=last)
    assert model.states == ("z1", "z1'", "pid.force")
    wanted = np.linalg.eigvals(linear(LAG, gains)[np.ix_([0, 1, 3], [0, 1, 3])])
    found = np.linalg.eigvals(np.asarray(model.A))
    assert np.allclose(np.sort_complex(found), np.sort_complex(wanted), atol=1e-7)


def twice_controlled(integrals, begun) -> rj.AbstractSystem:
    """The mass on its spring with two controllers, without damping."""
    pids = [
        rj.PID(RAIL, GROUND, rj.Constant(TARGET), 100.0, gain, motion="travel", start=z, name=name)
        for gain, z, name in zip(integrals, begun, ("one", "two"), strict=True)
    ]
    spring = rj.Spring(RAIL, rj.ground.at((-1.0, 0.0)), STIFFNESS, rest_length=1.0)
    return rj.assemble(cart(*pids, spring))


def balanced(integrals, begun):
    return rj.equilibrium(twice_controlled(integrals, begun))


def test_states_that_nothing_changes_stay_in_an_equilibrium():
    """The integral parts z' = I e of what has none, as that of a PID without I, and the sum I₂ z₁ −
    I₁ z₂ of two that have one: they act as forces that no motion gets rid of.
    """
    begun, held = np.array([5.0, -2.0]), STIFFNESS * TARGET
    for integrals in ((0.0, 0.0), (400.0, 0.0), (400.0, 100.0)):
        q = balanced(integrals, begun)
        left = held - np.sum(begun)
        shares = np.array(integrals) / max(sum(integrals), 1.0)
        controlled = (200 * TARGET + np.sum(begun)) / (200 + STIFFNESS)
        assert abs(q[0] - (TARGET if any(integrals) else controlled)) <= EXACT
        assert np.allclose(q[-2:], begun + left * shares, rtol=0, atol=EXACT)
        slope = jax.grad(lambda z, integrals=integrals: balanced(integrals, z)[0])(begun)
        assert np.allclose(slope, 0.0 if any(integrals) else 1 / (200 + STIFFNESS), atol=EXACT)


PUSH = {"push": rj.Force(RAIL, (1.0, 0.0), rj.Constant(1.0))}


def regulated(model) -> np.ndarray:
    """The poles of a linear model with its quadratic regulator, of unit weights."""
    a, b = np.asarray(model.A), np.asarray(model.B)
    cost = scipy.linalg.solve_continuous_are(a, b, np.eye(len(a)), np.eye(b.shape[1]))
    return np.linalg.eigvals(a - b @ b.T @ cost)


def test_states_that_only_follow_others_are_no_states_of_a_linear_model():
    """Each would be a zero of A that no input moves, for which no regulator exists."""
    first = ("z1", "z1'")
    for integrals, own in (
        ((0.0, 0.0), ()),
        ((400.0, 0.0), ("one.integral",)),
        ((400.0, 100.0), ("one.integral",)),
    ):
        model = rj.linearize(
            twice_controlled(integrals, (0.0, 0.0)), PUSH, ["cart.x", "two.integral"]
        )
        assert model.states == first + own
        share = integrals[1] / max(integrals[0], 1.0)  # of the second sum in the first
        wanted = np.array([[0, 1, 0], [-250 / MASS, 0, (1 + share) / MASS], [-integrals[0], 0, 0]])
        wanted = wanted[: len(model.A), : len(model.A)]
        known = np.linalg.eigvals(wanted)
        assert_close(np.poly(np.asarray(model.A)), np.poly(known), IDENTITY, scale=1e6)
        assert_close(np.asarray(model.C)[1], [0.0, 0.0] + [share] * len(own), IDENTITY)
        assert np.all(regulated(model).real < 0)


def locked():
    """A mass that oil holds on both sides of a piston whose valve is shut, without leakage."""
    mass = rj.RigidBody("mass", 500.0, 1.0, position=(0.6, 0.0))
    jack = rj.HydraulicCylinder(
        mass.at(), GROUND, rj.Constant(0.0), name="jack", **{**CYLINDER, "leakage": 0.0}
    )
    return rj.assemble(rj.Scene([mass], [rj.Prismatic(mass.at(), GROUND)], [jack])), mass


def test_oil_that_is_shut_in_is_a_spring_of_a_linear_model():
    """Of the stiffness β (A²/V_a + B²/V_b), with the pressures as outputs."""
    system, mass = locked()
    force = {"force": rj.Force(mass.at(), (1.0, 0.0), rj.Constant(1.0))}
    model = rj.linearize(system, force, ["mass.x", "jack.pressure_a", "jack.pressure_b"])
    assert model.states == ("z1", "z1'")
    sides = np.array([CYLINDER["area"], -CYLINDER["rod_area"]])
    volumes = CYLINDER["dead_volume"] + np.abs(sides) * [0.2, 0.3]
    stiffness = 1.6e9 * np.sum(sides**2 / volumes)
    wanted = [1.0, CYLINDER["damping"] / 500.0, stiffness / 500.0]
    assert_close(np.poly(np.asarray(model.A)), wanted, IDENTITY, scale=wanted[-1])
    place, *pressures = np.asarray(model.C)[:, 0]
    assert_close(np.array(pressures) / place, -1.6e9 * sides / volumes, IDENTITY, scale=1e12)
    assert np.all(regulated(model).real < 0)
    # Which states follow others is unknown to a program for all numbers.
    traced = jax.eval_shape(lambda: rj.linearize(system, force, ["mass.x"]).A)
    assert traced.shape == (4, 4)


class Lagging(rj.AbstractStateEffect):
    """A force on one marker that follows its speed late."""

    at: rj.Marker
    states = ("late",)

    def rates(self, t, states, poses, twists):
        return twists[0].velocity[:1] - states

    def driven(self, t, states, poses, twists):
        force = jnp.stack([-states[0], jnp.zeros(())])
        return (rj.Wrench(force, jnp.zeros_like(twists[0].angular_velocity)),)

    def check(self):
        pass


def test_an_effect_of_ones_own_is_one_class():
    system = rj.assemble(cart(Lagging(RAIL), velocity=(1.0, 0.0)))
    moved = run(system, TIMES)
    matrix = np.array([[0.0, -1 / MASS], [1.0, -1.0]])
    wanted = np.stack([scipy.linalg.expm(matrix * t) @ [1.0, 0.0] for t in TIMES])
    assert np.allclose(moved["cart.x'"], wanted[:, 0], atol=EXACT)
    assert np.allclose(moved["Lagging(cart).late"], wanted[:, 1], atol=EXACT)


@pytest.mark.slow
def test_joint_coordinates_keep_states():
    """As the closed form has them, the balance of energy too."""
    joint = rj.reduce(rj.assemble(controlled(lag=LAG)), formulation=rj.JointCoordinates())
    assert joint.structure.states == (1, 2)
    moved, wanted = run(joint, TIMES, audit=True, rtol=1e-11), closed_form(linear(LAG))
    sizes = np.max(np.abs(wanted), axis=0)
    for column, label in enumerate(("cart.x", "cart.x'", "pid.integral", "pid.force")):
        assert np.max(np.abs(moved[label] - wanted[:, column])) <= EXACT * sizes[column]
    assert np.max(np.abs(moved.imbalance)) <= EXACT


@pytest.mark.slow
def test_models_of_flexible_bodies_keep_states():
    """All modes are the full model to rounding; fewer err as they do without a controller."""
    arm = rj.Beam("arm", 1.0, 1.0, frequencies=[4.0, 11.0, 30.0])
    arm = arm.placed("start", rj.ground.pose((0.0, 0.0)), angle=-1.5)
    ends = arm.at("start"), rj.ground.at()
    pid = rj.PID(*ends, rj.Constant(-1.0), 60.0, 80.0, 12.0, lag=0.01, name="pid")
    system = rj.assemble(rj.Scene([arm], [rj.Revolute(*ends)], [rj.Gravity(), pid]))
    truth = run(system, TIMES, rtol=1e-9)
    models = [rj.reduce(system, rj.pod(truth), rj.Local(ranks=(rank,))) for rank in (3, 2)]
    assert [model.ranks for model in models] == [(3,), (2,)]
    joint = rj.JointCoordinates()
    modes = joint.basis(system, truth, lambda snapshots: rj.pod(snapshots, rank=2))
    models += [rj.reduce(system, formulation=joint), rj.reduce(system, modes, joint)]
    assert [model.n for model in models[2:]] == [6, 5]
    for model, least, largest in zip(
        models, (0, 1e-3, 0, 1e-4), (EXACT, 4e-3, EXACT, 4e-3), strict=True
    ):
        moved = run(model, TIMES, rtol=1e-9)
        assert least <= float(rj.compare(truth, moved).error) < largest
        if not least:
            assert np.allclose(moved["pid.integral"], truth["pid.integral"], atol=EXACT)
    with pytest.raises(rj.ReductionError, match="this formulation does not keep"):
        rj.reduce(system, rj.pod(truth))


def test_large_states_hide_no_joint_that_is_apart():
    """A state has a size of its own, such as a pressure, which says nothing of lengths."""
    bar = zoo.bar().bodies[0]
    ends = bar.at(), rj.ground.at()
    joints = [rj.FixedAngle(*ends), rj.PrescribedAngle(*ends, rj.Step(0.5, 0.2, 0.1))]
    # Its command is cut off to nothing.
    idle = rj.PID(*ends, rj.Constant(0.0), start=1e9, least=0.0, largest=0.0)
    system = rj.assemble(rj.Scene([bar], joints, [idle]))
    moved = run(system, TIMES, throw=False)
    assert rj.Status(int(moved.status)) is rj.Status.CONSTRAINTS_VIOLATED


@pytest.mark.instant
def test_what_does_not_carry_states_says_so():
    system = rj.assemble(controlled())
    with pytest.raises(
        rj.ReductionError, match="'pid' has first-order states, which this formulation"
    ):
        rj.reduce(system, None, rj.Minimal())
    with pytest.raises(rj.InputError, match="modes: 'pid' has first-order states"):
        rj.modes(system)
    with pytest.raises(rj.InputError, match="export: effects with first-order states"):
        rj.compile(system)
    with pytest.raises(rj.SceneError, match="lag is -1"):
        controlled(lag=-1.0)
