"""Bending moment, shear and axial force of beams: closed forms, and how they converge."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from motions import through
from tolerances import DIFFERENCED, SOLVED

import romjax as rj
from romjax.scene.body.modes import bending_roots, bending_shapes

# Required: resultants that the modes do not limit, relative to the largest.
EXACT = 1e-8
# Required: the error falls at least with this power of the number of modes.
ORDER = 4
MASS, LENGTH, STIFFNESS, TIP = 1.5, 1.2, 40.0, 3e-5
GRAVITY = 9.81
CUTS = jnp.array([-0.6, -0.35, 0.0, 0.2, 0.6])


def shape_values(modes, place):
    """Modes of a clamped beam at a place, 0 to 1, mass-normalised, with their frequencies."""
    frequency = bending_roots("clamped-free", modes) ** 2
    frequency *= np.sqrt(STIFFNESS / (MASS * LENGTH**3))
    values = bending_shapes("clamped-free", modes, np.asarray(place)[..., None], np)[0]
    return frequency, values / np.sqrt(MASS)


def cantilever(modes, *effects, amplitudes=None, axis="x", **options):
    """A beam that is clamped at its lower end, with effects of (its tip); at rest."""
    along = np.array([1.0, 0.0]) if axis == "x" else np.array([0.0, 1.0])
    half = LENGTH / 2 * along
    options = {"shapes": "clamped-free", "EI": STIFFNESS} | options
    beam = rj.Beam(
        "beam",
        MASS,
        LENGTH,
        modes=modes,
        axis=axis,
        position=half,
        amplitudes=amplitudes,
        **options,
    )
    joints = [rj.Weld(beam.at(-half), rj.ground.at(), name="root")]
    return rj.Scene([beam], joints, [effect(beam.at(half)) for effect in effects])


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


@pytest.mark.parametrize("modes", [1, 3])
def test_static_tip_load(modes):
    """M = F (L − s), V = F from the first mode on, in the static shape of the modes."""
    frequency, tip = shape_values(modes, 1.0)
    scene = cantilever(
        modes,
        lambda end: rj.Force(end, (0.0, 1.0), rj.Constant(TIP)),
        amplitudes=tip * TIP / frequency**2,
    )
    found = rj.resultants(*at_start(scene), "beam", CUTS)
    none = 0 * CUTS
    assert_resultants(found, shear=none + TIP, moment=TIP * (LENGTH / 2 - CUTS))
    # Along the tangent of the bent beam, which has turned.
    assert np.max(np.abs(found.axial)) < TIP * 1e-5


def load_of_gravity(modes):
    """∫ρ w of the modes."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    frequency, values = shape_values(modes, (nodes + 1) / 2)
    return frequency, MASS * weights / 2 @ values


@pytest.mark.parametrize("modes", [1, 3])
def test_static_weight(modes):
    """M = −ρ g (L − s)² / 2, V = −ρ g (L − s)."""
    weak = 1e-4
    frequency, load = load_of_gravity(modes)
    scene = cantilever(
        modes,
        lambda end: rj.Gravity((0.0, -weak)),
        amplitudes=-weak * load / frequency**2,
    )
    found = rj.resultants(*at_start(scene), scene.bodies[0], CUTS)
    rest, density = LENGTH / 2 - CUTS, MASS / LENGTH
    assert_resultants(found, shear=-density * weak * rest, moment=-density * weak * rest**2 / 2)


def test_upright_beam():
    """Along y: weight presses it, and a tip load to the right turns it clockwise."""
    scene = cantilever(
        0,
        lambda end: rj.Gravity(),
        lambda end: rj.Force(end, (1.0, 0.0), rj.Constant(2.0)),
        lambda end: rj.Torque(end, rj.Constant(0.7)),
        axis="y",
        EI=None,
        shapes="free-free",
    )
    found = rj.resultants(*at_start(scene), "beam", CUTS)
    rest = LENGTH / 2 - CUTS
    assert_resultants(
        found,
        axial=-MASS / LENGTH * GRAVITY * rest,
        shear=0 * rest - 2.0,
        moment=0.7 - 2.0 * rest,
    )


def test_a_load_at_the_cut():
    """It belongs to the outer side: a force at three quarters bends what is before it."""
    beam = rj.Beam("beam", MASS, LENGTH, position=(LENGTH / 2, 0))
    place = LENGTH / 4
    scene = rj.Scene(
        [beam],
        [rj.Weld(beam.at((-LENGTH / 2, 0)), rj.ground.at())],
        [rj.Force(beam.at((place, 0.1)), (1.0, 1.0), rj.Constant(np.sqrt(2)))],
    )
    found = rj.resultants(*at_start(scene), "beam", [0.0, place - 1e-3, place, place + 1e-3])
    # Off the axis by 0.1 m, its part along the beam turns too.
    moment = [place - 0.1, 1e-3 - 0.1, -0.1, 0]
    assert_resultants(found, axial=[1, 1, 1, 0], shear=[1, 1, 1, 0], moment=moment)


# In motion.


def test_spinning_bar():
    """N = ρ ω² (L² − s²) / 2 in a bar that spins freely about its end."""
    spin = 3.0
    bar = rj.Beam(
        "bar",
        MASS,
        LENGTH,
        position=(LENGTH / 2, 0),
        angular_velocity=spin,
        velocity=(0, spin * LENGTH / 2),
    )
    scene = rj.Scene([bar], [rj.Revolute(bar.at((-LENGTH / 2, 0)), rj.ground.at())])
    found = rj.resultants(*at_start(scene), bar, CUTS)
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
    bar = rj.Beam("bar", MASS, LENGTH, position=(LENGTH / 2, 0), inertia=inertia)
    scene = rj.Scene([bar], [rj.Revolute(bar.at((-LENGTH / 2, 0)), rj.ground.at())], [rj.Gravity()])
    found = rj.resultants(*at_start(scene), bar, CUTS)
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
    beam = rj.Beam(
        "beam",
        MASS,
        LENGTH,
        EI=STIFFNESS,
        modes=3,
        position=(LENGTH / 2, 0),
        amplitudes=(0.01, 0.002, 0.001),
        damping=0.02,
        rates=(0.1, 0.2, -0.1),
    )
    root = beam.at((-LENGTH / 2, 0))
    scene = rj.Scene(
        [beam],
        [rj.Revolute(root, rj.ground.at(), name="pin")],
        [rj.Gravity(), rj.Torque(root, rj.Constant(3.0))],
    )
    system = rj.assemble(scene)
    q0, v0 = rj.consistent(system)
    run = rj.simulate(system, jnp.linspace(0.0, 0.3, 7), q0=q0, v0=v0, rtol=1e-10)
    found = rj.resultants(system, run, beam, [-LENGTH / 2, LENGTH / 2])
    pin, torque = rj.joint_forces(system, run)["pin"], rj.effect_forces(system, run)
    # What the root does to the beam, turned to its tangent there, is the opposite of what the part
    # beyond does to it.
    angle = rj.measure(system, run, root).angle
    c, s = np.cos(angle), np.sin(angle)
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
    scene = cantilever(
        modes,
        lambda end: rj.Force(end, (0.0, 1.0), rj.Sine(TIP, forced / (2 * np.pi), phase=np.pi / 2)),
        amplitudes=q,
    )
    xi = np.array([0.0, 0.3, 0.6])
    found = rj.resultants(*at_start(scene), "beam", (xi - 0.5) * LENGTH)
    bent = jax.jit(jax.vmap(jax.hessian(lambda x: bending_shapes("clamped-free", modes, x)[0] @ q)))
    curvature = bent(jnp.asarray(xi)) / np.sqrt(MASS) / LENGTH**2
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
    ratio, counts = 0.5, (2, 4, 8)
    errors = []
    for modes in counts:
        by_equilibrium, by_curvature, xi = steady(modes, ratio)
        wanted = closed_form(xi, ratio)
        pair = [by_equilibrium - wanted, by_curvature - wanted]
        errors.append([np.max(np.abs(x)) for x in pair])
    errors = np.array(errors)
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(orders[:, 0] > ORDER), (errors, orders)
    assert np.all(orders[:, 1] < ORDER / 2), (errors, orders)
    assert errors[-1, 0] < 1e-7 < 1e-3 < errors[-1, 1], errors


# Transformations and wrong input.


@pytest.mark.slow
def test_derivative():
    """Of the moment at the root by the length of the beam and by a position, at given states."""
    scene = cantilever(1, lambda end: rj.Gravity())
    _, run = at_start(scene)

    @jax.jit
    def moment(x):
        changed = eqx.tree_at(lambda s: s.bodies[0].mass, scene, x)
        return rj.resultants(rj.assemble(changed), run, "beam", jnp.array([-0.2])).moment[0, 0]

    @jax.jit
    def placed(x):
        return rj.resultants(rj.assemble(scene), run, "beam", x[None]).moment[0, 0]

    for function, at in ((moment, jnp.asarray(MASS)), (placed, jnp.asarray(-0.2))):
        h = 1e-4
        wanted = (function(at + h) - function(at - h)) / (2 * h)
        assert_close(jax.grad(function)(at), wanted, DIFFERENCED, abs(wanted))
    batch = jax.jit(jax.vmap(moment))(jnp.array([MASS, 2.0]))
    assert_close(batch[0], moment(jnp.asarray(MASS)), SOLVED, abs(batch[0]))


def test_wrong_input():
    scene = cantilever(1, lambda end: rj.Gravity())
    scene = eqx.tree_at(lambda s: s.bodies, scene, (*scene.bodies, rj.RigidBody("box", 1.0, 1.0)))
    system, run = at_start(scene)
    for wrong, message in (
        (("box", [0.0]), "'box' is a RigidBody, but only an rj.Beam"),
        (("ground", [0.0]), "'ground' is the ground"),
        (("bean", [0.0]), "no body 'bean'. Did you mean 'beam'"),
        (("beam", [0.7]), "0.7 m from the middle of 'beam', which ends at 0.6 m"),
        (("beam", 0.0), "positions has shape"),
        (("beam", [jnp.nan]), "positions is"),
    ):
        with pytest.raises(rj.InputError, match=message):
            rj.resultants(system, run, *wrong)
