"""Constraints of velocities: a sleigh, a disc and a ball, against closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.optimize
from zoo import run

import romjax as rj

r = rj.spatial
# Required of other equations and of closed forms.
EXACT = 1e-8
MASS, INERTIA, ARM = 2.0, 0.3, 0.4
SPEED, SPIN = 0.7, 1.5
WHEEL, WHEEL_INERTIA, GRAVITY = 0.2, 0.03, 9.81
TIMES = np.linspace(0.0, 3.0, 16)


def sleigh(inertia=INERTIA) -> rj.Scene:
    """Chaplygin's: a body on a knife edge behind its centre of mass."""
    start = {"position": (ARM, 0.0), "velocity": (SPEED, SPIN * ARM), "angular_velocity": SPIN}
    body = rj.RigidBody("sleigh", MASS, inertia, **start)
    return rj.Scene([body], [rj.KnifeEdge(body.at((-ARM, 0.0)), rj.ground.at(), name="edge")])


def sleigh_by_hand() -> np.ndarray:
    """Place and angle of the edge, and its speeds."""

    def rates(t, y):
        _, _, angle, u, w = y
        slowing = -MASS * ARM * u * w / (INERTIA + MASS * ARM**2)
        return [u * np.cos(angle), u * np.sin(angle), w, ARM * w**2, slowing]

    start, given = [0.0, 0.0, 0.0, SPEED, SPIN], {"rtol": 1e-12, "atol": 1e-12}
    found = scipy.integrate.solve_ivp(rates, (0, 3), start, "DOP853", t_eval=TIMES, **given)
    return np.asarray(found.y)


@pytest.mark.parametrize(
    "stabilization",
    ["alike", pytest.param(rj.Projection(), marks=pytest.mark.slow)],
    ids=["Baumgarte", "projected"],
)
def test_sleigh_is_that_of_other_equations(stabilization):
    moved = run(rj.assemble(sleigh()), TIMES, audit=True, stabilization=stabilization)
    x, y, angle, u, w = sleigh_by_hand()
    assert np.max(np.abs(moved["sleigh.phi"] - angle)) <= EXACT
    assert np.max(np.abs(moved["sleigh.x"] - x - ARM * np.cos(angle))) <= EXACT
    assert np.max(np.abs(moved["sleigh.y"] - y - ARM * np.sin(angle))) <= EXACT
    # Nothing is gained or lost, and nothing slips.
    assert np.max(np.abs(moved.imbalance)) <= 1e-9
    slip = np.cos(angle) * moved["sleigh.y'"] - np.sin(angle) * moved["sleigh.x'"] - ARM * w
    assert np.max(np.abs(slip)) <= EXACT
    # The edge pushes across by what bends the way of the mass.
    slowing = -MASS * ARM * u * w / (INERTIA + MASS * ARM**2)
    pushed = rj.joint_forces(moved.system, moved)["edge"].on("a", "a").force
    assert np.max(np.abs(pushed[:, 0])) <= 1e-12
    assert np.max(np.abs(pushed[:, 1] - MASS * (u * w + ARM * slowing))) <= 1e-7


def wheel(curve, place) -> rj.Scene:
    body = rj.RigidBody("wheel", MASS, WHEEL_INERTIA, position=place)
    rolling = rj.RollingWheel(body.at(), rj.ground.at(), curve, WHEEL, name="rolling")
    return rj.Scene([body], [rolling], [rj.Gravity((0.0, -GRAVITY))])


def test_wheel_swings_in_a_bowl():
    """As a pendulum as long as its centre is away from that of the bowl, but slower by its turn."""
    away, start, slower = 0.8, 0.8, 1 + WHEEL_INERTIA / (MASS * WHEEL**2)
    place = away * np.array([np.sin(start), -np.cos(start)])
    bowl = rj.Circle(away + WHEEL, hollow=True)
    moved = run(rj.assemble(wheel(bowl, place)), TIMES, audit=True)

    def rates(t, y):
        return [y[1], -GRAVITY * np.sin(y[0]) / (away * slower)]

    given = {"rtol": 1e-12, "atol": 1e-12}
    known = scipy.integrate.solve_ivp(rates, (0, 3), [start, 0], "DOP853", t_eval=TIMES, **given)
    assert np.max(np.abs(moved["wheel.x"] - away * np.sin(known.y[0]))) <= EXACT
    turned = moved["wheel.phi"] + away / WHEEL * (known.y[0] - start)
    assert np.max(np.abs(turned)) <= EXACT
    assert np.max(np.abs(moved.imbalance)) <= 1e-9


@pytest.mark.slow
def test_wheel_turns_by_the_length_that_it_rolls():
    """On a parabola: by the arc that it has touched, less what the ground turns below it."""
    coefficients, first = [0.1, 0.2, 0.4], 0.6

    def slope(x):
        return coefficients[1] + 2 * coefficients[2] * x

    def centre(x):
        normal = np.array([-slope(x), 1.0]) / np.hypot(1, slope(x))
        return np.array([x, np.polyval(coefficients[::-1], x)]) + WHEEL * normal

    moved = run(rj.assemble(wheel(rj.Polynomial(coefficients), centre(first))), TIMES)
    for x, y, angle in zip(moved["wheel.x"], moved["wheel.y"], moved["wheel.phi"], strict=True):
        touching = scipy.optimize.brentq(lambda p, x=x: centre(p)[0] - x, -3, 3, xtol=1e-14)
        arc, _ = scipy.integrate.quad(lambda p: np.hypot(1, slope(p)), first, touching)
        ground = np.arctan(slope(touching)) - np.arctan(slope(first))
        assert abs(centre(touching)[1] - y) <= EXACT
        assert abs(WHEEL * (angle - ground) + arc) <= EXACT


@pytest.mark.parametrize("audit", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_disc_rolls_in_a_circle(audit):
    """Steadily, at a lean α: Ω² (C ρ / R + A sin α + m R ρ) cos α = m g R sin α."""
    radius, lean, way, gravity = 0.5, 0.4, 1.2, 9.81
    across, axial = MASS * radius**2 / 4, MASS * radius**2 / 2
    s, c = np.sin(lean), np.cos(lean)
    yaw = np.sqrt(
        MASS * gravity * radius * s / c / (axial * way / radius + across * s + MASS * radius * way)
    )
    axle = np.array([c, 0.0, s])
    turning = yaw * np.array([0, 0, 1.0]) - yaw * (way / radius + s) * axle
    # The axle is the body's z.
    frame = np.stack([np.array([s, 0.0, -c]), [0.0, 1.0, 0.0], axle], axis=1)
    disc = r.RigidBody(
        "disc",
        MASS,
        (across, across, axial),
        position=(way, 0.0, radius * c),
        orientation=frame,
        velocity=(0.0, yaw * way, 0.0),
        angular_velocity=turning,
    )
    rolling = r.RollingDisc(disc.at((0.0, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0)), radius)
    system = rj.assemble(rj.Scene([disc], [rolling], [rj.Gravity((0.0, 0.0, -gravity))]))
    times = np.linspace(0.0, 2 * np.pi / yaw, 9)
    moved = run(system, times, audit=audit)
    assert np.max(np.abs(moved["disc.x"] - way * np.cos(yaw * times))) <= EXACT
    assert np.max(np.abs(moved["disc.y"] - way * np.sin(yaw * times))) <= EXACT
    assert np.max(np.abs(moved["disc.z"] - radius * c)) <= EXACT
    if audit:
        assert np.max(np.abs(moved.imbalance)) <= 1e-9


@pytest.mark.slow
def test_ball_on_a_turntable_goes_in_a_circle():
    """Two turns for seven of the table, if it is homogeneous."""
    radius, spin, speed = 0.1, 3.0, 0.4
    table = r.RigidBody("table", 1.0, np.eye(3), angular_velocity=(0.0, 0.0, spin))
    place = np.array([0.2, 0.0, radius])
    # The point that touches moves with the table.
    touching = np.cross([0.0, 0.0, spin], place * [1, 1, 0])
    velocity = touching + np.array([speed, 0.0, 0.0])
    turning = np.cross([0.0, 0.0, 1.0], velocity - touching) / radius
    ball = r.RigidBody(
        "ball",
        MASS,
        np.full(3, 0.4 * MASS * radius**2),
        position=place,
        velocity=velocity,
        angular_velocity=turning,
    )
    origin = (0.0, 0.0, 0.0)
    joints = [
        r.Revolute(table.at(origin), rj.ground.at(origin)),
        rj.PrescribedAngle(table.at(origin), rj.ground.at(origin), rj.Ramp(spin)),
        r.RollingBall(ball.at(origin), table.at(origin), radius),
    ]
    moved = run(rj.assemble(rj.Scene([table, ball], joints)), TIMES)
    angle = 2 / 7 * spin * TIMES
    wanted = velocity[0] * np.cos(angle) - velocity[1] * np.sin(angle)
    assert np.max(np.abs(moved["ball.x'"] - wanted)) <= EXACT
    wanted = velocity[0] * np.sin(angle) + velocity[1] * np.cos(angle)
    assert np.max(np.abs(moved["ball.y'"] - wanted)) <= EXACT


def test_rows_are_kept_in_a_reduction():
    """In coordinates of another basis the same mechanism."""
    system = rj.assemble(sleigh())
    modes = np.random.default_rng(3).normal(size=(3, 3))
    basis = rj.Basis.from_modes(modes, system.q0, system.mass(system.q0))
    rom = rj.reduce(system, basis, rj.Galerkin(constraints=1))
    assert rom.m == 1
    # With the balance of energy, as the system's own test runs it.
    truth, model = run(system, TIMES, audit=True), run(rom, TIMES)
    assert np.max(np.abs(truth.q - model.q)) <= 10 * EXACT
    for formulation in ("minimal", "joint"):
        with pytest.raises(
            rj.ReductionError, match=f"'edge' holds velocities.*not \"{formulation}\""
        ):
            rj.reduce(system, basis, formulation)
    # What is refused names no formulation that is refused too.
    few = rj.pod(truth, rank=1)
    with pytest.raises(rj.ReductionError, match="No other formulation"):
        rj.reduce(system, few)


@pytest.mark.slow
def test_modes_and_equilibrium_at_rest():
    """Along the edge a spring moves the mass, and across it nothing does."""
    body = rj.RigidBody("body", MASS, INERTIA)
    springs = [
        rj.Bushing(body.at(), rj.ground.at((0.1, 0.2)), (50.0, 80.0, 3.0)),
    ]
    system = rj.assemble(rj.Scene([body], [rj.KnifeEdge(body.at(), rj.ground.at())], springs))
    assert np.allclose(rj.equilibrium(system), [0.1, 0.0, 0.0], atol=1e-12)
    known = np.sqrt(np.sort([50.0 / MASS, 3.0 / INERTIA]))
    found = rj.modes(system, rj.equilibrium(system))
    assert np.allclose(found.frequencies, known, rtol=1e-9)
    with pytest.raises(rj.InputError, match="modes: joint .* holds velocities.*at rest"):
        rj.modes(system, v=np.ones(3))


@pytest.mark.slow
def test_gradients_pass_through_rows_of_velocities():
    def late(inertia):
        return run(rj.assemble(sleigh(inertia)), TIMES, max_steps=2000)["sleigh.phi"][-1]

    checked = rj.check_gradient(late, jnp.asarray(INERTIA))
    assert checked.error <= 1e-6, checked
