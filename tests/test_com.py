"""Bodies whose frame is apart from their centre of mass, against the same ones moved by hand."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tolerances import IDENTITY

import romjax as rj
from romjax.assembly.disassemble import disassemble

r = rj.spatial
MASS, INERTIA, LENGTH, ANGLE, SPIN, GRAVITY = 2.0, 0.1, 0.3, 0.4, 0.7, 9.81


def pendulum(com) -> rj.Scene:
    """It hangs on the origin of its frame."""
    body = rj.RigidBody("link", MASS, INERTIA, angle=ANGLE, angular_velocity=SPIN, com=com)
    return rj.Scene([body], [rj.Revolute(body.at(), rj.ground.at())], [rj.Gravity((0.0, -GRAVITY))])


def test_a_pendulum_of_its_com():
    """φ'' = −m g l sin φ / (I + m l²), and its derivative by where the centre is."""

    def turning(length):
        return accelerations(pendulum(jnp.stack([0.0 * length, -length])))[2]

    def closed(length):
        whole = INERTIA + MASS * length**2
        return -MASS * GRAVITY * length * jnp.sin(ANGLE) / whole

    found = jax.jit(jax.value_and_grad(turning))(LENGTH)
    np.testing.assert_allclose(found, jax.value_and_grad(closed)(LENGTH), rtol=IDENTITY)


@eqx.filter_jit
def accelerations(scene: rj.Scene):
    system = rj.assemble(scene)
    return system.acceleration(0.0, system.q0, system.v0)[0]


def moving(com=None):
    """A body in space, with its frame where `com` says, or in the centre of mass."""
    turn = r.rotation((1.0, 2.0, 3.0), 0.5)
    still = np.zeros(3) if com is None else np.array(com)
    inertia, speed, spin = (1.0, 0.8, 0.7), np.array([1.0, 2.0, 3.0]), np.array([0.3, -0.4, 0.5])
    away = -np.asarray(r.RigidBody("x", 1.0, inertia, orientation=turn).pose(still).position)
    return r.RigidBody(
        "body",
        MASS,
        inertia,
        position=away,
        orientation=turn,
        velocity=speed + np.cross(spin, away),
        angular_velocity=spin,
        points={"tip": still + np.array([0.1, 0.0, 0.2])},
        com=com,
    )


def test_a_frame_apart_changes_no_motion():
    plain, other = moving(), moving((0.1, 0.2, -0.3))
    np.testing.assert_allclose(np.array(other.start()), np.array(plain.start()), atol=IDENTITY)
    places = [np.asarray(body.pose("tip").position) for body in (plain, other)]
    np.testing.assert_allclose(*places, atol=IDENTITY)
    # Coordinates at the start are those of a body that is put there.
    again = other.started(*other.start())
    for name in ("position", "velocity", "angular_velocity"):
        given, found = (np.asarray(getattr(body, name)) for body in (other, again))
        np.testing.assert_allclose(found, given, atol=IDENTITY)
    brought = other.placed("tip", rj.ground.pose((1.0, 2.0, 3.0)))
    np.testing.assert_allclose(brought.pose("tip").position, [1, 2, 3], atol=IDENTITY)
    with pytest.raises(rj.SceneError, match=r"body 'body': com has shape \(2,\)"):
        moving((0.0, 0.0, 0.0)).__class__("body", 1.0, (1, 1, 1), com=(0.0, 1.0))


def test_files_and_other_bodies_keep_markers(tmp_path):
    """A scene comes back as it was, and a body put in another's place, its frame elsewhere, holds
    its joint where it was.
    """
    plain, other = moving(), moving((0.1, 0.2, -0.3))
    spring = rj.Spring(other.at("tip"), rj.ground.at((1.0, 0.0, 0.0)), 100.0)
    scene = rj.Scene([other], [], [spring])
    scene.save(tmp_path / "scene.toml")
    assert eqx.tree_equal(rj.load_scene(tmp_path / "scene.toml"), scene)
    for body in (plain, other):
        (effect,) = scene.replace("body", body).effects
        np.testing.assert_allclose(effect.a.point, body.named_points()["tip"], atol=IDENTITY)
    first, second = (accelerations(x) for x in (scene, scene.replace("body", plain)))
    np.testing.assert_allclose(first, second, atol=10 * IDENTITY)


def test_a_system_gives_its_scene_back():
    """Markers of joints and effects are where they were, in the plane and in space."""
    body = moving((0.1, 0.2, -0.3))
    ends = body.at("tip", axis=(0.0, 1.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0))
    spring = rj.Spring(body.at((0.3, 0.1, 0.2)), ends[1], 100.0)
    for scene in (
        pendulum(jnp.array([0.2, -LENGTH])),
        rj.Scene([body], [r.Spherical(*ends, name="ball")], [spring]),
    ):
        found = disassemble(rj.assemble(scene))
        assert [m.body for m in markers(found)] == [m.body for m in markers(scene)]
        for marker, wanted in zip(markers(found), markers(scene), strict=True):
            np.testing.assert_allclose(marker.point, wanted.point, atol=IDENTITY)
            np.testing.assert_allclose(marker.turn, wanted.turn, atol=IDENTITY)


def markers(scene: rj.Scene):
    return [marker for part in (*scene.joints, *scene.effects) for marker in part.markers]
