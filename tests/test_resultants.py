"""Bending moment, shear and axial force of beams: closed forms, and how they converge."""

import equinox as eqx
import jax
import numpy as np
import pytest
from at_rest import both_slopes, clamped_beam, frequencies_and_shapes
from comparison import assert_close
from motions import through
from tolerances import DIFFERENCED, IDENTITY

import romjax as rj
from romjax.scene.body.modes import bending_roots, bending_shapes

# Required: resultants that the modes do not limit, relative to the largest.
EXACT = 1e-8
# Required: the error falls at least with this power of the number of modes.
ORDER = 4
MASS, LENGTH, STIFFNESS, TIP = 1.5, 1.2, 40.0, 3e-5
GRAVITY = 9.81
CUTS = np.array([-0.6, -0.35, 0.0, 0.2, 0.6])


def shape_values(modes, place):
    return frequencies_and_shapes(MASS, LENGTH, STIFFNESS, place, modes)


def cantilever(modes, signal, amplitudes) -> rj.Scene:
    """A clamped beam at rest, with a force across its tip."""
    along = np.array([LENGTH / 2, 0.0])
    options = {"EI": STIFFNESS, "modes": modes, "shapes": "clamped-free", "amplitudes": amplitudes}
    beam = rj.Beam("beam", MASS, LENGTH, position=along, **options)
    root = rj.Weld(beam.at(-along), rj.ground.at())
    return rj.Scene([beam], [root], [rj.Force(beam.at(along), (0.0, 1.0), signal)])


def pushed(amplitudes, **loads) -> rj.Scene:
    """The clamped beam of all tests of forces, bent."""
    return clamped_beam(MASS, LENGTH, STIFFNESS, amplitudes=amplitudes, **loads)


def at_start(scene):
    """The system and the run that has only its start."""
    system = rj.assemble(scene)
    return system, through(system)


def assert_resultants(found, axial=None, shear=None, moment=None, tolerance=EXACT):
    """At the start, relative to the largest of each kind."""
    for name, wanted in (("axial", axial), ("shear", shear), ("moment", moment)):
        if wanted is not None:
            scale = np.max(np.abs(wanted)) or 1.0
            assert_close(getattr(found, name)[0], wanted, tolerance, scale)


# At rest.


def test_static_tip_load():
    """M = F (L − s), V = F in the static shape of the modes."""
    frequency, tip = shape_values(3, 1.0)
    scene = pushed(tip * TIP / frequency**2, push=TIP)
    found = rj.resultants(*at_start(scene), "beam", CUTS)
    none = 0 * CUTS
    assert_resultants(found, shear=none + TIP, moment=TIP * (LENGTH / 2 - CUTS))
    # Along the tangent of the bent beam, which has turned.
    assert np.max(np.abs(found.axial)) < TIP * 1e-5


def test_static_weight():
    """M = −ρ g (L − s)² / 2, V = −ρ g (L − s)."""
    weak = 1e-4
    nodes, weights = np.polynomial.legendre.leggauss(80)
    frequency, values = shape_values(3, (nodes + 1) / 2)
    load = MASS * weights / 2 @ values  # ∫ρ w of the modes
    scene = pushed(-weak * load / frequency**2, gravity=weak)
    found = rj.resultants(*at_start(scene), scene.bodies[0], CUTS)
    rest, density = LENGTH / 2 - CUTS, MASS / LENGTH
    assert_resultants(found, shear=-density * weak * rest, moment=-density * weak * rest**2 / 2)


def upright(place, direction, force, torque, gravity):
    """Resultants at rest of a rigid beam along y, with a force and a torque at a place of it."""
    beam = rj.Beam("beam", MASS, LENGTH, axis="y", position=(0.0, LENGTH / 2))
    at = beam.at(place)
    scene = rj.Scene(
        [beam],
        [rj.Weld(beam.at((0.0, -LENGTH / 2)), rj.ground.at())],
        [
            rj.Gravity((0.0, -gravity)),
            rj.Force(at, direction, rj.Constant(force)),
            rj.Torque(at, rj.Constant(torque)),
        ],
    )
    return at_start(scene)


def test_upright_beam():
    """Along y: weight presses it, and a tip load to the right turns it clockwise."""
    system, run = upright((0.0, LENGTH / 2), (1.0, 0.0), 2.0, 0.7, GRAVITY)
    found = rj.resultants(system, run, "beam", CUTS)
    rest = LENGTH / 2 - CUTS
    assert_resultants(
        found,
        axial=-MASS / LENGTH * GRAVITY * rest,
        shear=0 * rest - 2.0,
        moment=0.7 - 2.0 * rest,
    )


def test_a_load_at_the_cut():
    """It belongs to the outer side: a force at three quarters bends what is before it."""
    place = LENGTH / 4
    system, run = upright((-0.1, place), (-1.0, 1.0), np.sqrt(2), 0.0, 0.0)
    cuts = [0.0, place - 1e-3, place, place + 1e-3, LENGTH / 2]
    found = rj.resultants(system, run, "beam", cuts)
    # Off the axis by 0.1 m, its part along the beam turns too.
    moment = [place - 0.1, 1e-3 - 0.1, -0.1, 0, 0]
    assert_resultants(found, axial=[1, 1, 1, 0, 0], shear=[1, 1, 1, 0, 0], moment=moment)


# In motion.


def hinged(inertia=None, spin=0.0, gravity=0.0) -> rj.Scene:
    """A level bar that is hinged at its lower end."""
    bar = rj.Beam(
        "bar",
        MASS,
        LENGTH,
        position=(LENGTH / 2, 0),
        inertia=MASS * LENGTH**2 / 12 if inertia is None else inertia,
        angular_velocity=spin,
        velocity=(0, spin * LENGTH / 2),
    )
    hinge = rj.Revolute(bar.at((-LENGTH / 2, 0)), rj.ground.at())
    return rj.Scene([bar], [hinge], [rj.Gravity((0.0, -gravity))])


def test_spinning_bar():
    """N = ρ ω² (L² − s²) / 2 in a bar that spins freely about its end."""
    spin = 3.0
    scene = hinged(spin=spin)
    found = rj.resultants(*at_start(scene), scene.bodies[0], CUTS)
    s = CUTS + LENGTH / 2
    axial = MASS / LENGTH * spin**2 * (LENGTH**2 - s**2) / 2
    assert_resultants(found, axial=axial)
    assert_close(found.shear[0], 0, EXACT, np.max(axial))
    assert_close(found.moment[0], 0, EXACT, np.max(axial))


@pytest.mark.parametrize("inertia", [None, 0.4])
def test_falling_bar(inertia):
    """A bar that starts to fall about its end, with a rotary inertia of its sections too.

    By the angular acceleration α = m g L/2 / J of the end: V = ∫ρ (α s − g), M = ∫ρ (α s − g)
    (s − c) + rotary, from the cut to the tip, both negative.
    """
    found = rj.resultants(*at_start(hinged(inertia, gravity=GRAVITY)), "bar", CUTS)
    thin = MASS * LENGTH**2 / 12
    about_middle = thin if inertia is None else inertia
    down = MASS * GRAVITY * LENGTH / 2 / (about_middle + MASS * LENGTH**2 / 4)
    c, density = np.asarray(CUTS + LENGTH / 2), MASS / LENGTH
    square, cube = (LENGTH**2 - c**2) / 2, (LENGTH**3 - c**3) / 3
    rest = LENGTH - c
    shear = density * (down * square - GRAVITY * rest)
    moment = density * (down * (cube - c * square) - GRAVITY * rest**2 / 2)
    moment += (about_middle - thin) / LENGTH * rest * down
    assert_close(found.shear[0], shear, EXACT, MASS * GRAVITY)
    assert_close(found.moment[0], moment, EXACT, MASS * GRAVITY)


def test_ends_agree_with_joints():
    """The root of a beam that swings, bends and stiffens carries what its hinge and motor do."""
    angle, turning, count = np.array([0.4, -1.1]), np.array([2.0, -3.0]), 2
    bent = np.array([[0.01, 0.002, 0.001], [-0.02, 0.004, 0.003]])
    bending = np.array([[0.1, 0.2, -0.1], [0.3, -0.1, 0.2]])
    beam = rj.Beam(
        "beam", MASS, LENGTH, EI=STIFFNESS, modes=3, damping=0.02, position=(LENGTH / 2, 0)
    )
    root = beam.at((-LENGTH / 2, 0))
    scene = rj.Scene(
        [beam],
        [rj.Revolute(root, rj.ground.at(), name="pin")],
        [rj.Gravity(), rj.Torque(root, rj.Constant(3.0))],
    )
    system = rj.assemble(scene)
    # The lower end stays where it is.
    ends = bending_shapes("static", 3, 0.0, np)[0] / np.sqrt(MASS)
    c, s = np.cos(angle), np.sin(angle)
    along, across = np.stack([c, s], axis=1), np.stack([-s, c], axis=1)
    off, away = ((x @ ends)[:, None] for x in (bent, bending))
    rate = turning[:, None]
    q = [LENGTH / 2 * along - off * across, angle, bent]
    v = [rate * (LENGTH / 2 * across + off * along) - away * across, turning, bending]
    run = through(system, np.zeros(count), np.column_stack(q), np.column_stack(v))
    held = rj.measure(system, run, root)
    assert_close(held.position, np.zeros((count, 2)), IDENTITY)
    assert_close(held.velocity, np.zeros((count, 2)), IDENTITY, np.max(np.abs(v[0])))
    found = rj.resultants(system, run, beam, [-LENGTH / 2, LENGTH / 2])
    pin, torque = rj.joint_forces(system, run)["pin"], rj.effect_forces(system, run)
    # What the root does to the beam, turned to its tangent there, is the opposite of what the part
    # beyond does to it.
    c, s = np.cos(held.angle), np.sin(held.angle)
    x, y = np.asarray(pin.force).T
    scale = np.max(np.abs(pin.force))
    assert_close(found.axial[:, 0], -(c * x + s * y), EXACT, scale)
    assert_close(found.shear[:, 0], -(c * y - s * x), EXACT, scale)
    assert_close(found.moment[:, 0], -torque["Torque(beam)"].torque, EXACT, scale)
    for end in found:
        assert_close(end[:, 1], 0, EXACT, scale)


def steady(modes, ratio):
    """Moments over F L at cuts in steady vibration under F cos Ωt at the tip, at t = 0, Ω =
    `ratio` ω₁: by equilibrium, by EI w'' of the modes; and all that the full series gives.
    """
    frequency, tip = shape_values(modes, 1.0)
    forced = ratio * frequency[0]
    q = tip * TIP / (frequency**2 - forced**2)
    scene = cantilever(modes, rj.Sine(TIP, forced / (2 * np.pi), phase=np.pi / 2), q)
    xi = np.array([0.0, 0.3, 0.6])
    found = rj.resultants(*at_start(scene), "beam", (xi - 0.5) * LENGTH)
    near, step = xi[:, None, None] + 1e-4 * np.array([[-1.0], [1.0]]), 2e-4
    slopes = bending_shapes("clamped-free", modes, near, np)[1] @ q
    curvature = np.diff(slopes, axis=1)[:, 0] / step / np.sqrt(MASS) / LENGTH**2
    return np.asarray(found.moment[0]) / (TIP * LENGTH), STIFFNESS * curvature / (TIP * LENGTH), xi


def closed_form(xi, ratio):
    """EI w'' over F L of the Euler–Bernoulli beam: w = A (cos kx − cosh kx) + B (sin kx − sinh kx),
    with w'' = 0 and EI w''' = −F at the tip.
    """
    k = bending_roots("clamped-free", 1)[0] * np.sqrt(ratio)
    c, s, ch, sh = np.cos(k), np.sin(k), np.cosh(k), np.sinh(k)
    rows = np.array([[-c - ch, -s - sh], [s - sh, -c - ch]])
    a, b = np.linalg.solve(rows * np.array([[k**2], [k**3]]), [0.0, -1.0])
    x = k * xi
    return k**2 * (a * (-np.cos(x) - np.cosh(x)) + b * (-np.sin(x) - np.sinh(x)))


@pytest.mark.slow
def test_convergence():
    """With modes, moments by equilibrium converge with the fifth order; by EI w'' with the second.

    In steady vibration at half the first frequency, against the closed form of the beam.
    """
    ratio, counts = 0.5, (2, 8)
    errors = []
    for modes in counts:
        by_equilibrium, by_curvature, xi = steady(modes, ratio)
        wanted = closed_form(xi, ratio)
        pair = [by_equilibrium - wanted, by_curvature - wanted]
        errors.append([np.max(np.abs(x)) for x in pair])
    errors = np.array(errors)
    orders = np.log(errors[:-1] / errors[1:]) / np.log(4)
    assert np.all(orders[:, 0] > ORDER), (errors, orders)
    assert np.all(orders[:, 1] < ORDER / 2), (errors, orders)
    assert errors[-1, 0] < 1e-7 < 1e-3 < errors[-1, 1], errors


# Transformations and wrong input.


@pytest.mark.slow
def test_derivative():
    """Of a moment by the mass of the beam and by the position, forwards and backwards."""
    scene = hinged(gravity=GRAVITY)
    _, run = at_start(scene)

    def moment(mass, place):
        changed = eqx.tree_at(lambda s: s.bodies[0].mass, scene, mass)
        return rj.resultants(rj.assemble(changed), run, "bar", place[None]).moment[0, 0]

    @jax.jit
    @jax.vmap
    def slopes(mass, place):
        by_mass = both_slopes(lambda mass: moment(mass, place), mass)
        return *by_mass, *both_slopes(lambda place: moment(mass, place), place)[1:]

    step = 1e-4 * np.array([0.0, -1.0, 1.0, 0.0, 0.0])
    found, *derivatives = map(np.asarray, slopes(MASS + step, 0.1 + step[[0, 3, 4, 1, 2]]))
    for pair, derivative in zip(([1, 2], [3, 4]), (derivatives[:2], derivatives[2:]), strict=True):
        wanted = np.diff(found[pair])[0] / 2e-4
        for one in derivative:
            assert_close(one[0], wanted, DIFFERENCED, abs(wanted))


def test_wrong_input():
    scene = pushed((0.0, 0.0, 0.0))
    scene = eqx.tree_at(lambda s: s.bodies, scene, (*scene.bodies, rj.RigidBody("box", 1.0, 1.0)))
    system, run = at_start(scene)
    for wrong, message in (
        (("box", [0.0]), "'box' is a RigidBody, but only a Beam or a Rod"),
        (("ground", [0.0]), "'ground' is the ground"),
        (("bean", [0.0]), "no body 'bean'. Did you mean 'beam'"),
        (("beam", [0.7]), "0.7 m from the middle of 'beam', which ends at 0.6 m"),
        (("beam", 0.0), "positions has shape"),
        (("beam", [np.nan]), "positions is"),
    ):
        with pytest.raises(rj.InputError, match=message):
            rj.resultants(system, run, *wrong)
