"""Starts that `consistent_scene` closes: what is set stays, what is left out follows."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
from comparison import assert_close
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax import spatial
from romjax.cli import main

CRANK, COUPLER, ROCKER, GROUND = 0.1, 0.4, 0.3, 0.35


def bar(angle=0.3, length=1.0, **fields) -> rj.Scene:
    """A bar in the plane on a hinge at its start."""
    body = rj.Beam("bar", 1.0, length, **fields).placed("start", rj.ground.pose(), angle=angle)
    return rj.Scene([body], [rj.Revolute(body.at("start"), rj.ground.at())])


def spatial_bar(joint=spatial.Revolute, signal=None, **fields) -> rj.Scene:
    """A bar in space along x, on a joint at its start, driven by a signal about z."""
    body = spatial.RigidBody("bar", 1.0, (0.01, 0.1, 0.1), position=(0.5, 0.0, 0.0), **fields)
    ends = body.at((-0.5, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0))
    drives = [] if signal is None else [rj.PrescribedAngle(*ends, signal)]
    return rj.Scene([body], [joint(*ends), *drives])


def four_bar(crank=0.0, rocker=0.0, off=0.0, amplitudes=(0.0, 0.0), signal=None) -> rj.Scene:
    """A flexible coupler between a crank at 1 rad and a rocker, both with speeds, whose angles are
    guessed, `off` those of a closed loop [degrees].
    """
    tip = CRANK * np.exp(1j)
    apart = GROUND - tip
    opening = (COUPLER**2 + abs(apart) ** 2 - ROCKER**2) / (2 * COUPLER * abs(apart))
    along = np.angle(apart) + np.arccos(opening)
    end = tip + COUPLER * np.exp(1j * along)
    turned = np.radians(off)
    one = rj.Beam("crank", 0.05, CRANK, angular_velocity=crank)
    one = one.placed("start", rj.ground.pose(), angle=1.0)
    two = rj.Beam("coupler", 0.108, COUPLER, EI=7.0, modes=2, amplitudes=amplitudes)
    two = two.placed("start", one.pose("end"), angle=along + turned)
    three = rj.Beam("rocker", 0.08, ROCKER, angular_velocity=rocker)
    lean = np.angle(end - GROUND) - turned
    three = three.placed("start", rj.ground.pose((GROUND, 0.0)), angle=lean)
    joints = [
        rj.Revolute(one.at("start"), rj.ground.at()),
        rj.Revolute(one.at("end"), two.at("start")),
        rj.Revolute(two.at("end"), three.at("end")),
        rj.Revolute(three.at("start"), rj.ground.at((GROUND, 0.0))),
    ]
    if signal is not None:
        joints.append(rj.PrescribedAngle(one.at(), rj.ground.at(), signal, name="drive"))
    return rj.Scene([one, two, three], joints, [rj.Gravity()])


def ratio(scene) -> float:
    """The speed of the rocker for one of the crank: the coupler carries no speed along itself."""
    one, two, three = (complex(*b.pose("end").position) for b in scene.bodies)
    along = two - one
    return float((np.conj(along) * 1j * one).real / (np.conj(along) * 1j * (three - GROUND)).real)


# Velocities.


def test_a_speed_that_is_set_stays_and_the_velocity_follows():
    """V = ω × r of the centre of mass, which was left out."""
    (body,) = rj.consistent_scene(bar(angular_velocity=10.0)).bodies
    assert float(body.angular_velocity) == 10.0
    assert_close(body.velocity, 5.0 * np.array([-np.sin(0.3), np.cos(0.3)]), IDENTITY)


def test_so_does_one_in_space():
    spin = (1.0, 2.0, 3.0)
    (body,) = rj.consistent_scene(spatial_bar(spatial.Spherical, angular_velocity=spin)).bodies
    assert_close(body.angular_velocity, spin, IDENTITY)
    assert_close(body.velocity, np.cross(spin, (0.5, 0.0, 0.0)), IDENTITY)


def test_a_velocity_that_is_set_turns_the_bar():
    (body,) = rj.consistent_scene(bar(angle=0.0, velocity=(0.0, 2.0))).bodies
    assert_close(body.velocity, (0.0, 2.0), IDENTITY)
    assert_close(body.angular_velocity, 4.0, IDENTITY)


def test_speeds_that_agree_both_stay():
    """Closing a scene that is closed changes nothing."""
    once = rj.consistent_scene(bar(angular_velocity=10.0))
    again = rj.consistent_scene(once)
    assert_close(again.bodies[0].velocity, once.bodies[0].velocity, IDENTITY)
    assert float(again.bodies[0].angular_velocity) == 10.0


def test_speeds_that_contradict_each_other_are_named():
    """Each with the nearest that do not: of a bar whose kinetic energy is ½ m v² + ½ J ω²."""
    inertia = 1.0 / 12.0
    nearest = (inertia * 3.0 + 0.5 * 1.0) / (inertia + 0.25)
    words = rf"velocity of body 'bar' is \(0, 1\), the nearest \(0, {nearest / 2:.6g}\).*"
    words += f"angular_velocity of body 'bar' is 3, the nearest {nearest:.6g}.*leave out"
    with pytest.raises(rj.InputError, match=words):
        rj.consistent_scene(bar(0.0, angular_velocity=3.0, velocity=(0.0, 1.0)))


@pytest.mark.slow
def test_a_speed_that_a_joint_forbids_is_named():
    words = r"angular_velocity of body 'bar' is \(1, 2, 3\), the nearest \(0, 0, 3\)"
    with pytest.raises(rj.InputError, match=words):
        rj.consistent_scene(spatial_bar(angular_velocity=(1.0, 2.0, 3.0)))


@pytest.mark.slow
def test_the_drive_wins_over_what_is_left_out_and_contradicts_what_is_set():
    (body,) = rj.consistent_scene(spatial_bar(signal=rj.Ramp(4.0))).bodies
    assert_close(body.angular_velocity, (0.0, 0.0, 4.0), IDENTITY)
    assert_close(body.velocity, (0.0, 2.0, 0.0), IDENTITY)
    words = r"angular_velocity of body 'bar' is \(0, 0, 5\), the nearest \(0, 0, 4\)"
    with pytest.raises(rj.InputError, match=words):
        rj.consistent_scene(spatial_bar(signal=rj.Ramp(4.0), angular_velocity=(0.0, 0.0, 5.0)))


def test_rates_of_modes_that_are_set_stay():
    """The hinge moves with the modes, and the centre of mass so that it stands still."""
    scene = bar(EI=5.0, modes=2, rates=(0.2, -0.1), angular_velocity=2.0)
    closed = rj.consistent_scene(scene)
    (body,) = closed.bodies
    assert_close(body.rates, (0.2, -0.1), IDENTITY)
    assert float(body.angular_velocity) == 2.0
    system = rj.assemble(closed)
    assert_close(jax.jit(rate)(system), np.zeros(2), IDENTITY)


def rate(system):
    return jax.jvp(lambda q: system.constraint(0.0, q), (system.q0,), (system.v0,))[1]


def test_what_follows_has_derivatives():
    """Of v = ½ ω (−sin φ, cos φ), forward and in a batch."""

    def velocity(spin, angle):
        return rj.consistent_scene(bar(angle, angular_velocity=spin)).bodies[0].velocity

    found = jax.jit(jax.jacfwd(velocity, (0, 1)))(10.0, 0.3)
    c, s = np.cos(0.3), np.sin(0.3)
    assert_close(found, [[-0.5 * s, 0.5 * c], [-5.0 * c, -5.0 * s]], SOLVED)


# Loops.


def test_a_loop_is_closed_by_frames():
    """Guessed by 12 degrees: the coupler stays straight, and the crank has its speed."""
    closed = rj.consistent_scene(four_bar(crank=5.0, off=12.0))
    crank, coupler, rocker = closed.bodies
    assert not np.any(coupler.amplitudes)
    assert not np.any(coupler.rates)
    assert float(crank.angular_velocity) == 5.0
    assert_close(rocker.angular_velocity, 5.0 * ratio(closed), IDENTITY)
    assert_close(coupler.pose("end").position, rocker.pose("end").position, IDENTITY)


def test_amplitudes_that_are_given_stay():
    closed = rj.consistent_scene(four_bar(off=5.0, amplitudes=(0.002, -0.001)))
    assert_close(closed.bodies[1].amplitudes, (0.002, -0.001), IDENTITY)
    system = rj.assemble(closed)
    assert_close(system.constraint(0.0, system.q0), np.zeros(8), IDENTITY)


@pytest.mark.slow
def test_a_driven_crank_stays_where_it_is_placed():
    closed = rj.consistent_scene(four_bar(off=12.0, signal=rj.Ramp(10.0)))
    assert_close(closed.bodies[0].angle, 1.0, IDENTITY)
    assert_close(closed.bodies[2].angular_velocity, 10.0 * ratio(closed), IDENTITY)


def test_speeds_of_a_loop_contradict_each_other():
    with pytest.raises(rj.InputError, match="of body 'crank' is 5, .* of body 'rocker' is -7, "):
        rj.consistent_scene(four_bar(crank=5.0, rocker=-7.0))


def test_bodies_bend_where_frames_cannot():
    """A beam whose one end is clamped askew and whose other end stays on a line, with a warning."""
    beam = rj.Beam("beam", 1.0, 1.0, EI=5.0, modes=3, position=(0.5, 0.0))
    joints = [
        rj.Weld(beam.at("start"), rj.ground.at((0.0, 0.0), 0.1)),
        rj.PointOnLine(beam.at("end"), rj.ground.at()),
    ]
    with pytest.warns(UserWarning, match="modes are displaced: of 'beam' by"):
        closed = rj.consistent_scene(rj.Scene([beam], joints))
    system = rj.assemble(closed)
    apart = jax.jit(lambda q: system.constraint(0.0, q))(system.q0)
    assert_close(apart, np.zeros(4), IDENTITY)


# What counts as closed, in mechanisms of any size.


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e3])
def test_a_start_is_refused_alike_in_any_size(size):
    """A bar that is off its hinge by some share of its length, or moves as it cannot."""
    ts = np.array([0.0, 1e-3])

    def pendulum(off=0.0, speed=0.0):
        turned = size**2 * np.array([0.01, 0.1, 0.1])
        at, moving = (0.5 * size * (1 + off), 0.0, 0.0), (speed * size, 0.5 * size, 0.0)
        turning = {"velocity": moving, "angular_velocity": (0.0, 0.0, 1.0)}
        body = spatial.RigidBody("bar", 1.0, turned, position=at, **turning)
        hinge = spatial.Revolute(body.at((-0.5 * size, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0)))
        return rj.assemble(rj.Scene([body], [hinge]))

    def status(**numbers):
        return zoo.run(pendulum(**numbers), ts, throw=False).status

    assert status(off=1e-10) == rj.Status.SUCCESS
    assert status(speed=1e-10) == rj.Status.SUCCESS
    for wrong in ({"off": 0.01}, {"off": 1e-6}, {"speed": 0.01}, {"speed": 1e-6}):
        assert status(**wrong) == rj.Status.INCONSISTENT_START


@pytest.mark.parametrize("size", [1e-6, 1e3])
def test_loops_of_any_size_close(size):
    """What is left is a share of the size."""
    scene = jax.tree.map(jnp.asarray, bar(0.2, length=size, angular_velocity=3.0))
    away = rj.Scene([scene.bodies[0].started(*moved(scene, size))], scene.joints)
    (body,) = rj.consistent_scene(away).bodies
    assert_close(body.pose("start").position / size, (0.0, 0.0), IDENTITY)
    assert_close(np.hypot(*body.velocity) / size, 1.5, IDENTITY)


def moved(scene, size):
    q, v = scene.bodies[0].start()
    return q + jnp.array([0.1 * size, -0.05 * size, 0.1]), v


# In files.

TWO_BARS = """\
format = 1
consistent = true

[bodies.bar]
type = "Beam"
mass = 1.0
length = 1.0
angular_velocity = 10.0
angle_deg = 60
place = { point = "start", at = "ground" }

[joints]
hinge = { type = "Revolute", a = "bar.start", b = "ground" }

[joints.drive]
type = "PrescribedAngle"
a = "bar"
b = "ground"
signal = { type = "Ramp", rate = 10.0 }
"""


def test_files_keep_what_is_set(tmp_path, capsys):
    path = tmp_path / "bar.toml"
    path.write_text(TWO_BARS)
    (body,) = rj.load_scene(path).bodies
    assert_close(body.angle, np.pi / 3, IDENTITY)
    assert float(body.angular_velocity) == 10.0
    path.write_text(TWO_BARS.replace("rate = 10.0", "rate = 8.0"))
    words = r":8: \[bodies.bar\] angular_velocity: .* is 10, the nearest 8\."
    with pytest.raises(rj.SceneFileError, match=words):
        rj.load_scene(path)


@pytest.mark.slow
def test_check_says_what_moves_and_warns_of_much(tmp_path, capsys):
    """An offset that is given moves the bar by 60 degrees."""
    path = tmp_path / "bar.toml"
    path.write_text(TWO_BARS.replace("rate = 10.0", "rate = 10.0, offset_deg = 0.0"))
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    assert "moved        bar: 0.5 m, 60 degrees" in said
    assert "warning      bar: further than 10%" in said
    path.write_text(TWO_BARS.replace("rate = 10.0", "rate = 10.0, offset_deg = 59.0"))
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    assert "moved        bar: 0.00873 m, 1 degrees" in said
    assert "speeds       of bar follow" in said
    assert "warning" not in said
    path.write_text(TWO_BARS.replace("consistent = true", ""))
    assert main(["check", str(path)]) == 0
    assert "joints do not hold yet; add consistent = true at the top" in capsys.readouterr().out
