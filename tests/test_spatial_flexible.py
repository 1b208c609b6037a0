"""Flexible bodies in space: their inertia, against point masses that move with them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import zoo
from comparison import assert_close
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax import spatial
from romjax.linalg import quaternions
from romjax.scene.body.spatial.inertia import SpatialInertia

POINTS, MODES = 7, 4


@pytest.fixture(scope="module")
def cloud():
    """Point masses that move with the modes: masses, positions, shapes."""
    rng = np.random.default_rng(1)
    return (
        rng.uniform(0.5, 2.0, POINTS),
        rng.standard_normal((POINTS, 3)),
        rng.standard_normal((POINTS, 3, MODES)),
    )


def places(cloud, q):
    """Where the points are (points, 3)."""
    _, positions, shapes = (jnp.asarray(x) for x in cloud)
    return q[None, :3] + quaternions.rotate(
        jnp.broadcast_to(q[3:7], (POINTS, 4)), positions + shapes @ q[7:]
    )


def states(count, size, seed=0):
    """Random coordinates, with quaternions of lengths of 0.1 to 10, and velocities."""
    rng = np.random.default_rng(seed)
    q, v = rng.standard_normal((2, count, size))
    q[:, 3:7] *= (10 ** rng.uniform(-1, 1, count) / np.linalg.norm(q[:, 3:7], axis=1))[:, None]
    return jnp.asarray(q), jnp.asarray(v)


def energies(cloud, inertia):
    """Functions of q and v: ½ vᵀMv, the same of the points, and the size of their terms."""
    masses = jnp.asarray(cloud[0])

    def ours(q, v):
        return 0.5 * v @ inertia.matrix(q) @ v

    def theirs(q, v):
        _, rates = jax.jvp(lambda q: places(cloud, q), (q,), (v,))
        along = q[3:7] @ v[3:7] / quaternions.squared(q[3:7])
        length = 0.5 * 4 / 3 * jnp.trace(inertia.moment) * along**2
        return 0.5 * jnp.sum(masses[:, None] * rates**2) + length

    return ours, theirs


def test_kinetic_energy_is_that_of_point_masses(cloud):
    """½ vᵀMv = Σ ½ m |ṙ|², and its derivatives by q: quaternions of any length."""
    inertia = eqx.filter_jit(SpatialInertia.of_points)(*cloud)
    ours, theirs = (
        jax.jit(jax.vmap(jax.value_and_grad(f, argnums=(0, 1)))) for f in energies(cloud, inertia)
    )

    @jax.jit
    @jax.vmap
    def first_moments(q):
        return inertia.first_moment_at(q), jnp.asarray(cloud[0]) @ places(cloud, q)

    q, v = states(200, 7 + MODES)
    found, wanted = jax.tree.map(np.asarray, (ours(q, v), theirs(q, v)))
    assert_close(found[0], wanted[0], IDENTITY, wanted[0])
    for by, other in zip(found[1], wanted[1], strict=True):
        assert_close(by, other, IDENTITY, np.max(np.abs(other), axis=1, keepdims=True))
    moments, sums = first_moments(q)
    assert_close(moments, sums, 10 * IDENTITY, np.max(np.abs(sums)))


def test_the_span_of_a_basis(cloud):
    """The inertia of q_f = Φ z has the energy at Φ z."""
    basis = np.random.default_rng(2).standard_normal((MODES, 2))
    (q,), (v,) = states(1, 9, seed=3)

    @jax.jit
    def energies(q, v):
        inertia = SpatialInertia.of_points(*cloud)
        full = (jnp.concatenate([x[:7], basis @ x[7:]]) for x in (q, v))
        pairs = ((inertia, *full), (inertia.in_span(jnp.asarray(basis)), q, v))
        return [v @ own.matrix(q) @ v for own, q, v in pairs]

    wanted, found = map(np.asarray, energies(q, v))
    assert_close(found, wanted, IDENTITY, abs(wanted))


def test_what_is_absent_is_zero():
    """A body whose modes do nothing but vibrate has the mass matrix of a rigid one and a unit."""
    moment = np.diag([1.0, 2.0, 2.5])
    inertia = SpatialInertia(3.0, moment)
    rigid = spatial.RigidBody("body", 3.0, (1.0, 2.0, 2.5))
    (q,), _ = states(1, 9)
    wanted = np.eye(9)

    @jax.jit
    def of(q):
        return rigid.mass_matrix(q[:7]), inertia.matrix(q), inertia.first_moment_at(q)

    wanted[:7, :7], found, moment = of(q)
    assert_close(found, wanted, IDENTITY, np.max(np.abs(wanted)))
    assert_close(moment, 3.0 * q[:3], 0.0)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mass": np.nan}, "'x': inertia.mass is nan"),
        ({"moment": np.eye(2)}, "'x': inertia.moment has shape"),
        (
            {"moment": np.eye(3) + np.eye(3, k=1)},
            "'x': inertia.moment, or modal, is not symmetric.*by 1",
        ),
        ({"moment": -np.eye(3)}, "'x': its mass matrix is not positive definite"),
        ({"shift": np.full((3, 2), 9.0)}, "'x': its mass matrix is not positive definite"),
        ({"gyration": np.zeros((2, 2))}, "'x': inertia.gyration has shape"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_impossible_inertia_is_refused(change, words):
    with pytest.raises(rj.SceneError, match=words):
        SpatialInertia(**{"mass": 1.0, "moment": np.eye(3), **change}).check("body 'x'", 2)


@pytest.fixture(scope="module", params=["centred", "free"])
def inertia(request, cloud):
    """With all invariants, and with those of Buckens' frame alone."""
    masses, positions, shapes = cloud
    rng = np.random.default_rng(4)
    if request.param == "centred":
        fields = np.concatenate([np.tile(np.eye(3), (POINTS, 1, 1)), moved(positions)], axis=2)
        shapes = without(masses, fields.reshape(-1, 6), shapes.reshape(-1, MODES))
        positions = positions - (masses @ positions / masses.sum())[None]
    shapes = orthonormal(masses, shapes.reshape(-1, MODES)).reshape(POINTS, 3, MODES)
    full = eqx.filter_jit(SpatialInertia.of_points)(masses, positions, shapes)
    terms = {name: value for name, value in vars(full).items() if name != "modal"}
    if request.param == "centred":
        terms |= {"first_moment": None, "shift": None, "swing": None}
    else:
        terms["foreshortening"] = jnp.asarray(
            0.1 * np.eye(MODES)[None] * rng.uniform(0, 1, (3, 1, 1))
        )
    return SpatialInertia(**terms)


def moved(positions):
    """e_a × X for each axis a: (points, 3, a)."""
    return np.stack([np.cross(axis, positions) for axis in np.eye(3)], axis=2)


def without(masses, fields, shapes):
    """The shapes without what is in the span of the fields."""
    heavy = np.repeat(masses, 3)[:, None] * fields
    return shapes - fields @ np.linalg.solve(fields.T @ heavy, heavy.T @ shapes)


def orthonormal(masses, shapes):
    root = np.sqrt(np.repeat(masses, 3))[:, None]
    return np.linalg.qr(root * shapes)[0] / root


def test_the_inverse_mass(inertia):
    q, _ = states(20, 7 + MODES, seed=5)
    q = q.at[:, 7:].multiply(0.3)
    assert inertia.inverts
    products = jax.jit(jax.vmap(lambda q: inertia.inverse(q).apply(inertia.matrix(q))))(q)
    # Rows of quaternions and columns of theirs have their lengths.
    size = np.maximum(np.linalg.norm(q[:, 3:7], axis=1), 1)[:, None, None] ** 2
    wanted = np.broadcast_to(np.eye(7 + MODES), products.shape)
    assert_close(products, wanted, 100 * IDENTITY, size)


def test_the_quadratic_velocity_force(inertia):
    """In closed form it is that of autodiff."""
    derived = rj.quadratic_velocity_force(inertia.matrix)
    q, v = states(100, 7 + MODES, seed=6)
    found = jax.jit(jax.vmap(inertia.quadratic_velocity_force))(q, v)
    wanted = jax.jit(jax.vmap(derived))(q, v)
    assert_close(found, wanted, 10 * IDENTITY, np.max(np.abs(wanted), axis=1, keepdims=True))


def springs(positions, stiffness):
    """Unit vectors, lengths and nodes of springs between all points, and their linear K."""
    first, second = np.triu_indices(len(positions), 1)
    lines = positions[second] - positions[first]
    lengths = np.linalg.norm(lines, axis=1)
    rows = np.zeros((len(first), len(positions), 3))
    along = lines / lengths[:, None]
    index = np.arange(len(first))
    rows[index, second], rows[index, first] = along, -along
    rows = rows.reshape(len(first), -1)
    return first, second, lengths, stiffness * rows.T @ rows


@pytest.mark.slow
def test_free_flight_against_points_and_springs():
    """Point masses and springs in the inertial frame; the body has all of their modes."""
    rng = np.random.default_rng(7)
    masses, positions = rng.uniform(0.5, 1.5, 6), rng.standard_normal((6, 3))
    positions -= (masses @ positions / masses.sum())[None]
    # So stiff that what is of second order in the deflections, some 1e-5, is below the tolerance.
    stiffness = 3e4
    first, second, lengths, linear = springs(positions, stiffness)
    squares, shapes = scipy.linalg.eigh(linear, np.diag(np.repeat(masses, 3)))
    shapes = shapes[:, 6:].reshape(6, 3, 12)
    body = spatial.ModalBody(
        "cloud",
        eqx.filter_jit(SpatialInertia.of_points)(masses, positions, shapes),
        squares[6:],
        positions,
        np.concatenate([shapes, np.zeros_like(shapes)], axis=1),
        orientation=(1.0, 0.2, -0.1, 0.3),
        velocity=(0.3, -0.2, 0.1),
        angular_velocity=(0.3, -0.2, 0.4),
        amplitudes=1e-6 * rng.standard_normal(12),
    )
    ts = np.linspace(0.0, 0.2, 5)
    run = zoo.run(rj.assemble(rj.Scene([body])), ts, rtol=1e-11, atol=1e-13)

    def places(q):
        arms = jnp.asarray(positions) + jnp.asarray(shapes) @ q[7:]
        return q[None, :3] + quaternions.rotate(jnp.broadcast_to(q[3:7], (6, 4)), arms)

    @jax.jit
    @jax.vmap
    def points(q, v):
        return jax.jvp(places, (q,), (v,))

    found, rates = map(np.asarray, points(run.q, run.v))

    def move(t, state):
        r, v = state.reshape(2, 6, 3)
        lines = r[second] - r[first]
        now = np.linalg.norm(lines, axis=1)
        pull = (stiffness * (1 - lengths / now))[:, None] * lines
        force = np.zeros((6, 3))
        np.add.at(force, first, pull)
        np.add.at(force, second, -pull)
        return np.concatenate([v, force / masses[:, None]]).ravel()

    exact = scipy.integrate.solve_ivp(
        move,
        (0, ts[-1]),
        np.concatenate([found[0], rates[0]]).ravel(),
        "DOP853",
        ts,
        rtol=1e-12,
        atol=1e-14,
    )
    wanted = exact.y.T.reshape(-1, 2, 6, 3)[:, 0]
    assert_close(found, wanted, SOLVED)
