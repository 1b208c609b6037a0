"""Rigid bodies in space: published digits, any length of quaternions, whole scenes moved, and what
is refused.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from programs import primitives
from tolerances import IDENTITY, PUBLISHED, SOLVED
from verification_problems.space import FLIPPED, TOP

import romjax as rj
from romjax import spatial as r
from romjax.linalg import quaternions


def top(orientation=(1.0, 0.0, 0.0, 0.0), turn=(1.0, 0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    """The heavy top, with another length of its quaternion, or the whole scene moved."""
    turn, shift = np.asarray(turn, float), np.asarray(shift, float)

    def moved(x):
        return quaternions.rotate(turn, np.asarray(x, float))

    body = r.RigidBody(
        "top",
        15.0,
        (0.234375, 0.46875, 0.234375),
        position=shift + moved((0.0, 1.0, 0.0)),
        orientation=quaternions.product(turn, np.asarray(orientation, float)),
        velocity=moved((4.61538, 0.0, 0.0)),
        angular_velocity=moved((0.0, 150.0, -4.61538)),
    )
    pivot = r.Spherical(body.at((0.0, -1.0, 0.0)), rj.ground.at(shift))
    return rj.Scene([body], [pivot], [rj.Gravity(moved((0.0, 0.0, -9.81)))])


@pytest.fixture(scope="module")
def spun():
    """The top and its run over one second."""
    system = rj.assemble(top())
    return system, rj.simulate(system, jnp.linspace(0.0, 1.0, 11), rtol=1e-11)


def turned_twice(p, x):
    return quaternions.rotate(quaternions.product(p, p), x)


@pytest.mark.instant
def test_derivatives_of_rotations_scatter_nothing():
    """XLA makes a loop over all entries of each, which joints in space had a dozen of."""
    derivatives = jax.jacrev(turned_twice, argnums=(0, 1))
    names = primitives(derivatives, np.ones(4), np.ones(3))
    assert not any("scatter" in name for name in names)


def test_numpy_and_jax_turn_alike():
    lot = np.random.default_rng(0)
    p, x = lot.normal(size=(5, 4)), lot.normal(size=(5, 3))
    by_jax = jax.jit(turned_twice)(p, x)
    assert np.max(np.abs(by_jax - turned_twice(p, x))) < IDENTITY


def test_heavy_top(spun):
    system, run = spun
    assert np.max(np.abs(run.q[-1, :3] - np.array(TOP))) < PUBLISHED
    assert run.is_valid
    balance = rj.energy(system, run).balance
    assert np.max(np.abs(balance)) < PUBLISHED * float(rj.energy(system, run).total[0])


def test_measured_motion(spun):
    """The tip of the axis moves with the body's position and rotation."""
    system, run = spun
    tip = rj.measure(system, run, rj.Marker("top", (0.0, 0.5, 0.0), (1.0, 0.0, 0.0, 0.0)))
    rotation = quaternions.matrix(np.asarray(run.q[:, 3:]))
    assert np.max(np.abs(tip.rotation - rotation)) < IDENTITY
    assert np.max(np.abs(tip.position - run.q[:, :3] - 0.5 * rotation[:, :, 1])) < IDENTITY
    assert tip.angular_velocity.shape == (11, 3)
    with pytest.raises(rj.InputError, match=r"no angle; take its \.rotation"):
        _ = tip.angle


@pytest.mark.parametrize("length", [0.1, 10.0])
def test_the_length_of_quaternions_means_nothing(spun, length):
    run = rj.simulate(
        rj.assemble(top((length, 0.0, 0.0, 0.0))), jnp.linspace(0.0, 1.0, 11), rtol=1e-11
    )
    assert np.max(np.abs(run.q[:, :3] - spun[1].q[:, :3])) < SOLVED


def test_a_scene_that_is_moved_as_a_whole_moves_as_before(spun):
    turn, shift = np.array([0.3, -0.5, 0.7, 0.2]), np.array([3.0, -2.0, 1.0])
    system = rj.assemble(top(turn=turn, shift=shift))
    run = rj.simulate(system, jnp.linspace(0.0, 1.0, 11), rtol=1e-11)
    before = np.asarray(spun[1].q[:, :3])
    after = np.asarray(run.q[:, :3]) - shift
    assert np.max(np.abs(after - quaternions.rotate(turn[None], before))) < SOLVED
    reaction = rj.joint_forces(system, run)["Spherical(top, ground)"].on("a", frame="a")
    same = rj.joint_forces(*spun)["Spherical(top, ground)"].on("a", frame="a")
    # The markers turn with the body, so their axes see the same force.
    error = np.max(np.abs(reaction.force[0] - same.force[0]))
    assert error < IDENTITY * np.max(np.abs(same.force))


def test_free_body_flips():
    body = r.RigidBody("nut", 1.0, (1.0, 2.0, 3.0), angular_velocity=(0.001, 5.0, 0.02))
    system = rj.assemble(rj.Scene([body]))
    run = rj.simulate(system, jnp.linspace(0.0, 10.0, 11), rtol=1e-12, atol=1e-14, audit=False)
    omega = quaternions.body_angular_velocity(run.q[-1, 3:], run.v[-1, 3:])
    assert abs(float(omega[0]) - FLIPPED) < PUBLISHED


def test_kinetic_energy_and_gyroscopic_force():
    """T and the mass matrix of 200 random states, of points and of their closed forms."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(6, 3))
    points -= points.mean(axis=0)
    inertia = np.einsum("pi,pi->", points, points) * np.eye(3) - points.T @ points
    body = r.RigidBody("cloud", 6.0, inertia)
    q, v = (jnp.asarray(rng.normal(size=(200, 7))) for _ in range(2))

    @jax.jit
    @jax.vmap
    def compared(q, v):
        def mapped(q):
            return q[None, :3] + quaternions.rotate(q[None, 3:], jnp.asarray(points))

        velocities = jax.jvp(mapped, (q,), (v,))[1]
        radial = 0.5 * 4 / 3 * np.trace(inertia) * (q[3:] @ v[3:] / (q[3:] @ q[3:])) ** 2
        mass = body.mass_matrix(q)
        kinetic = 0.5 * v @ mass @ v
        force = rj.quadratic_velocity_force(body.mass_matrix)(q, v)
        return (
            kinetic - 0.5 * jnp.sum(velocities**2) - radial,
            kinetic,
            body.inverse_mass(q).apply(mass) - jnp.eye(7),
            body.quadratic_velocity_force(q, v) - force,
            jnp.max(jnp.abs(force)),
        )

    difference, kinetic, unit, force, size = compared(q, v)
    assert np.max(np.abs(difference / kinetic)) < IDENTITY
    assert np.max(np.abs(unit)) < IDENTITY
    assert np.max(np.abs(force) / size[:, None]) < IDENTITY


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (
            lambda: rj.Scene(
                [r.RigidBody("a", 1.0, (1, 1, 1)), rj.RigidBody("b", 1.0, 1.0)]
            ).check(),
            "body 'b' is in the plane, but body 'a' is in space",
        ),
        (
            lambda: r.Spherical(rj.ground.at((0, 0)), r.RigidBody("a", 1.0, (1, 1, 1)).at()),
            "in the plane, but the part is one of space",
        ),
        (
            lambda: rj.KnifeEdge(rj.ground.at((0, 0, 0)), r.RigidBody("a", 1.0, (1, 1, 1)).at()),
            "romjax.spatial those of space",
        ),
        (
            lambda: r.Weld(r.RigidBody("a", 1.0, (1, 1, 1)).at(), rj.ground.at((0, 0, 0)), 0.3),
            "value is 0.3, an angle of the plane; in space all axes stay parallel",
        ),
        (
            lambda: r.PointOnCurve(
                rj.RigidBody("a", 1.0, 1.0).at(), rj.ground.at(), r.Helix(0.3, 0.5)
            ),
            "curve is a Helix, a curve in space, but the markers are in the plane",
        ),
        (lambda: r.RigidBody("a", 1.0, (1, 1, 3)), "those of no body"),
        (lambda: r.RigidBody("a", 1.0, [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]), "not symmetric"),
        (lambda: r.RigidBody("a", 1.0, (1, 1, 1), orientation=np.diag([1, 1, 2])), "is not one"),
        (lambda: r.RigidBody("a", 1.0, (1, 1, 1), orientation=(0, 0, 0, 0)), "not zero"),
        (lambda: rj.ground.at((0, 0, 0), axis=(0, 0, 0)), "not all zero"),
        (lambda: rj.ground.at((0, 0), axis=(0, 0, 1)), "an angle in the plane"),
    ],
)
def test_what_is_refused(scene, words):
    with pytest.raises(rj.SceneError, match=words):
        scene()


def test_orientations_by_every_convention():
    """A matrix, a quaternion, axis and angle, and Euler angles of one rotation."""
    half = np.array([np.cos(0.2), 0.0, 0.0, np.sin(0.2)])
    matrix = quaternions.matrix(half)
    given = [3 * half, matrix, r.rotation((0, 0, 2), 0.4), r.euler("ZXZ", (0.1, 0.0, 0.3))]
    for orientation in given:
        body = r.RigidBody("a", 1.0, (1, 1, 1), orientation=orientation)
        turned = quaternions.matrix(np.asarray(body.orientation))
        assert np.max(np.abs(turned - matrix)) < IDENTITY
    marker = body.at((0, 0, 0), axis=(1.0, 2.0, -3.0))
    along = quaternions.rotate(np.asarray(marker.turn), np.array([0.0, 0.0, 1.0]))
    assert np.max(np.abs(along - np.array([1.0, 2.0, -3.0]) / np.sqrt(14))) < IDENTITY
