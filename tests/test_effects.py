"""Effects: the power of each on moving flexible bodies, against laws written a second time."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from mechanics import coordinates, marker_place
from programs import kept
from tolerances import IDENTITY

import romjax as rj

TIME = 0.3
ARM = rj.Beam("arm", 0.7, 1.1, EI=4.0, modes=2, position=(0.5, 0.1), angle=0.2)
BLOCK = rj.RigidBody("block", mass=1.3, inertia=0.2, position=(1.2, -0.4), angle=-0.7)
ENDS = ARM.at((0.3, 0.0), 0.4), BLOCK.at((-0.1, 0.2), -0.3)
SWING = rj.Sine(0.3, 2.0, phase=0.4)
STIFF, DAMP = jnp.array([30.0, 50.0, 4.0]), jnp.array([0.5, 0.7, 0.2])


def pose(marker, q):
    """Position and angle of a marker."""
    bodies = coordinates(rj.Scene([ARM, BLOCK]), q)
    slope = ARM.mode_shapes(marker.point)[2] @ bodies["arm"][3:] if marker.body == "arm" else 0.0
    turn = bodies[marker.body][2] + marker.angle + slope
    return marker_place(rj.Scene([ARM, BLOCK]), marker, q), turn


def turn(angle):
    return jnp.array([[jnp.cos(angle), -jnp.sin(angle)], [jnp.sin(angle), jnp.cos(angle)]])


def stretch(q):
    a, b = (pose(marker, q)[0] for marker in ENDS)
    return jnp.linalg.norm(a - b) - 0.2


def twist(q):
    a, b = (pose(marker, q)[1] for marker in ENDS)
    return a - b


def displacement(q):
    (a, _), (b, angle) = (pose(marker, q) for marker in ENDS)
    return jnp.append(turn(angle).T @ (a - b), twist(q))


def cubic(q, dq):
    s, rate = dq(stretch)
    return -(20.0 * s + 500.0 * s**3) * rate


def line_damper(q, dq):
    return -0.8 * dq(stretch)[1] ** 2


def torsion_spring(q, dq):
    angle, rate = dq(twist)
    return -3.0 * (angle - 0.1) * rate


def torsion_damper(q, dq):
    return -0.8 * dq(twist)[1] ** 2


def bushing(q, dq):
    delta, rate = dq(displacement)
    return -jnp.sum(STIFF * delta * rate)


def damped_bushing(q, dq):
    return bushing(q, dq) - jnp.sum(DAMP * dq(displacement)[1] ** 2)


def torque(q, dq):
    return SWING(TIME) * dq(lambda q: pose(ENDS[0], q)[1])[1]


def follower(q, dq):
    (_, angle), (speed, _) = dq(lambda q: pose(ENDS[0], q))  # values, then rates
    return SWING(TIME) * (turn(angle) @ jnp.array([0.6, 0.8])) @ speed


def motor(q, dq):
    angle, rate = dq(twist)
    wanted, speed = jax.value_and_grad(SWING)(TIME)
    return (5.0 * (wanted - angle) + 0.4 * (speed - rate)) * rate


CASES = {
    "cubic": (rj.Spring(*ENDS, stiffness=20.0, rest_length=0.2, cubic=500.0), cubic),
    "line damper": (rj.Damper(*ENDS, damping=0.8, along_line=True), line_damper),
    "torsion spring": (rj.TorsionSpring(*ENDS, stiffness=3.0, rest_angle=0.1), torsion_spring),
    "torsion damper": (rj.TorsionDamper(*ENDS, damping=0.8), torsion_damper),
    "bushing": (rj.Bushing(*ENDS, STIFF), bushing),
    "damped bushing": (rj.Bushing(*ENDS, STIFF, DAMP), damped_bushing),
    "torque": (rj.Torque(ENDS[0], SWING), torque),
    "follower": (rj.Force(ENDS[0], (3.0, 4.0), SWING, frame="body"), follower),
    "motor": (rj.Motor(*ENDS, SWING, proportional=5.0, derivative=0.4), motor),
}


@kept
def powers(plain, system, law, q, v):
    """In several states: Q v of the effect, what the law says of it, and the size of its terms."""

    def at(q, v):
        without = plain.force(TIME, q, v)
        force = system.force(TIME, q, v) - without
        size = (jnp.abs(force) + jnp.abs(without)) @ jnp.abs(v)
        return force @ v, law(q, lambda function: jax.jvp(function, (q,), (v,))), size

    return jax.vmap(at)(q, v)


@pytest.mark.parametrize("kind", CASES)
def test_power(kind):
    """Q v of the effect alone."""
    effect, law = CASES[kind]
    plain = rj.assemble(rj.Scene([ARM, BLOCK]))
    system = rj.assemble(rj.Scene([ARM, BLOCK], [], [effect]))

    states = np.random.default_rng(2).normal(size=(3, 2, system.n)) * 0.3
    q, v = states[:, 0] + np.asarray(system.q0), states[:, 1]
    found, wanted, size = powers(plain, system, law, q, v)
    assert_close(found, wanted, IDENTITY, size)


def test_a_damper_along_a_line_is_central():
    """The forces on both bodies are opposite, and point along the line between the markers."""
    a, b = (rj.RigidBody(name, 1.0, 1.0, position=(x, -x)) for name, x in (("a", 0.3), ("b", -0.5)))
    damper = rj.Damper(a.at(), b.at(), damping=0.8, along_line=True)
    system = rj.assemble(rj.Scene([a, b], [], [damper]))
    force = jax.jit(system.force)(0.0, system.q0, np.array([0.7, 0.2, 1.0, -0.4, 0.1, 2.0]))
    line = np.array([1.0, -1.0]) / np.sqrt(2)
    push = -0.8 * (1.1 - 0.1) / np.sqrt(2)
    wanted = [*(push * line), 0.0, *(-push * line), 0.0]
    assert_close(force, wanted, IDENTITY)


def test_a_damper_along_a_line_where_the_points_meet():
    """No force, and derivatives that are finite."""
    body = rj.RigidBody("body", 1.0, 1.0)
    damper = rj.Damper(body.at(), rj.ground.at(), damping=0.8, along_line=True)
    system = rj.assemble(rj.Scene([body], [], [damper]))

    @jax.jit
    def both(*state):
        return system.force(*state), jax.jacrev(system.force, argnums=(1, 2))(*state)

    force, slopes = both(0.0, system.q0, np.array([0.7, 0.2, 1.0]))
    assert not np.any(force)
    assert np.all(np.isfinite(slopes))


def test_an_effect_of_ones_own():
    """Its markers are those among its fields, in their order."""

    class Weight(rj.AbstractPotential):
        weight: jax.Array
        first: rj.Marker
        second: rj.Marker

        def energy(self, t, *poses):
            return self.weight * (poses[0].position[1] + 2 * poses[1].position[1])

        def check(self):
            pass

    effect = Weight(jnp.asarray(3.0), *ENDS)
    assert effect.markers == ENDS
    assert effect.label() == "Weight(arm, block)"
    system = rj.assemble(rj.Scene([BLOCK], [], [Weight(jnp.asarray(3.0), BLOCK.at(), BLOCK.at())]))
    assert_close(jax.jit(system.force)(0.0, system.q0, system.v0), [0, -9, 0], IDENTITY)


@pytest.mark.instant
def test_what_an_effect_refuses():
    with pytest.raises(rj.SceneError, match="frame is 'local', but it must be one of world, body"):
        rj.Force(ENDS[0], (1.0, 0.0), SWING, frame="local")
    with pytest.raises(rj.SceneError, match=r"Bushing\(arm, block\).*stiffness has shape \(\)"):
        rj.Bushing(*ENDS, 1.0)
    with pytest.raises(rj.SceneError, match=r"TorsionDamper.*damping is -1.*not be negative"):
        rj.TorsionDamper(*ENDS, damping=-1.0)
    with pytest.raises(rj.SceneError, match="signal is 3.0; give a signal"):
        rj.Torque(ENDS[0], 3.0)
    with pytest.raises(rj.SceneError, match=r"Torque.*direction is .* leave it out"):
        rj.Torque(ENDS[0], SWING, (0.0, 0.0, 1.0))
    with pytest.raises(rj.SceneError, match=r"Torque.*frame is 'local'"):
        rj.Torque(ENDS[0], SWING, frame="local")
    with pytest.raises(rj.SceneError, match=r"Motor.*derivative is -1"):
        rj.Motor(*ENDS, SWING, proportional=1.0, derivative=-1.0)
