"""Joints in space: what each does, against closed forms; what all share: random scenes."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax.assembly.part import part
from romjax.linalg import quaternions

r = rj.spatial
HELD = rj.Baumgarte(alpha=12.0, beta=36.0)
TIGHT = {"rtol": 1e-11, "solver": diffrax.Dopri8(), "stabilization": HELD}
CHANCE = np.random.default_rng(3)


def body(name: str, **fields) -> rj.AbstractBody:
    return r.RigidBody(name, 2.0, (0.3, 0.4, 0.5), **fields)


ONE, TWO = body("one"), body("two")


# Ten turns and more


@pytest.fixture(scope="module")
def planets() -> tuple[rj.AbstractSystem, rj.Trajectory]:
    """A planetary gear: a driven sun, a ring that stands still, a planet on a carrier."""
    tilt = CHANCE.normal(size=4)

    def placed(*point):
        return quaternions.rotate(tilt[None], np.array([point], float))[0]

    def wheel(name, *point):
        return body(name, position=placed(*point), orientation=tilt)

    sun, carrier, planet = (
        wheel("sun", 0, 0, 0),
        wheel("carrier", 0, 0, 0),
        wheel("planet", 1, 0, 0),
    )
    middle = rj.ground.at((0, 0, 0), rotation=tilt)
    joints = [
        r.Revolute(sun.at(), middle),
        r.Revolute(carrier.at(), middle),
        r.Revolute(planet.at(), carrier.at((1, 0, 0))),
        r.Gear(planet.at(), sun.at(), carrier.at((1, 0, 0)), carrier.at(), ratio=-2.0),
        r.Gear(planet.at(), carrier.at(), carrier.at((1, 0, 0)), middle, ratio=-4.0, name="ring"),
    ]
    effects = [r.Torque(sun.at(), (0, 0, 1), rj.Constant(3.0), frame="body")]
    system = rj.assemble(rj.Scene([sun, carrier, planet], joints, effects))
    return system, rj.simulate(system, jnp.linspace(0.0, 9.0, 10), **TIGHT)


@pytest.mark.slow
def test_a_planetary_gear(planets):
    """Of one freedom: with teeth 1 : ½ : 2 of sun, planet and ring, the carrier turns a third as
    fast as the sun; the inertia at the sun is that of all, by their speeds.
    """
    system, run = planets
    # φ_p − φ_c = −2 (φ_s − φ_c) and φ_p − φ_c = −4 φ_c give φ_c = φ_s / 3, φ_p = −φ_s.
    inertia = 0.5 + (0.5 + 2.0) / 9 + 0.5
    angle = 0.5 * 3.0 / inertia * np.asarray(run.t) ** 2
    assert angle[-1] > 10 * 2 * np.pi
    counted = {label: run.q[:, i] for i, label in enumerate(system.structure.labels)}
    found = counted["counter 2 of ring.angle"]
    assert_close(found, angle / 3, SOLVED, angle[-1])
    half = [run[f"sun.p{k}"] for k in range(4)]
    start = np.array([x[0] for x in half])
    cosine = sum(x * s for x, s in zip(half, start, strict=True)) / (start @ start)
    assert_close(cosine, np.cos(angle / 2), SOLVED, angle[-1])
    energy = rj.energy(system, run)
    assert_close(energy.balance, 0, SOLVED, np.max(energy.total))


@pytest.mark.slow
def test_a_screw():
    """A bolt that falls: m g = (m + J (2π/p)²) z̈, over ten turns."""
    pitch = 1.0
    tilt = np.array([0.3, 0.5, -0.2, 0.7])
    down = quaternions.rotate(tilt[None], np.array([[0.0, 0.0, -9.81]]))[0]
    bolt = body("bolt", orientation=tilt)
    screw = r.Screw(bolt.at(), rj.ground.at((0, 0, 0), rotation=tilt), pitch=pitch)
    system = rj.assemble(rj.Scene([bolt], [screw], [rj.Gravity(down)]))
    run = rj.simulate(system, jnp.linspace(0.0, 5.0, 6), audit=False, **TIGHT)
    fall = 0.5 * 2.0 * 9.81 / (2.0 + 0.5 * (2 * np.pi / pitch) ** 2) * np.asarray(run.t) ** 2
    assert fall[-1] > 10 * pitch
    along = run.q[:, :3] @ (down / 9.81)
    assert_close(along, fall, SOLVED, fall[-1])


@pytest.mark.exhaustive
def test_constant_velocity():
    """Shafts at 40° turn by equal angles, through a turn and more."""
    angle, speed = np.radians(40.0), 3.0
    bend, axis = r.rotation((0, 1, 0), angle), np.array([np.sin(angle), 0.0, np.cos(angle)])
    shaft = body("shaft", angular_velocity=(0, 0, speed))
    other = body("other", orientation=bend, angular_velocity=speed * axis)
    joints = [
        r.Revolute(shaft.at(), rj.ground.at((0, 0, 0))),
        r.Cylindrical(other.at(), rj.ground.at((0, 0, 0), axis=axis)),
        r.ConstantVelocity(other.at(), shaft.at()),
    ]
    effects = [r.Torque(shaft.at(), (0, 0, 1), rj.Constant(0.4), frame="body")]
    run = rj.simulate(
        rj.assemble(rj.Scene([shaft, other], joints, effects)), jnp.linspace(0.0, 3.0, 4), **TIGHT
    )
    # Both have the inertia 0.5 kg m² about their axes.
    wanted = speed * run.t + 0.2 * run.t**2
    back = np.broadcast_to(quaternions.conjugate(np.asarray(bend)), (len(run.t), 4))
    turns = np.asarray(run.q[:, 3:7]), quaternions.product(back, np.asarray(run.q[:, 10:14]))
    for own in turns:
        found = 2 * np.arctan2(own[:, 3], own[:, 0])
        assert_close(np.sin(0.5 * (found - wanted)), 0, SOLVED, 10.0)


@pytest.mark.exhaustive
def test_a_bead_on_a_helix():
    """Slides down with g sin² of the slope's angle, over several turns."""
    bead = body("bead", position=(0.5, 0.0, 0.0))
    joints = [
        r.PointOnCurve(bead.at(), rj.ground.at((0, 0, 0)), r.Helix(0.5, 1.0)),
    ]
    system = rj.assemble(rj.Scene([bead], joints, [rj.Gravity((0, 0, -9.81))]))
    run = rj.simulate(system, jnp.linspace(0.0, 3.0, 4), **TIGHT)
    share = 1.0 / (1.0 + (2 * np.pi * 0.5) ** 2)
    assert_close(run.q[:, 2], -0.5 * 9.81 * share * run.t**2, SOLVED, 4.0)


# What counts, and what does not


def test_no_counter_where_nothing_counts():
    ends = ONE.at((0, 0, 0)), rj.ground.at((0, 0, 0))
    plain = [rj.PrescribedAngle(*ends, rj.Ramp(0.0))], [rj.TorsionDamper(*ends, damping=1.0)]
    assert rj.assemble(rj.Scene([ONE], *plain)).n == 7
    counts = rj.assemble(rj.Scene([ONE], [], [rj.TorsionSpring(*ends, stiffness=1.0)]))
    assert (counts.n, counts.m) == (8, 1)
    assert counts.structure.labels[-1] == "counter of TorsionSpring(one, ground).angle"


def test_a_part_of_a_system_counts_nothing():
    """Without the joint that holds it, a counter would be free; no reduction samples it."""
    ends = ONE.at((0, 0, 0)), rj.ground.at((0, 0, 0))
    system = rj.assemble(rj.Scene([ONE], [], [rj.TorsionSpring(*ends, stiffness=1.0)]))
    rows = [range(len(group.coordinates.rows)) for group in system.bodies]
    with pytest.raises(rj.ReductionError, match=r"counter of TorsionSpring\(one, ground\)"):
        part(system, rows, [jnp.ones(1)] * len(rows), [0])


def test_counters_start_at_the_angle():
    """In their scene they are no parts of it."""
    wheel = body("wheel", orientation=r.rotation((0, 0, 1), 2.0), angular_velocity=(0, 0, 3.0))
    ends = wheel.at(), rj.ground.at((0, 0, 0), 0.5)
    system = rj.assemble(rj.Scene([wheel], [], [rj.TorsionSpring(*ends, stiffness=1.0)]))
    assert_close(np.asarray(system.q0)[-1], 1.5, IDENTITY)
    assert_close(np.asarray(system.v0)[-1], 3.0, IDENTITY)
    assert_close(jax.jit(lambda q: system.constraint(0.0, q))(system.q0), 0, IDENTITY)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: r.Gear(ONE.at(), TWO.at(), ONE.at(), rj.ground.at((0, 0, 0)), ratio=2.0),
            "bearing",
        ),
        (lambda: r.Screw(ONE.at(), TWO.at(), pitch=np.nan), "pitch"),
        (lambda: r.PointOnCurve(ONE.at(), TWO.at(), r.Helix(1.0, 0.0)), "pitch is 0"),
        (lambda: r.PointOnPlane(ONE.at(), rj.ground.at()), "in the plane"),
    ],
)
def test_what_a_joint_refuses(make, words):
    with pytest.raises(rj.SceneError, match=words):
        make()


@pytest.mark.exhaustive
def test_gradients_through_turns():
    """Of a wheel on a torsion spring after three turns, by its stiffness: forward and central."""
    ends = (0, 0, 0), (0, 0, 0)

    def end(stiffness):
        wheel = body("wheel", angular_velocity=(0, 0, 30.0))
        joints = [r.Revolute(wheel.at(ends[0]), rj.ground.at(ends[1]))]
        spring = rj.TorsionSpring(wheel.at(), rj.ground.at((0, 0, 0)), stiffness=stiffness)
        system = rj.assemble(rj.Scene([wheel], joints, [spring]))
        adjoint = diffrax.ForwardMode()
        run = rj.simulate(system, jnp.array([0.0, 0.7]), adjoint=adjoint, **TIGHT)
        return run.q[-1, -1]

    value, slope = jax.jit(lambda k: jax.jvp(end, (k,), (jnp.ones(()),)))(jnp.asarray(0.5))
    # J φ̈ = −k φ with J = k: φ = 30 sin t at k = ½, of which ω = √(k/J) changes as ω / 2k.
    assert value > 3 * 2 * np.pi
    assert_close(value, 30.0 * np.sin(0.7), SOLVED, 30.0)
    assert_close(slope, 30.0 * (0.7 * np.cos(0.7) - np.sin(0.7)), DIFFERENCED, 30.0)
