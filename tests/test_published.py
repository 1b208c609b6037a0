"""Published problems with many printed digits, typed in here.

Each says where its digits come from. The runs are tight enough that what differs is the mechanics.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import TIGHT
from tolerances import IDENTITY, PUBLISHED

import romjax as rj
from romjax.scene.body.modes import free_free_roots

# Required of the roots of the frequency equation, which are printed to 18 places.
ROOTS = 1e-10


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


def test_arevalo_particle():
    """A particle driven around a circle: x = sin t², y = cos t², λ = 4t² (Arévalo and Lubich,
    BIT 35, 1995).

    Position, velocity and multiplier, each relative to its size, for t from 1 to 5.
    """
    system = rj.CustomSystem(
        lambda q: jnp.eye(2),
        lambda t, q, v: jnp.stack([2 * q[1], -2 * q[0]]),
        lambda t, q: 0.5 * (q @ q - 1)[None],
        q0=[np.sin(1.0), np.cos(1.0)],
        v0=[2 * np.cos(1.0), -2 * np.sin(1.0)],
    )
    t = jnp.linspace(1.0, 5.0, 41)
    found = rj.simulate(system, t, rtol=TIGHT / 100)
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
    assert np.allclose(free_free_roots(5), wanted, rtol=ROOTS, atol=0)


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
