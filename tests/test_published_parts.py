"""Published problems, built of bodies, joints and effects.

Each says where its digits come from. The runs are tight enough that what differs is the mechanics.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import simeon
import zoo
from tolerances import IDENTITY, PUBLISHED, SOLVED
from zoo import GRAVITY, TIGHT

import romjax as rj
from romjax.system.consistent import project


def run(system, *ts, **settings) -> rj.Trajectory:
    return zoo.run(system, np.array(ts), rtol=TIGHT / 100, **settings)


@pytest.fixture(scope="module")
def sprung_crank() -> rj.Trajectory:
    """SUNDIALS' slider crank: a crank of 0.5 m and 1 kg m², a rod of 1 m and 2 kg m² whose mass of
    1 kg sits at the slider, a spring and a damper between their middles, a force of 1 N.
    """
    angle = -np.pi / 6
    x = np.cos(angle)
    crank = rj.RigidBody("crank", mass=1.0, inertia=1.0, angle=np.pi / 2)
    rod = rj.RigidBody("rod", mass=1.0, inertia=2.0, position=(x, 0.0), angle=angle)
    middles = crank.at((0.25, 0.0)), rod.at((-0.5, 0.0))
    scene = rj.Scene(
        [crank, rod],
        [
            rj.Revolute(crank.at(), rj.ground.at()),
            rj.Revolute(crank.at((0.5, 0.0)), rod.at((-1.0, 0.0))),
            rj.PointOnLine(rod.at(), rj.ground.at()),
        ],
        [
            rj.Spring(*middles, stiffness=1.0, rest_length=1.0),
            rj.Damper(*middles, damping=1.0, along_line=True),
            # The published force does work along x + cos p: at the far end of twice the rod.
            rj.Force(rod.at((1.0, 0.0)), (1.0, 0.0), rj.Constant(1.0)),
        ],
    )
    slow = rj.Baumgarte.critical(1.0)  # as the mechanism is
    return run(rj.assemble(scene), 0.0, 2.5, 5.0, 7.5, 10.0, stabilization=slow)


@pytest.mark.parametrize(
    ("place", "q", "v"),
    [
        (
            1,
            [7.2236105465911817e-02, 1.4980447181497497, -3.6094486807723665e-02],
            [-1.0605265538684836, 5.7368811767466443e-02, 0.52922510994157169],
        ),
        (
            2,
            [-1.4299969676472274, 0.93903061357826623, 0.51789475648988625],
            [5.4991610537764479e-02, 2.9422231647781100e-02, -4.4409897589567468e-03],
        ),
        (
            3,
            [0.18041846669398669, 1.4878513158240669, -8.9841441982501371e-02],
            [0.99415075511971336, -0.13324752982389968, -0.49098735841472832],
        ),
        (
            4,
            [1.2756758486502394, 1.0235785589798395, -0.49881304918249874],
            [-0.23991499719600068, 0.13377828321578363, 3.9731495991321741e-02],
        ),
    ],
    ids=["t=2.5", "t=5", "t=7.5", "t=10"],
)
def test_sundials_slider_crank(sprung_crank, place, q, v):
    """Crank angle, slider, rod angle and their rates, from 54-digit arithmetic."""
    columns = [2, 3, 5]
    assert np.allclose(np.asarray(sprung_crank.q)[place, columns], q, rtol=0, atol=PUBLISHED)
    assert np.allclose(np.asarray(sprung_crank.v)[place, columns], v, rtol=0, atol=PUBLISHED)


class Crosswise(rj.AbstractMarkerEffect):
    """A force on a point, across its place: 2 (y, −x) times a strength."""

    at: rj.Marker
    strength: jax.Array = eqx.field(converter=jnp.asarray)
    needs_twists = False

    def wrenches(self, t, poses, twists):
        x, y = poses[0].position
        return (rj.Wrench(2 * self.strength * jnp.stack([y, -x]), jnp.zeros_like(x)),)

    def check(self):
        pass


def on_a_link(start, velocity, strength, gravity) -> rj.AbstractSystem:
    """A point on a rigid link without mass, whose multiplier is the pull in it."""
    bob = rj.RigidBody("bob", 1.0, 1.0, position=start, velocity=velocity)
    link = rj.Distance(bob.at(), rj.ground.at(), length=1.0)
    effects = [rj.Gravity((0.0, -gravity)), Crosswise(bob.at(), strength)]
    return rj.assemble(rj.Scene([bob], [link], effects))


def test_point_pendulum():
    """Problem A01 of the IFToMM benchmark library, released from the horizontal:
    φ = 2 asin(k cd(√(g/L) t, k)) with k² = ½ from the downward vertical.
    """
    system = on_a_link((1.0, 0.0), (0.0, 0.0), 0.0, GRAVITY)
    motion = run(system, 0.0, 1.0, 2.0, 5.0, 10.0)
    q, v, pull = (np.asarray(x) for x in (motion.q, motion.v, motion.multipliers[:, 0]))
    angle = np.array([-1.405027311524799, 0.916647589663245, 1.229451811485386, 0.2786806735699829])
    rate = np.array([-1.799309016907079, 3.455206899059330, -2.562787568192629])
    tension = [4.856269407448477, 17.907682072960784, 9.851820179524039, 28.29456720606725]
    s, c = np.sin(angle), np.cos(angle)
    assert np.allclose(q[1:, :2], np.stack([s, -c], 1), rtol=0, atol=PUBLISHED)
    wanted = rate[:, None] * np.stack([c, s], 1)[:3]
    assert np.allclose(v[1:4, :2], wanted, rtol=0, atol=PUBLISHED)
    assert np.allclose(pull[1:], tension, rtol=PUBLISHED, atol=0)


def test_arevalo_particle():
    """A particle driven around a circle by an effect of one's own: x = sin t², y = cos t², and the
    pull 4 t² (Arévalo and Lubich, BIT 35, 1995), from t = 1; each relative to its size.
    """
    start = np.array([np.sin(1.0), np.cos(1.0)])
    system = on_a_link(start, (2 * start[1], -2 * start[0]), 1.0, 0.0)
    motion = run(system, *np.linspace(1.0, 4.0, 31))
    t, q, v = (np.asarray(x) for x in (motion.t, motion.q[:, :2], motion.v[:, :2]))
    s, c = np.sin(t**2), np.cos(t**2)
    assert np.allclose(q, np.stack([s, c], 1), rtol=0, atol=PUBLISHED)
    assert np.allclose(v / t[:, None], 2 * np.stack([c, -s], 1), rtol=0, atol=PUBLISHED)
    assert np.allclose(motion.multipliers[:, 0] / t**2, 4.0, rtol=0, atol=PUBLISHED)


def test_four_bar_of_mass_points():
    """Two points of 3 kg on rigid links; the given start violates them and is projected to (7, 0),
    (7, 0). Places at 2 s, to nine digits.
    """
    bodies = [
        rj.RigidBody("first", 3.0, 1.0, position=(0.0, 2.0), velocity=(4.0, 0.0)),
        rj.RigidBody("second", 3.0, 1.0, position=(4.0, 5.0), velocity=(10.0, 0.0)),
    ]
    first, second = (body.at() for body in bodies)
    links = [
        rj.Distance(first, rj.ground.at(), length=2.0),
        rj.Distance(second, first, length=5.0),
        rj.Distance(second, rj.ground.at((4.0, 0.0)), length=5.0),
    ]
    system = rj.assemble(rj.Scene(bodies, links, [rj.Gravity()]))
    q, v = rj.consistent(system)
    assert np.allclose(v, [7.0, 0.0, 0.0, 7.0, 0.0, 0.0], rtol=0, atol=IDENTITY * 10)
    motion = run(system, 0.0, 2.0, q0=q, v0=v)
    wanted = [1.9642513176958342, -0.3764528668109448, 2.0926320726348379, 4.6218986996318651]
    assert np.allclose(np.asarray(motion.q)[-1, [0, 1, 3, 4]], wanted, rtol=0, atol=SOLVED)


@pytest.mark.slow
def test_simeon_slider_crank():
    """A flexible rod by its inertia invariants, hinged to a driven crank and a slider.

    The same model as his, in the redundant coordinates of three bodies: q and v to his digits.
    """
    crank = rj.RigidBody("crank", 0.36, simeon.CRANK, angular_velocity=simeon.SPEED)
    rod = simeon.rod()
    slider = rj.RigidBody(
        "slider", 0.075552, 1e-3, position=(simeon.START[2], 0.0), velocity=(simeon.RATES[2], 0.0)
    )
    joints = [
        rj.Revolute(crank.at(), rj.ground.at()),
        rj.PrescribedAngle(crank.at(), rj.ground.at(), rj.Ramp(simeon.SPEED)),
        rj.Revolute(rod.at("crank"), crank.at((0.15, 0.0))),
        rj.Revolute(rod.at("slider"), slider.at()),
        rj.Prismatic(slider.at(), rj.ground.at()),
    ]
    system = rj.assemble(rj.Scene([crank, rod, slider], joints))
    # The start has nine digits: velocities are projected, positions are not, as in the index two
    # of the reference; unstabilised, so that what is left of C stays.
    q, v = eqx.filter_jit(project)(system, 0.0, system.q0, system.v0, 0)
    settings = {"atol": 1e-15, "stabilization": None, "throw": False}
    motion = run(system, 0.0, 0.1, q0=q, v0=v, **settings)
    columns = [2, 5, 10, 6, 7, 8, 9]
    q, v = np.asarray(motion.q)[-1, columns], np.asarray(motion.v)[-1, columns]
    assert np.allclose(q, simeon.POSITIONS, rtol=PUBLISHED, atol=0)
    assert np.allclose(v, simeon.VELOCITIES, rtol=10 * PUBLISHED, atol=0)
