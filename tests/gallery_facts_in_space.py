"""What the ready scenes in space show, each a function of the system and its run."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import scipy.special
from comparison import assert_close
from gallery_facts import SHOWN, bodies_of, crossings
from zoo import GRAVITY

import romjax as rj
from romjax.linalg import quaternions


def turning(run, name):
    """A body's rates about its own axes, and the rotation matrices from them."""
    p, rate = (
        np.stack([np.asarray(run[f"{name}.{x}{prime}"]) for x in ("p0", "p1", "p2", "p3")], axis=1)
        for prime in ("", "'")
    )
    return quaternions.body_angular_velocity(p, rate), quaternions.matrix(p)


def places(run, name, prime=""):
    return np.stack([np.asarray(run[f"{name}.{x}{prime}"]) for x in "xyz"], axis=1)


def angular_momentum(run, bodies):
    """Of the frames of bodies, about the z axis."""
    total = 0.0
    for name, body in bodies.items():
        rates, axes = turning(run, name)
        spin = np.einsum("tij,tj->ti", axes, rates * np.asarray(body.inertia))
        orbit = np.cross(places(run, name), places(run, name, "'"))
        total += spin[:, 2] + float(body.mass) * orbit[:, 2]
    return total


def spinning_top(system, run):
    """The digits of two integrations in 40 digits; angular momentum along the axis stays."""
    wanted = np.array([0.17334396409838604, 0.6400885920705688, -0.7484907911335813])
    assert_close(places(run, "top")[-1], wanted, SHOWN)
    assert_close(turning(run, "top")[0][:, 1], 150.0, SHOWN, scale=150.0)


def wing_nut(system, run):
    """Twice in a period the spin turns round, by Jacobi's functions every 4.4055 s."""
    rates, _ = turning(run, "nut")
    moments = np.array([1.0, 2.0, 3.0])
    momentum, energy = np.sum((moments * rates[0]) ** 2), 0.5 * np.sum(moments * rates[0] ** 2)
    (a, b, c), spare = moments, momentum - 2 * energy * moments
    # L² > 2 T B, or the axes of A and C change places.
    assert spare[1] > 0
    speed = math.sqrt((c - b) * spare[0] / (a * b * c))
    modulus = -(b - a) * spare[2] / ((c - b) * spare[0])
    half = 2 * scipy.special.ellipk(modulus) / speed
    assert_close(half, 8.8110139803351158 / 2, SHOWN)
    t = np.asarray(run.t)
    turns = np.sort(np.concatenate([crossings(t, rates[:, 1]), crossings(t, -rates[:, 1])]))
    assert_close(np.diff(turns), half, 10 * SHOWN, scale=half)
    assert len(turns) == 2


def spatial_slider_crank(system, run):
    """The digits of two integrations in 40 digits."""
    assert_close(np.asarray(run["slider.x"])[-1], 0.211721661393443778, SHOWN)
    angle = 2 * np.unwrap(np.arctan2(run["crank.p1"], run["crank.p0"]), period=np.pi)
    assert_close(angle[-1] - angle[0], 10.913590729864667999, SHOWN)


def bricard(system, run):
    """The published position of the fourth corner after a second."""
    corner = rj.measure(system, run, bodies_of("bricard")["rod3"].at("end")).position
    second = np.argmin(np.abs(np.asarray(run.t) - 1.0))
    assert_close(corner[second], np.array([0.5105, -1.6492, 0.1401]), SHOWN)


def flyball_governor(system, run):
    """The angular momentum stays, and stiff couplers carry the slider as rigid ones would."""
    bodies = bodies_of("flyball-governor")
    momentum = angular_momentum(run, bodies)
    assert_close(momentum, momentum[0], SHOWN, scale=momentum[0])
    _, axes = turning(run, "arm1")
    # Couplers of half of an arm: the slider is an arm's own depth below its hinge.
    height = np.asarray(run["slider.z"])
    assert_close(height, 1.0 + axes[:, 2, 2], 5 * SHOWN)
    assert np.ptp(height) > 0.1


def ball_chain(system, run):
    """Gravity does not act about the vertical through the pivot."""
    momentum = angular_momentum(run, bodies_of("ball-chain"))
    assert_close(momentum, momentum[0], SHOWN, scale=momentum[0])


def rotor(system, run):
    """The unbalance moves the shaft on its circle; a tilt whirls at the two rates."""
    mass, across, along, span, stiffness, speed, unbalance = 2.0, 0.02, 0.03, 0.4, 2e4, 200.0, 1e-3
    body, t = bodies_of("rotor")["rotor"], np.asarray(run.t)
    lower, upper = (
        np.asarray(rj.measure(system, run, body.at(end)).position) for end in ("lower", "upper")
    )
    shaft = 0.5 * (lower + upper) @ np.array([1, 1j, 0])
    radius = unbalance * speed**2 / (2 * stiffness / mass - speed**2)
    assert_close(shaft, radius * np.exp(1j * speed * t), 10 * SHOWN, scale=abs(radius))
    rates = np.roots([across, -along * speed, -0.5 * stiffness * span**2])
    assert rates[0] * rates[1] < 0
    way = 0.5 * (upper - lower) @ np.array([1, 1j, 0])
    whirl = np.exp(1j * rates[None] * t[:, None])
    share = np.linalg.lstsq(whirl, way, rcond=None)[0]
    assert np.all(np.abs(share) > 1e-4)
    assert_close(whirl @ share, way, 10 * SHOWN, scale=np.max(np.abs(way)))


def spatial_arm(system, run):
    """At the end each drive that lifts carries the weight of all that is beyond it."""
    bodies = bodies_of("spatial-arm")
    forces = rj.effect_forces(system, run)
    _, *lifting = [key for key in forces if key.startswith("Motor")]
    weights = GRAVITY * np.array([3.0, 2.0, 1.5])
    middles = np.array([places(run, name)[-1] for name in ("upper", "fore", "load")])
    for i, (key, name) in enumerate(zip(lifting, ("upper", "fore"), strict=True)):
        hinge = rj.measure(system, run, bodies[name].at("start")).position[-1]
        arms = np.linalg.norm((middles - np.asarray(hinge))[:, :2], axis=1)
        wanted = np.sum((weights * arms)[i:])
        assert_close(np.linalg.norm(forces[key].torque[-1]), wanted, 2e-2, scale=wanted)


def helicopter_rotor(system, run):
    """The tabulated frequency of flapping at a speed of 2; all blades flap alike."""
    bodies = bodies_of("helicopter-rotor")
    tips = [
        np.asarray(rj.measure(system, run, bodies[f"blade{i + 1}"].at("end")).position[:, 2])
        for i in range(3)
    ]
    assert_close(tips[1], tips[0], SHOWN, scale=np.max(np.abs(tips[0])))
    free = np.asarray(run.t) > 0.5
    times = crossings(np.asarray(run.t)[free], tips[0][free])
    wanted = 4.1373 * math.sqrt(4e3 / (20.0 * 5.0**3))
    assert_close(2 * math.pi / np.mean(np.diff(times)), wanted, 10 * SHOWN, scale=wanted)


def flexible_link(system, run):
    """Gravity does not act about the vertical, about which the link has what its drive gave, 2 T τ;
    and it bends far.
    """
    (link,) = rj.gallery.flexible_link().bodies
    momentum = np.asarray(_about_z(link, run.q, run.v))
    free = np.asarray(run.t) > 0.9
    assert_close(momentum[free], 2 * 1.0 * 0.3, SHOWN, scale=0.6)
    _, axes = turning(run, "link")
    across = np.einsum(
        "ti,ti->t", rj.measure(system, run, link.at("end")).rotation[:, :, 0], axes[:, :, 0]
    )
    assert np.min(across) < math.cos(1.0)


@jax.jit
def _about_z(rod, q, v):
    """The angular momentum of a rod about the z axis of space, by a rigid rotation of it."""

    def momentum(q, v):
        x, y, p = q[0], q[1], q[3:7]
        turn = 0.5 * quaternions.product(jnp.array([0.0, 0.0, 0.0, 1.0]), p)
        rotation = jnp.concatenate([jnp.array([-y, x, 0.0]), turn, jnp.zeros(rod.modes)])
        return rotation @ rod.mass_matrix(q) @ v

    return jax.vmap(momentum)(q, v)


def satellite(system, run):
    """Torque times time is angular momentum, of which the modes of free panels have none."""
    momentum = angular_momentum(run, bodies_of("satellite"))
    free = np.asarray(run.t) > 1.2
    assert_close(momentum[free], 10.0 * 1.0, 5 * SHOWN, scale=10.0)
    # The panels swing, and the hub against them.
    assert np.ptp(turning(run, "hub")[0][free, 2]) > 0.01


IN_SPACE = (
    spinning_top,
    wing_nut,
    spatial_slider_crank,
    bricard,
    flyball_governor,
    ball_chain,
    rotor,
    spatial_arm,
    helicopter_rotor,
    flexible_link,
    satellite,
)
