"""Published problems with many printed digits, typed in here.

Each says where its digits come from. The runs are tight enough that what differs is the mechanics.
`test_published_parts` has more of them.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zoo
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
    return zoo.run(rj.assemble(scene), np.array([0.0, 1.0, 5.0]))


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
    found_q, found_v = np.asarray(slider_pendulum.q[place]), np.asarray(slider_pendulum.v[place])
    assert np.allclose(found_q[[0, 3, 4, 5]], q, rtol=0, atol=PUBLISHED)
    assert np.allclose(found_v[[0, 5]], v, rtol=0, atol=PUBLISHED)


def crosswise(t, q, v):
    return jnp.stack([2 * q[1], -2 * q[0]])


def test_arevalo_orders():
    """Position, velocity and multiplier all converge with order 5.

    A particle driven around a circle: x = sin t², y = cos t², λ = 4t² (Arévalo and Lubich, BIT 35,
    1995), from t = 1.
    """
    particle = rj.CustomSystem(
        zoo.unit_mass,
        crosswise,
        zoo.unit_circle,
        q0=[np.sin(1.0), np.cos(1.0)],
        v0=[2 * np.cos(1.0), -2 * np.sin(1.0)],
    )

    def errors(steps):
        settings = {"solver": zoo.RODAS5P, "stabilization": None, "dt": 1 / steps, "throw": False}
        motion = zoo.run(particle, np.array([1.0, 2.0]), **settings)
        s, c = np.sin(4.0), np.cos(4.0)
        found = (motion.q, motion.v, motion.multipliers)
        wanted = ([s, c], [4 * c, -4 * s], [16.0])
        return [np.max(np.abs(np.asarray(x)[-1] - y)) for x, y in zip(found, wanted, strict=True)]

    orders = np.log2(np.array(errors(80)) / np.array(errors(160)))
    assert np.all(np.abs(orders - 5) <= SPREAD), orders


@pytest.mark.instant
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


@eqx.filter_jit
def shapes_and_slopes(body, points):
    """The mode shapes at points, and their derivatives by the point."""
    shapes, slopes = (jax.vmap(f) for f in (body.mode_shapes, jax.jacfwd(body.mode_shapes)))
    return shapes(points), slopes(points)


@pytest.mark.parametrize("shapes", ["free-free", "static"])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_mode_shapes_are_orthonormal(axis, shapes):
    """∫ρ w_i w_j ds = δ_ij, and no mode moves the centre of mass or turns the beam; every natural
    mode is 2/√m at the end with the lower coordinate. By Gauss–Legendre quadrature, exact to
    rounding.

    A point turns counter-clockwise by w' where the axis is x, clockwise where it is y.
    """
    mass, length, modes = 0.7, 1.3, 6
    body = rj.Beam("beam", mass, length, EI=1.0, modes=modes, axis=axis, shapes=shapes)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    along = length / 2 * np.append(nodes, -1.0)
    none = np.zeros_like(along)
    lengthwise, across, sign = (0, 1, 1.0) if axis == "x" else (1, 0, -1.0)
    points = np.stack([along, none] if axis == "x" else [none, along], axis=1)
    values, slopes = map(np.asarray, shapes_and_slopes(body, points))
    deflection, tip = values[:-1, across], values[-1, across]
    density = mass * weights / 2
    gram = deflection.T @ (density[:, None] * deflection)
    assert np.allclose(gram, np.eye(modes), rtol=0, atol=IDENTITY)
    assert np.allclose(density @ deflection, 0, rtol=0, atol=IDENTITY)
    assert np.allclose((density * along[:-1]) @ deflection, 0, rtol=0, atol=IDENTITY)
    if shapes == "free-free":
        assert np.allclose(tip, 2 / np.sqrt(mass), rtol=IDENTITY, atol=0)
    slope = sign * slopes[:, across, :, lengthwise]
    largest = np.max(np.abs(slope))
    assert np.allclose(values[:, 2], slope, rtol=0, atol=IDENTITY * largest)


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
    driven, free = (
        rj.assemble(rj.Scene([crank, rod, slider], joints, [rj.Torque(crank.at(), signal)]))
        for signal in (rj.Constant(0.1), rj.Constant(0.0))
    )
    settings = {"rtol": TIGHT / 100, "stabilization": rj.Projection()}
    first = zoo.run(driven, np.array([0.0, 0.3, 2.0]), **settings)
    then = zoo.run(free, np.array([2.0, 3.0]), q0=first.q[-1], v0=first.v[-1], **settings)
    for motion, wanted in (
        (first, [1.4527988230446317, 6.4377456282995766, 0.2948599870005706]),
        (then, [108.70661036342387, 46.087278403636394, 0.2529895275806229]),
    ):
        found = [motion.q[1, 2], motion.v[1, 2], motion.q[1, 6]]
        assert np.allclose(found, wanted, rtol=SOLVED, atol=0)
