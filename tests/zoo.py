"""The mechanisms that tests move, each compiled once for all of them.

Numbers are arguments of compiled programs: masses, lengths, starts, tolerances, and output times up
to some hundreds. Bodies, joints, effects, methods and settings of a run are their structure. So a
test takes a structure from here that has what it is about, with numbers of its own, and moves it by
`run`; only what a test shows of another structure is worth compiling one.
"""

import functools

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from mechanisms import ends, linkage

import romjax as rj
from romjax import spatial as r

GRAVITY = 9.81
# The methods of tests: of nearly all, and where a mechanism is stiff.
DOPRI8, RODAS5P = diffrax.Dopri8(), rj.Rodas5P()
# Step size control of the runs that others are measured against: a hundredth of SOLVED at a step.
TIGHT = 1e-10


def run(
    system, ts, *, solver=DOPRI8, rtol=TIGHT, stabilization="alike", audit=False, **settings
) -> rj.Trajectory:
    """A motion at a tight tolerance, without the balance of energy, and with the constraints of all
    mechanisms damped alike: what most tests do not look at would be half of what is compiled.
    """
    if stabilization == "alike":
        # Critically, at about one turn in a second; the default asks for frequencies.
        stabilization = rj.Baumgarte(alpha=12.0, beta=36.0) if system.m else None
    given = {"rtol": rtol, "stabilization": stabilization, "audit": audit}
    return rj.simulate(system, ts, solver=solver, **given, **settings)


@functools.cache
def system(make, **numbers) -> rj.AbstractSystem:
    """What `make(**numbers)` of this module is assembled to."""
    return rj.assemble(make(**numbers))


@functools.cache
def motion(make, end=1.0, count=101, **numbers) -> rj.Trajectory:
    """A run of `make(**numbers)`, by the method that suits it, whose `.system` is known."""
    stiff = make in (cart_pendulum, falling_beams)
    return run(
        system(make, **numbers),
        np.linspace(0.0, end, count),
        solver=RODAS5P if stiff else DOPRI8,
    )


# In the plane.


def bar(mass=1.0, length=1.0, angle=0.0, spin=0.0, gravity=GRAVITY) -> rj.Scene:
    """A uniform bar hinged at the origin, at an angle against the x axis [rad]: a pendulum."""
    return bars((mass,), length, (angle,), (spin,), gravity)


def bars(masses=(1.0, 1.0), length=1.0, angles=(0.0, 0.0), spins=(0.0, 0.0), gravity=GRAVITY):
    """Uniform bars of one length, hinged end to end from the origin."""
    links, start, speed = [], np.zeros(2), np.zeros(2)
    for i, (mass, angle, spin) in enumerate(zip(masses, angles, spins, strict=True)):
        half = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
        turning = spin * np.array([-half[1], half[0]])
        links.append(
            rj.RigidBody(
                f"bar{i + 1}",
                mass,
                mass * length**2 / 12,
                position=start + half,
                angle=angle,
                velocity=speed + turning,
                angular_velocity=spin,
                extent=(length, 0.1),
            )
        )
        start, speed = start + 2 * half, speed + 2 * turning
    anchors = [rj.ground.at(), *(ends(link)[1] for link in links)]
    hinges = [rj.Revolute(ends(b)[0], at) for b, at in zip(links, anchors, strict=False)]
    return rj.Scene(links, hinges, [rj.Gravity((0.0, -gravity))])


def four_bar(coupler=1.0, doubled=False, gravity=True) -> rj.Scene:
    """Crank, coupler and rocker under gravity; the first hinge may be made twice."""
    points = {"A": (0, 0), "b": (0.3, 0.9), "c": (1.8, 1.3), "D": (2.0, 0)}
    pairs = [("A", "b"), ("b", "c"), ("D", "c")]
    scene = linkage(points, pairs, {}, gravity=gravity, masses=[1.0, coupler, 1.0])
    again = scene.joints[:1] if doubled else ()
    return rj.Scene(scene.bodies, (*scene.joints, *again), scene.effects)


driven_four_bar = rj.gallery.four_bar


def bending_four_bar(speed=10.0, EI=7.0) -> rj.Scene:
    """A crank that turns steadily, a coupler that bends, and a rocker."""
    points = {"A": (0, 0), "b": (0.05, 0.09), "c": (0.28, 0.42), "D": (0.35, 0.13)}
    pairs, masses = [("A", "b"), ("b", "c"), ("D", "c")], [0.05, 0.11, 0.08]
    crank, rod, rocker = linkage(points, pairs, {}, masses=masses).bodies
    place = {"position": rod.position, "angle": rod.angle}
    coupler = rj.Beam("coupler", 0.11, float(np.hypot(0.23, 0.33)), EI=EI, modes=2, **place)
    joints = [
        rj.Revolute(ends(crank)[0], rj.ground.at(points["A"])),
        rj.Revolute(coupler.at("start"), ends(crank)[1]),
        rj.Revolute(ends(rocker)[1], coupler.at("end")),
        rj.Revolute(ends(rocker)[0], rj.ground.at(points["D"])),
        rj.PrescribedAngle(crank.at(), rj.ground.at(), rj.Ramp(speed, crank.angle)),
    ]
    return rj.consistent_scene(rj.Scene([crank, coupler, rocker], joints, [rj.Gravity()]))


cart_pendulum = rj.gallery.cart_pendulum

CRANK = 0.3  # [m]


def slider_crank(slider=0.7, length=1.0, turning=9.0, bends=False) -> rj.Scene:
    """A crank that goes round from above, a rod that may bend, and a slider on a spring."""
    reach, along = jnp.sqrt(length**2 - CRANK**2), jnp.array([-turning * CRANK, 0.0])
    crank = rj.RigidBody(
        "crank",
        1.0,
        0.02,
        position=(0.0, CRANK / 2),
        angle=jnp.pi / 2,
        velocity=along / 2,
        angular_velocity=turning,
    )
    # With the crank upright the rod does not turn, and moves as the slider does.
    start = {
        "position": jnp.stack([reach / 2, CRANK / 2]),
        "angle": -jnp.arcsin(CRANK / length),
        "velocity": along,
    }
    if bends:
        bending = {"EI": 60.0, "modes": 2, "shapes": "free-free"}
        rod = rj.Beam("rod", mass=0.5, length=length, **bending, **start)
    else:
        rod = rj.RigidBody("rod", 0.5, 0.04, **start)
    piston = rj.RigidBody(
        "piston", slider, 0.1, position=jnp.stack([reach, 0.0 * reach]), velocity=along
    )
    half = jnp.stack([length / 2, 0.0 * reach])
    joints = [
        rj.Revolute(crank.at((-CRANK / 2, 0.0)), rj.ground.at()),
        rj.Revolute(rod.at(-half), crank.at((CRANK / 2, 0.0))),
        rj.Revolute(piston.at(), rod.at(half)),
        rj.Prismatic(piston.at(), rj.ground.at()),
    ]
    pull = rj.Spring(piston.at(), rj.ground.at((2.0, 0.0)), 20.0, 0.9)
    return rj.Scene([crank, rod, piston], joints, [rj.Gravity(), pull])


def five_bar(spring=60.0, mass=1.0) -> rj.Scene:
    """Two cranks, and two rods between them whose common pin hangs on a spring: two freedoms."""
    points = {"A": (0, 0), "b": (-0.6, 1.0), "c": (0.6, 1.9), "d": (1.7, 1.0), "E": (1.0, 0)}
    pairs = [("A", "b"), ("b", "c"), ("c", "d"), ("E", "d")]
    scene = linkage(points, pairs, {}, gravity=True, masses=[1.0, mass, 1.0, 1.0])
    left, rod, _, right = scene.bodies
    springs = [
        rj.Spring(ends(rod)[1], rj.ground.at((0.5, 2.6)), spring, 0.5),
        rj.Spring(left.at(), rj.ground.at((-1.5, 1.0)), 50.0, 1.0),
        rj.Spring(right.at(), rj.ground.at((2.5, 1.0)), 50.0, 1.0),
    ]
    return rj.Scene(scene.bodies, scene.joints, [*scene.effects, *springs])


def falling_beams(count=3, mass=1.0) -> rj.Scene:
    """Beams of 1 m with three modes, hinged end to end from the origin, level and at rest."""
    beams = [
        rj.Beam(f"beam{i}", mass, 1.0, frequencies=[30.0, 80.0, 150.0], position=(i + 0.5, 0.0))
        for i in range(count)
    ]
    hinges = [rj.ground.at(), *(beam.at((0.5, 0.0)) for beam in beams)]
    joints = [
        rj.Revolute(beam.at((-0.5, 0.0)), hinge) for beam, hinge in zip(beams, hinges, strict=False)
    ]
    return rj.Scene(beams, joints, [rj.Gravity()])


# In space.

top = rj.gallery.spinning_top
ball_bars = functools.partial(rj.gallery.ball_chain, 2)
loop_in_space = rj.gallery.spatial_slider_crank


def driven_loop_in_space(speed=6.0) -> rj.Scene:
    """The spatial slider crank, its crank turned steadily."""
    scene = loop_in_space(speed=speed)
    bearing = scene.joints[0]
    drive = rj.PrescribedAngle(bearing.a, bearing.b, rj.Ramp(speed), name="drive")
    return rj.consistent_scene(rj.Scene(scene.bodies, (*scene.joints, drive), scene.effects))


def beam_in_space(mass=0.7, EI=3.0, length=1.3, spin=2.0) -> rj.Scene:
    """A beam of two modes in each plane, hinged about z at its lower end, under gravity."""
    across = mass * length**2 / 12
    beam = r.Beam(
        "beam",
        mass,
        length,
        EI=EI,
        bending=2,
        inertia=(1e-3, across, across),
        position=(length / 2, 0.0, 0.0),
        velocity=(0.0, spin * length / 2, 0.0),
        angular_velocity=(0.0, 0.0, spin),
    )
    up = (0.0, 0.0, 1.0)
    hinge = r.Revolute(
        beam.at((-length / 2, 0.0, 0.0), axis=up), rj.ground.at((0.0, 0.0, 0.0), axis=up)
    )
    return rj.Scene([beam], [hinge], [rj.Gravity((0.0, -GRAVITY, 0.0))])


# One or two coordinates, for what the integration does with any system.


class Stiffness(eqx.Module):
    """The force of a spring and a damper on each coordinate, whose numbers are parameters."""

    stiffness: Array
    damping: Array

    def __call__(self, t, q, v):
        return -self.stiffness * q - self.damping * v


def unit_mass(q):
    return jnp.eye(q.shape[0])


def oscillator(frequencies=(2.0,), damping=0.0, q0=None, v0=None) -> rj.CustomSystem:
    """Masses of 1 kg on springs, each for itself: q̈ = −ω² q − d q̇, released from 1 m at rest."""
    omega = jnp.asarray(np.asarray(frequencies, float))
    force = Stiffness(omega**2, jnp.full(omega.shape, damping))
    start = np.ones(len(frequencies)) if q0 is None else q0
    return rj.CustomSystem(unit_mass, force, q0=start, v0=0 * start if v0 is None else v0)


def weight(t, q, v):
    return jnp.array([0.0, -GRAVITY])


def unit_circle(t, q):
    return 0.5 * (q @ q - 1)[None]


def point_pendulum(q0=(1.0, 0.0), v0=(0.0, 0.0)) -> rj.CustomSystem:
    """A point mass of 1 kg on a massless bar of 1 m, level and at rest."""
    return rj.CustomSystem(unit_mass, weight, unit_circle, q0=list(q0), v0=list(v0))
