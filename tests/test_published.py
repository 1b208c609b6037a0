"""Published problems with many printed digits, typed in here.

Each says where its digits come from. The runs are tight enough that what differs is the mechanics.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import simeon
from mechanisms import bar, ends
from tolerances import IDENTITY, PUBLISHED, SOLVED
from zoo import TIGHT

import romjax as rj
from romjax.scene.body.modes import bending_roots

# Required of the roots of the frequency equation, which are printed to 18 places.
ROOTS = 1e-10
# Required of orders of convergence.
SPREAD = 0.2


@pytest.fixture(scope="module")
def slider_pendulum() -> rj.Trajectory:
    """Cart of 1 kg on the x axis with a spring to the origin, and a pendulum of 1 kg and 1 kg m²
    hinged to it at half its length of 1 m, released from the horizontal; gravity 10 m/s².

    Project Chrono, unit test utest_CH_slider_pend: the rigid twin of the chapter's example.
    """
    slider = rj.RigidBody("slider", mass=1.0, inertia=1.0)
    pendulum = rj.RigidBody("pendulum", mass=1.0, inertia=1.0, position=(0.5, 0.0))
    scene = rj.Scene(
        bodies=[slider, pendulum],
        joints=[
            rj.PointOnLine(slider.at(), rj.ground.at()),
            rj.FixedAngle(slider.at(), rj.ground.at()),
            rj.Revolute(slider.at(), pendulum.at((-0.5, 0.0))),
        ],
        effects=[
            rj.Spring(slider.at(), rj.ground.at(), stiffness=10.0),
            rj.Gravity((0.0, -10.0)),
        ],
    )
    return rj.simulate(rj.assemble(scene), jnp.array([0.0, 1.0, 5.0]), rtol=TIGHT)


@pytest.mark.parametrize(
    ("place", "q", "v"),
    [
        (
            1,
            # x of the slider, x, y, φ of the pendulum
            [0.245029342917678, 0.125147664024744, -0.485415680696258, -1.812918418362238],
            [0.343720163146326, -2.800896418405298],  # ẋ of the slider, φ̇ of the pendulum
        ),
        (
            2,
            [-0.504537462593492, -0.782864584168284, -0.415372138444421, -2.161149245960109],
            [-1.379788493752874, -0.873267630490026],
        ),
    ],
    ids=["t=1", "t=5"],
)
def test_slider_pendulum(slider_pendulum, place, q, v):
    """Positions and velocities at 1 s and 5 s, from a solution in 40-digit arithmetic."""
    assert np.allclose(slider_pendulum.q[place, jnp.array([0, 3, 4, 5])], q, rtol=0, atol=PUBLISHED)
    assert np.allclose(slider_pendulum.v[place, jnp.array([0, 5])], v, rtol=0, atol=PUBLISHED)


@pytest.fixture(scope="module")
def arevalo() -> rj.CustomSystem:
    """A particle driven around a circle: x = sin t², y = cos t², λ = 4t² (Arévalo and Lubich,
    BIT 35, 1995), from t = 1.
    """
    return rj.CustomSystem(
        lambda q: jnp.eye(2),
        lambda t, q, v: jnp.stack([2 * q[1], -2 * q[0]]),
        lambda t, q: 0.5 * (q @ q - 1)[None],
        q0=[np.sin(1.0), np.cos(1.0)],
        v0=[2 * np.cos(1.0), -2 * np.sin(1.0)],
    )


def test_arevalo_orders(arevalo):
    """Position, velocity and multiplier all converge with order 5."""

    def errors(steps):
        motion = rj.simulate(
            arevalo,
            jnp.array([1.0, 2.0]),
            dt=1 / steps,
            solver=rj.Rodas5P(),
            stabilization=None,
            throw=False,
        )
        s, c = np.sin(4.0), np.cos(4.0)
        found = (motion.q[-1], motion.v[-1], motion.multipliers[-1])
        wanted = ([s, c], [4 * c, -4 * s], [16.0])
        return [np.max(np.abs(x - np.array(y))) for x, y in zip(found, wanted, strict=True)]

    orders = np.log2(np.array(errors(80)) / np.array(errors(160)))
    assert np.all(np.abs(orders - 5) <= SPREAD), orders


def test_arevalo_particle(arevalo):
    """Position, velocity and multiplier, each relative to its size, for t from 1 to 5."""
    t = jnp.linspace(1.0, 5.0, 41)
    found = rj.simulate(arevalo, t, rtol=TIGHT / 100, solver=rj.Rodas5P())
    along = jnp.stack([jnp.sin(t**2), jnp.cos(t**2)], axis=1)
    across = 2 * t[:, None] * jnp.stack([jnp.cos(t**2), -jnp.sin(t**2)], axis=1)
    assert np.allclose(found.q, along, rtol=0, atol=PUBLISHED)
    assert np.allclose(found.v / t[:, None], across / t[:, None], rtol=0, atol=PUBLISHED)
    assert np.allclose(found.multipliers[:, 0] / t**2, 4.0, rtol=0, atol=PUBLISHED)


@pytest.fixture(scope="module")
def point_pendulum() -> rj.Trajectory:
    """Problem A01 of the IFToMM benchmark library: a point mass of 1 kg on a massless bar of 1 m,
    released from the horizontal; gravity 9.81 m/s².
    """
    system = rj.CustomSystem(
        lambda q: jnp.eye(2),
        lambda t, q, v: jnp.array([0.0, -9.81]),
        lambda t, q: 0.5 * (q @ q - 1)[None],
        q0=[1.0, 0.0],
        v0=[0.0, 0.0],
    )
    return rj.simulate(system, jnp.array([0.0, 1.0, 2.0, 5.0]), rtol=TIGHT / 10)


@pytest.mark.parametrize(
    ("place", "angle", "rate", "tension"),
    [
        (1, -1.405027311524799, -1.799309016907079, 4.856269407448477),
        (2, 0.916647589663245, 3.455206899059330, 17.907682072960784),
        (3, 1.229451811485386, -2.562787568192629, 9.851820179524039),
    ],
    ids=["t=1", "t=2", "t=5"],
)
def test_point_pendulum(point_pendulum, place, angle, rate, tension):
    """φ = 2 asin(k cd(√(g/L) t, k)) with k² = ½ from the downward vertical, and the pull in the
    bar, which is the multiplier of ½ (|r|² − 1).
    """
    motion, s, c = point_pendulum, np.sin(angle), np.cos(angle)
    assert np.allclose(motion.q[place], [s, -c], rtol=0, atol=PUBLISHED)
    assert np.allclose(motion.v[place], [rate * c, rate * s], rtol=0, atol=PUBLISHED)
    assert np.allclose(motion.multipliers[place, 0], tension, rtol=PUBLISHED, atol=0)


def test_roots_of_free_free_beams():
    """cos(βL) cosh(βL) = 1, from a solution in 28-digit arithmetic."""
    wanted = [
        4.730040744862704,
        7.853204624095838,
        10.995607838001671,
        14.137165491257464,
        17.278759657399481,
    ]
    assert np.allclose(bending_roots("free-free", 5), wanted, rtol=ROOTS, atol=0)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_mode_shapes_are_orthonormal(axis):
    """∫ρ w_i w_j ds = δ_ij, and no mode moves the centre of mass or turns the beam; every mode is
    2/√m at the end with the lower coordinate. By Gauss–Legendre quadrature, exact to rounding.
    """
    mass, length, modes = 0.7, 1.3, 6
    body = rj.Beam("beam", mass, length, EI=1.0, modes=modes, axis=axis)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    along, none = length / 2 * nodes, np.zeros_like(nodes)
    points = np.stack([along, none] if axis == "x" else [none, along], axis=1)
    shapes = np.array([body.mode_shapes(jnp.asarray(point)) for point in points])
    deflection = shapes[:, 1 if axis == "x" else 0]
    density = mass * weights / 2
    gram = deflection.T @ (density[:, None] * deflection)
    assert np.allclose(gram, np.eye(modes), rtol=0, atol=IDENTITY)
    assert np.allclose(density @ deflection, 0, rtol=0, atol=IDENTITY)
    assert np.allclose((density * along) @ deflection, 0, rtol=0, atol=IDENTITY)
    end = jnp.array([-length / 2, 0.0] if axis == "x" else [0.0, -length / 2])
    tip = body.mode_shapes(end)[1 if axis == "x" else 0]
    assert np.allclose(tip, 2 / np.sqrt(mass), rtol=IDENTITY, atol=0)


def test_slope_is_the_derivative_of_the_mode_shape():
    """A point turns counter-clockwise by w' where the axis is x, clockwise where it is y."""
    for axis, sign in (("x", 1.0), ("y", -1.0)):
        body = rj.Beam("beam", 0.7, 1.3, EI=1.0, modes=4, axis=axis)
        point = jnp.array([0.21, 0.0] if axis == "x" else [0.0, 0.21])
        along = 0 if axis == "x" else 1
        slope = jax.jacfwd(body.mode_shapes)(point)[1 - along, :, along]
        assert np.allclose(body.mode_shapes(point)[2], sign * slope, rtol=IDENTITY, atol=0)


def test_simeon_slider_crank():
    """Flexible rod, a constraint that drives the crank: q to eight digits, velocities to seven."""
    motion = simeon.run(simeon.slider_crank())
    assert np.allclose(motion.q[-1], simeon.POSITIONS, rtol=PUBLISHED, atol=0)
    assert np.allclose(motion.v[-1], simeon.VELOCITIES, rtol=10 * PUBLISHED, atol=0)


@pytest.mark.slow
def test_rigid_slider_crank():
    """Crank, rod and slider driven by 0.1 N m until 2 s, then free: 28-digit computation."""
    crank = bar("crank", (0, 0), (0.1, 0), 0.2)
    rod = bar("rod", (0.1, 0), (0.4, 0), 0.2)
    slider = rj.RigidBody("slider", 0.4, 0.0004, position=(0.4, 0.0))
    joints = [
        rj.Revolute(ends(crank)[0], rj.ground.at()),
        rj.Revolute(ends(rod)[0], ends(crank)[1]),
        rj.Revolute(ends(rod)[1], slider.at()),
        rj.PointOnLine(slider.at(), rj.ground.at()),
        rj.FixedAngle(slider.at(), rj.ground.at()),
    ]
    torque = rj.Torque(crank.at(), rj.Constant(0.1))
    driven, free = (
        rj.assemble(rj.Scene([crank, rod, slider], joints, effects)) for effects in ([torque], [])
    )
    settings = {"solver": diffrax.Dopri8(), "rtol": TIGHT / 100, "stabilization": rj.Projection()}
    first = rj.simulate(driven, jnp.array([0.0, 0.3, 2.0]), **settings)
    then = rj.simulate(free, jnp.array([2.0, 3.0]), q0=first.q[-1], v0=first.v[-1], **settings)
    for motion, wanted in (
        (first, [1.4527988230446317, 6.4377456282995766, 0.2948599870005706]),
        (then, [108.70661036342387, 46.087278403636394, 0.2529895275806229]),
    ):
        found = [motion.q[1, 2], motion.v[1, 2], motion.q[1, 6]]
        assert np.allclose(found, wanted, rtol=SOLVED, atol=0)


def test_four_bar_of_mass_points():
    """Two points of 3 kg on rigid links; the given start violates them and is projected to (7, 0),
    (7, 0). Places at 2 s, to nine digits.
    """
    foot = jnp.array([4.0, 0.0])

    def lengths(t, q):
        p, r = q[:2], q[2:]
        links = jnp.stack([p, r - p, r - foot])
        return 0.5 * (jnp.sum(links**2, axis=1) - jnp.array([4.0, 25.0, 25.0]))

    system = rj.CustomSystem(
        lambda q: 3 * jnp.eye(4),
        lambda t, q, v: -3 * 9.81 * jnp.array([0.0, 1.0, 0.0, 1.0]),
        lengths,
        q0=[0.0, 2.0, 4.0, 5.0],
        v0=[4.0, 0.0, 10.0, 0.0],
    )
    q, v = rj.consistent(system)
    assert np.allclose(v, [7.0, 0.0, 7.0, 0.0], rtol=0, atol=IDENTITY)
    motion = rj.simulate(
        system, jnp.array([0.0, 2.0]), q0=q, v0=v, solver=diffrax.Dopri8(), rtol=TIGHT / 100
    )
    wanted = [1.9642513176958342, -0.3764528668109448, 2.0926320726348379, 4.6218986996318651]
    assert np.allclose(motion.q[-1], wanted, rtol=0, atol=SOLVED)
