"""Ropes over pulleys, and pins with clearance."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from scene_files import assert_same
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax import spatial

GRAVITY = 9.81
STIFFNESS = 1e5


def weight(name, mass, x, d):
    body = rj.RigidBody if d == 2 else spatial.RigidBody
    inertia = 0.1 if d == 2 else (0.1, 0.1, 0.1)
    return body(name, mass, inertia, position=(x, -1.0, 0.0)[:d])


def machine(masses, d=2):
    """Two weights on a rope over two pulleys, which their mean pull stretches."""
    one, other = (weight(f"weight{i}", mass, i, d) for i, mass in enumerate(masses))
    left, right = (rj.ground.at((x, 0.0, 0.0)[:d]) for x in (0.0, 1.0))
    tension = 2 * GRAVITY * masses[0] * masses[1] / sum(masses)
    length = 3.0 - tension / STIFFNESS
    rope = rj.Rope(one.at(), other.at(), length, STIFFNESS, via=[left, right], name="rope")
    gravity = rj.Gravity((0.0, -GRAVITY, 0.0)[:d])
    return rj.Scene([one, other], effects=[gravity, rope]), tension


@pytest.mark.parametrize("d", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_atwoods_machine(d):
    """Starts in balance with the stretch of its steady tension, and falls with (m − M) g / (m + M)
    from there without any vibration.
    """
    masses = 2.0, 1.0
    scene, tension = machine(masses, d)
    system = rj.assemble(scene)
    ts = jnp.linspace(0.0, 0.4, 5)
    run = rj.simulate(system, ts, rtol=1e-10, atol=1e-12, audit=False)
    falls = 0.5 * GRAVITY * (masses[0] - masses[1]) / sum(masses) * ts**2
    assert_close(run["weight0.y"], -1.0 - falls, SOLVED)
    assert_close(run["weight1.y"], -1.0 + falls, SOLVED)
    rope = rj.effect_forces(system, run)["rope"]
    for side, share in (("a", 1.0), ("b", 1.0), ("c", -1.0), ("d", -1.0)):
        pull = np.asarray(rope.on(side).force)[:, 1]
        assert_close(pull, np.full(5, share * tension), SOLVED * STIFFNESS)


def test_a_slack_rope_catches_what_falls():
    """It falls freely until the rope is taut, swings on it as on a spring, and is thrown back."""
    mass, slack, stiffness = 2.0, 0.3, 4e3
    ball = rj.RigidBody("ball", mass, 0.1)
    rope = rj.Rope(ball.at(), rj.ground.at(), slack, stiffness)
    system = rj.assemble(rj.Scene([ball], effects=[rj.Gravity(), rope]))
    taut, w = np.sqrt(2 * slack / GRAVITY), np.sqrt(stiffness / mass)
    speed, sag = GRAVITY * taut, GRAVITY / w**2
    swing = np.hypot(speed / w, sag)
    contact = 2 * (np.pi - np.arctan2(speed / w, sag)) / w
    ts = jnp.array([0.0, 0.5 * taut, taut, taut + 0.5 * contact, 2 * taut + contact])
    run = rj.simulate(system, ts, rtol=1e-10, atol=1e-12, audit=False)
    depths = [0.0, 0.25 * slack, slack, slack + sag + swing, 0.0]
    assert_close(run["ball.y"], -np.array(depths), SOLVED)
    assert run.success


def test_a_pin_with_clearance_hangs_in_its_hole():
    """The penalty of Hertz's law carries the weight at k δ^(3/2) = m g, wherever the hole is."""
    mass, clearance, k, at = 2.0, 0.01, 1e6, (0.3, 0.2)
    deep = (mass * GRAVITY / k) ** (2 / 3)
    below = clearance + deep
    pin = rj.RigidBody("pin", mass, 0.1, position=(at[0], at[1] - below))
    hole = rj.Contact(pin.at(), rj.ground.at(at), rj.Circle(clearance, hollow=True), k)
    system = rj.assemble(rj.Scene([pin], effects=[rj.Gravity(), hole]))
    states = np.array([system.q0, [*at, 0.0]])
    forces = jax.jit(jax.vmap(lambda q: system.force(0.0, q, system.v0)))(states)
    assert_close(forces, [[0.0, 0.0, 0.0], [0.0, -mass * GRAVITY, 0.0]], IDENTITY * k)


@pytest.mark.instant
def test_ropes_that_are_none():
    body = rj.RigidBody("load", 1.0, 1.0)
    with pytest.raises(rj.SceneError, match=r"effect 'hoist': length is 0.*positive"):
        rj.Rope(body.at(), rj.ground.at(), 0.0, 1e5, name="hoist")
    with pytest.raises(rj.SceneError, match="in 2 and 3 dimensions"):
        rj.Rope(body.at(), rj.ground.at(), 1.0, 1e5, via=[rj.ground.at((0.0, 0.0, 1.0))])


@pytest.mark.instant
def test_files_have_ropes(tmp_path):
    scene, _ = machine((2.0, 1.0))
    scene.save(tmp_path / "machine.toml")
    assert_same(rj.load_scene(tmp_path / "machine.toml"), scene)
