"""Contact and friction: restitution by an exact law, and a block on an incline."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from scipy.optimize import brentq
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax.integrate.default import default_method, start_frequencies

G = 9.81
MASS, STIFFNESS = 0.4, 2e5


def ball(y, speed, curve, **contact) -> rj.AbstractSystem:
    body = rj.RigidBody("ball", MASS, 0.01, position=(0.0, y), velocity=(0.0, speed))
    touch = rj.Contact(body.at(), rj.ground.at(), curve, stiffness=STIFFNESS, **contact)
    return rj.assemble(rj.Scene([body], [], [touch]))


class Linear(rj.Contact):
    """A force in proportion to the depth."""

    def force(self, depth, inside, normal, rate):
        return jnp.where(inside, self.stiffness * depth, 0.0) * normal


def test_a_contact_is_as_stiff_as_its_own_law():
    """The slope of k δ, and of k δ^(3/2) at a millimetre, decides on the method."""
    body = rj.RigidBody("ball", MASS, 0.01, position=(0.0, 0.5))
    ends, ts = (body.at(), rj.ground.at()), np.linspace(0.0, 1.0, 101)
    for law, slope in ((Linear, 1.0), (rj.Contact, 1.5 * np.sqrt(1e-3))):
        for stiffness, solver in ((1e6, diffrax.Dopri8), (3e10 * MASS, None)):
            contact = law(*ends, rj.Line(), stiffness=stiffness)
            system = rj.assemble(rj.Scene([body], [], [contact]))
            start = start_frequencies(system, ts, system.q0, system.v0)
            fast = np.sqrt(slope * stiffness / MASS)
            assert_close(start.acting, fast, DIFFERENCED, fast)
            method = default_method(system, ts, None, start).solver
            expected = solver or (rj.Rodas5P if law is Linear else diffrax.Dopri8)
            assert isinstance(method, expected)


def test_restitution():
    """Of m δ'' = −k δ^n (1 + D δ'), by the integral of v / (1 + D v), whatever m, k and n are."""
    speed, loss = 1.0, 0.3
    system = ball(0.35, -speed, rj.Circle(0.3), dissipation=loss)
    run = zoo.run(system, np.array([0.0, 0.15]), rtol=1e-11)

    def integral(v):
        return v / loss - np.log1p(loss * v) / loss**2

    left = brentq(lambda v: integral(speed) - integral(-v), 0.1, 1.0, xtol=1e-14)
    assert abs(np.asarray(run.v)[-1, 1] - left) <= SOLVED
    assert abs(left - (1 - 2 / 3 * loss * speed)) < 0.05


@pytest.mark.parametrize(
    ("curve", "foot", "out"),
    [
        (rj.Circle(0.5), (0.3, 0.4), (0.6, 0.8)),
        (rj.Circle(0.5, hollow=True), (0.3, 0.4), (-0.6, -0.8)),
    ],
)
def test_depths_are_distances(curve, foot, out):
    """However deep, as in spheres and cylinders, so that the force has an energy."""
    ends = rj.RigidBody("ball", MASS, 0.01).at(), rj.ground.at()
    contact = rj.Contact(*ends, curve, stiffness=STIFFNESS)
    depth, inside, way = jax.jit(lambda x: contact.depth(x))(np.array(foot) - 0.2 * np.array(out))
    assert inside
    assert abs(depth - 0.2) <= IDENTITY
    assert np.allclose(way, out, rtol=0, atol=IDENTITY)


# Coefficients of polynomials, and points below them.
BELOW = [
    ([0.1, 0.0, 1.0, 0.0], (0.5, 0.1)),
    ([0.0, 0.0, -1.0, 0.0], (0.3, -0.2)),
    ([0.0, 0.0, -1.0, 0.0], (0.05, -0.8)),  # beyond the centre of curvature
    ([0.0, 0.0, 0.0, 1.0], (-0.5, -1.0)),  # as near in front of the curve as below it
    ([0.0, 0.0, 0.0, 1.0], (1.0, -1000.0)),  # the foot is far away, where the curve is steep
    ([0.0, 0.0, -1.0, 0.0], (0.0, -0.5)),  # the centre of curvature
]


def test_a_polynomial_is_as_far_as_its_nearest_point():
    """With all derivatives: unit vectors away from that, the curvature k / (1 + k d) of lines of
    equal distance, −n_y xᵏ by coefficients; in the centre of curvature finite ones.
    """

    @jax.jit
    @jax.vmap
    def found(coefficients, point):
        def gap(coefficients, point):
            return rj.Polynomial(coefficients).distance(point)

        bends = jax.jacfwd(jax.grad(gap, 1), 1)(coefficients, point)
        return gap(coefficients, point), *jax.grad(gap, (0, 1))(coefficients, point), bends

    coefficients, points = map(np.array, zip(*BELOW, strict=True))
    for i, (gap, by_coefficients, normal, bends) in enumerate(
        zip(*map(np.asarray, found(coefficients, points)), strict=True)
    ):
        curve, point = np.polynomial.Polynomial(coefficients[i]), points[i]
        across = np.polynomial.Polynomial([-point[0], 1.0])
        feet = (across + (curve - point[1]) * curve.deriv()).trim().roots().real
        feet = np.stack([feet, curve(feet)])
        foot = feet[:, np.argmin(np.linalg.norm(feet.T - point, axis=1))]
        distance = np.linalg.norm(foot - point)
        assert abs(gap + distance) <= IDENTITY * distance
        way, slope = (foot - point) / distance, curve.deriv()(foot[0])
        if i == len(BELOW) - 1:
            assert np.all(np.isfinite([*normal, *by_coefficients, *bends.flat]))
            continue
        np.testing.assert_allclose(normal, way, rtol=0, atol=SOLVED)
        powers = foot[0] ** np.arange(4)
        np.testing.assert_allclose(by_coefficients, -way[1] * powers, rtol=SOLVED, atol=SOLVED)
        k = -curve.deriv(2)(foot[0]) / (1 + slope**2) ** 1.5
        along = np.array([way[1], -way[0]])
        wanted = k / (1 - k * distance) * np.outer(along, along)
        np.testing.assert_allclose(bends, wanted, rtol=0, atol=SOLVED)


def test_energy_comes_back_without_dissipation():
    """From any height, to within the tolerance of the steps: one that passes the surface on its way
    out, or a first one inside that does not know how stiff it is, misses up to eight times as much.
    """
    heights = 0.31 + 0.01 * np.arange(20)
    systems = [ball(height, -1.0, rj.Circle(0.3), dissipation=0.0) for height in heights]
    after = [float(zoo.run(system, np.array([0.0, 0.25])).v[-1, 1]) for system in systems]
    np.testing.assert_allclose(after, 1.0, rtol=zoo.TIGHT)
    run = zoo.run(systems[4], np.array([0.0, 0.15]), rtol=1e-11)
    assert abs(np.asarray(run.v)[-1, 1] - 1.0) <= SOLVED


@pytest.fixture(scope="module")
def slide():
    """The way and the last speed of a block on an incline after a second, by its angle."""
    angles = np.array([0.25, 0.40])  # the friction holds up to arctan 0.3 = 0.291

    def run(angle):
        cos, sin = np.cos(angle), np.sin(angle)
        normal = MASS * G * cos / 2
        depth = (normal / STIFFNESS) ** (2 / 3)
        up = np.array([sin, cos])
        block = rj.RigidBody(
            "block", MASS, 0.01, position=-depth * up, angle=-angle, extent=(0.1, 0.04)
        )
        friction = rj.Friction(0.3, creep=1e-3)
        # The line falls to the right.
        touches = [
            rj.Contact(
                block.at((x, 0.0)),  # no lever, or it would rock
                rj.ground.at(angle=-angle),
                rj.Line(),
                stiffness=STIFFNESS,
                dissipation=1.0,
                friction=friction,
            )
            for x in (-0.05, 0.05)
        ]
        system = rj.assemble(rj.Scene([block], [], [*touches, rj.Gravity()]))
        motion = zoo.run(system, np.array([0.0, 1.0]), solver=zoo.RODAS5P, rtol=1e-8)
        down = np.array([cos, -sin])
        q, v = np.asarray(motion.q)[:, :2], np.asarray(motion.v)[:, :2]
        return (q[-1] - q[0]) @ down, v[-1] @ down

    return angles, np.transpose([run(angle) for angle in angles])


def test_a_block_sticks(slide):
    """Below the angle of friction it creeps with speed artanh(tan(angle) / μ) creep."""
    (angle, _), (way, speed) = slide
    wanted = 1e-3 * np.arctanh(np.tan(angle) / 0.3)
    assert abs(speed[0] - wanted) <= 1e-3 * wanted
    assert way[0] <= wanted


def test_a_block_slides(slide):
    """Above, it is accelerated by g (sin − μ cos)."""
    (_, angle), (way, speed) = slide
    wanted = G * (np.sin(angle) - 0.3 * np.cos(angle))
    # A beginning in which the friction grows with the speed.
    assert abs(speed[1] - wanted) <= 5e-3 * wanted
    assert abs(way[1] - wanted / 2) <= 5e-3 * wanted


def test_stribeck():
    friction = rj.Friction(0.2, creep=1e-4, static=0.5, stribeck=0.1)
    assert abs(friction(np.float64(0.01)) - (0.2 + 0.3 * np.exp(-0.01))) <= IDENTITY
    assert abs(friction(np.float64(-10.0)) + 0.2) <= IDENTITY


def test_friction_acts_on_both_bodies():
    """The forces on point and track are opposite, and so are their moments."""
    track = rj.RigidBody("track", 2.0, 0.5, position=(0.3, -0.2), angle=0.4)
    point = rj.RigidBody("point", 1.0, 0.1, position=(0.2, 0.1), velocity=(0.7, -0.2))
    touch = rj.Contact(
        point.at((0.1, 0.0)),
        track.at((-0.1, 0.05), 0.2),
        rj.Circle(1.5),
        stiffness=1e4,
        dissipation=0.5,
        friction=rj.Friction(0.4),
    )
    system = rj.assemble(rj.Scene([track, point], [], [touch]))
    force = np.asarray(jax.jit(system.force)(0.0, system.q0, system.v0))
    assert np.linalg.norm(force[:2]) > 1
    assert np.allclose(force[:2], -force[3:5], rtol=0, atol=IDENTITY * 1e4)
    q, moment = np.asarray(system.q0), force[2] + force[5]
    for i in (0, 3):
        moment += q[i] * force[i + 1] - q[i + 1] * force[i]
    assert abs(moment) <= IDENTITY * 1e4


@pytest.mark.parametrize("speed", [1.0, 100.0])
@pytest.mark.parametrize("radius", [1e-3, 1e-2])
def test_a_fast_ball_does_not_pass_through(speed, radius):
    """It flies freely but for a thousandth of the run; a stiffness with which it turns at a tenth
    of the radius: ½ v² = ⅖ k δ^(5/2).
    """
    stiffness = 1.25 * speed**2 / (0.1 * radius) ** 2.5
    system = flying(radius, stiffness, speed)
    run = rj.simulate(system, np.linspace(0.0, 1.0 / speed, 5), rtol=1e-9, audit=False)
    assert run.is_valid
    np.testing.assert_allclose(run.v[-1, 0], -speed, rtol=DIFFERENCED)


def flying(radius, stiffness, speed) -> rj.AbstractSystem:
    """A ball half a metre before a circle."""
    ball = rj.RigidBody("ball", 1.0, 1.0, position=(-0.5, 0.0), velocity=(speed, 0.0))
    contact = rj.Contact(ball.at(), rj.ground.at((0.0371, 0.0)), rj.Circle(radius), stiffness)
    return rj.assemble(rj.Scene([ball], effects=[contact]))


@pytest.mark.slow
def test_derivatives_through_a_contact_that_loses_energy():
    """Of a ball that starts higher, as accurate as a hundred rtol; against a tight run."""
    rtol = 1e-6

    def end(height, rtol):
        system = ball(height, -1.0, rj.Line(), dissipation=0.2)
        return rj.simulate(system, np.linspace(0.0, 0.3, 4), rtol=rtol, audit=False).q[-1, 1]

    with rj.forward_mode():
        slope = jax.jit(jax.vmap(jax.jacfwd(end), (0, None)))
        heights = np.array([0.0713, 0.1])
        coarse, right = slope(heights, rtol), slope(heights, 1e-10)
    np.testing.assert_allclose(coarse, right, rtol=100 * rtol)


@pytest.mark.slow
def test_lanes_pass_through_no_contact():
    speeds = np.array([1.0, 3.0, 30.0, 100.0])

    def last(speed):
        system = flying(1e-2, 1.25 * speed**2 / 1e-3**2.5, speed)
        run = rj.simulate(system, jnp.linspace(0.0, 1.0, 5) / speed, rtol=1e-9, throw=False)
        return run.v[-1, 0] / speed, run.is_valid

    after, valid = jax.jit(jax.vmap(last))(speeds)
    assert np.all(valid)
    np.testing.assert_allclose(after, -1.0, rtol=DIFFERENCED)


@pytest.mark.slow
def test_steps_end_where_contacts_begin_and_end():
    """Of two balls that bounce no step passes a surface but at its start or end."""
    left, right = (
        rj.RigidBody(name, MASS, 0.01, position=(x, y))
        for name, x, y in [("a", 0, 1), ("b", 1, 0.3)]
    )
    touches = [rj.Contact(one.at(), rj.ground.at(), rj.Line(), STIFFNESS) for one in (left, right)]
    system = rj.assemble(rj.Scene([left, right], [], [rj.Gravity(), *touches]))
    run = rj.simulate(system, np.linspace(0.0, 1.0, 3), dense=256, audit=False)
    ends = np.asarray(run.dense.interpolations.ends)
    heights = np.asarray(run.at(ends[np.isfinite(ends)]).q)[:, [1, 4]]
    passed = (heights[:-1] * heights[1:] < 0) & (
        np.minimum(*np.abs([heights[:-1], heights[1:]])) > 1e-8
    )
    assert not passed.any()
    assert np.sum(np.abs(np.diff(np.sign(heights), axis=0)) > 0) >= 6


@pytest.mark.slow
def test_bounces_from_any_height_are_right():
    """Wherever kinks of the force would have been in the steps, and with few steps in vain, as the
    first one in a contact knows how stiff it is.
    """

    @jax.jit
    @jax.vmap
    def end(height, rtol):
        system = ball(height, -1.0, rj.Line())
        run = rj.simulate(system, jnp.linspace(0.0, 0.3, 4), rtol=rtol, audit=False)
        return run.q[-1, 1], run.stats.num_rejected_steps

    heights = np.linspace(0.05, 0.25, 64)
    ends, rejected = end(np.tile(heights, 2), np.repeat([1e-6, 1e-10], 64))
    found, exact = ends.reshape(2, -1)
    assert np.max(np.abs(found - exact)) <= 5e-6
    assert np.max(rejected[:64]) <= 12


@pytest.mark.instant
def test_what_a_contact_refuses():
    ends = rj.RigidBody("b", 1.0, 1.0).at(), rj.ground.at()
    with pytest.raises(rj.SceneError, match="both static and stribeck"):
        rj.Contact(*ends, rj.Line(), 1.0, friction=rj.Friction(0.1, static=0.2))
    with pytest.raises(rj.SceneError, match=r"Friction.creep is 0.*positive"):
        rj.Contact(*ends, rj.Line(), 1.0, friction=rj.Friction(0.1, creep=0.0))
    with pytest.raises(rj.SceneError, match="stiffness is -1.*not be negative"):
        rj.Contact(*ends, rj.Line(), -1.0)


def test_the_centre_of_a_circle_has_no_direction():
    """No force there, and no NaN."""
    body = rj.RigidBody("ball", 1.0, 0.1)
    contact = rj.Contact(body.at(), rj.ground.at(), rj.Circle(1.0), 100.0)
    system = rj.assemble(rj.Scene([body], [], [contact]))
    assert not np.any(jax.jit(system.force)(0.0, system.q0, system.v0))


def on_a_floor(tip):
    return rj.Contact(tip, rj.ground.at(), rj.Line(), 1e6)


def on_a_rope(tip):
    return rj.Rope(tip, rj.ground.at((0.0, 2.3)), length=1.3, stiffness=1e6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [on_a_floor, on_a_rope])
def test_tips_of_sticks_that_tumble_pass_nothing(kind):
    """However far they turn between two steps, which the errors of free flights do not bound: no
    tip gets deeper than all of its energy.
    """
    inertia, reach, weight, chance = 1 / 12, 0.5, 1.0, np.random.default_rng(1)
    stick = rj.RigidBody("stick", weight, inertia, position=(0.0, 2.0))
    effects = [rj.Gravity(), kind(stick.at((reach, 0.0)))]
    system = rj.assemble(rj.Scene([stick], effects=effects))
    starts = {"spin": np.geomspace(20.0, 1000.0, 40), "angle": chance.uniform(0, 2 * np.pi, 40)}
    ts = np.linspace(0.0, 0.7, 1401)

    def motion(start):
        q0, v0 = system.q0.at[2].set(start["angle"]), system.v0.at[2].set(start["spin"])
        made = rj.simulate(system, ts, q0=q0, v0=v0, audit=False, throw=False, max_steps=None)
        return {"q": made.q, "run": made}

    swept = rj.sweep(motion, starts)
    assert np.all(swept.success)
    x, y, angle = np.moveaxis(np.asarray(swept.values["q"]), -1, 0)
    tip = np.stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])
    energy = 0.5 * inertia * starts["spin"] ** 2 + weight * G * (2.0 + reach)
    if kind is on_a_floor:
        depth, most = -tip[1], (2.5 * energy / 1e6) ** 0.4
    else:
        depth, most = np.hypot(tip[0], tip[1] - 2.3) - 1.3, np.sqrt(2 * energy / 1e6)
    assert np.all(np.max(depth, axis=1) <= most)
    assert np.sum(np.max(depth, axis=1) > 0) > 30
