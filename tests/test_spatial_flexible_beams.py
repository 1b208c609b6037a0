"""Beams in space: modes, sections, rotating blades, shafts that spin, against closed forms."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize
from comparison import assert_close
from test_beams import stiffened
from tolerances import DIFFERENCED, IDENTITY, SOLVED

import romjax as rj
from romjax import spatial
from romjax.linalg import quaternions
from romjax.scene.body.capped import CappedBody
from romjax.scene.body.modes import bending_roots
from romjax.scene.body.reduced import ReducedBody
from romjax.scene.body.spatial.free_modes import free_modes
from romjax.system import dynamics

LENGTH, MASS, EI = 1.3, 0.7, 3.0
POLAR = 1e-5
# Of frequencies of a blade by six modes in each plane, against a basis of polynomials.
CONVERGED = 1e-3


def beam(**settings):
    across = MASS * LENGTH**2 / 12 + POLAR / 2
    settings = {"inertia": (POLAR, across, across), "EI": EI, "bending": 6, **settings}
    return spatial.Beam("beam", MASS, LENGTH, **settings)


def marker(body, q, point):
    """Where a material point of a body is, as a position and a quaternion."""
    bent, point = q[7:], jnp.asarray(point)
    moved = body.mode_shapes(point) @ bent
    arm = point + moved[:3]
    if body.foreshortens:
        arm -= 0.5 * (body.foreshortening(point) @ bent) @ bent
    turn = quaternions.product(q[3:7], quaternions.small_turn(moved[3:]))
    return q[:3] + quaternions.rotate(q[3:7], arm), turn


def clamped(body, bent):
    """The coordinates of a beam whose lower end is clamped at the origin."""
    level = jnp.concatenate([jnp.zeros(3), jnp.array([1.0, 0, 0, 0]), bent])
    start = (-body.length / 2, 0.0, 0.0)
    _, turn = marker(body, level, start)
    turned = level.at[3:7].set(quaternions.conjugate(turn))
    place, _ = marker(body, turned, start)
    return turned.at[:3].set(-place)


def turning(q, v, spin):
    """The velocities of a body, given those against axes that turn by `spin`."""
    about = jnp.concatenate([jnp.cross(spin, q[:3]), quaternions.derivative(q[3:7], spin)])
    return v.at[:7].add(about)


def small_motion(lagrangian, count):
    """M, G and K of M a + G v + K x = 0 about the origin of a Lagrangian of x and v."""
    x = jnp.zeros(count)

    def second(first, other):
        return jax.jacfwd(jax.grad(lagrangian, first), other)(x, x)

    coupling = second(1, 0)
    return second(1, 1), coupling - coupling.T, -second(0, 0)


def rates(mass, gyroscopic, stiffness):
    """Angular frequencies of small motions."""
    count = len(mass)
    above = np.hstack([np.zeros((count, count)), np.eye(count)])
    below = -np.linalg.inv(mass) @ np.hstack([stiffness, gyroscopic])
    return np.sort(np.abs(scipy.linalg.eigvals(np.vstack([above, below])).imag))[::2]


def test_frequencies_of_a_free_beam():
    """(βL)² √(EI / m L³) of eight or seven modes, kπ √(GJ / I L) and kπ √(EA / m L) of six."""
    body = beam(EI=(EI, 2 * EI), bending=(8, 7), GJ=2.0, torsion=6, EA=1e3, extension=6)
    found = np.split(body.natural_frequencies(), [8, 15, 21])
    roots = bending_roots("free-free", 2) ** 2
    unit = np.sqrt(EI / (MASS * LENGTH**3))
    assert_close(found[0][:2], roots * unit * np.sqrt(2), CONVERGED, roots * unit)
    assert_close(found[1][:2], roots * unit, CONVERGED, roots * unit)
    bar = np.pi * np.arange(1, 3)
    for own, speed in ((found[2], 2.0 / POLAR), (found[3], 1e3 / MASS)):
        wanted = bar * np.sqrt(speed / LENGTH)
        assert_close(own[:2], wanted, CONVERGED, wanted)


@pytest.mark.parametrize("order", [1, 2])
def test_modes_are_orthonormal(order):
    nodes, weights = np.polynomial.legendre.leggauss(20)
    values = np.polynomial.legendre.legval(nodes, free_modes(order, 6).series)
    gram = (values * weights / 2) @ values.T
    assert_close(gram, np.eye(6), IDENTITY)
    assert_close((values * weights * nodes ** (order - 1)) @ np.ones(20), np.zeros(6), IDENTITY)


def test_statics_under_loads_at_the_end_are_exact():
    """Tip of a clamped beam of the fewest modes: F L³ / 3EI, M L / EI, T L / GJ, N L / EA."""
    body = beam(EI=(EI, 2 * EI), bending=2, GJ=2.0, torsion=1, EA=1e3, extension=1)
    frequencies = body.natural_frequencies()

    def tip(bent):
        place, turn = marker(body, clamped(body, bent), (LENGTH / 2, 0.0, 0.0))
        return jnp.concatenate([place - jnp.array([LENGTH, 0, 0]), 2 * turn[1:] / turn[0]])

    compliance = jax.jacfwd(tip)(jnp.zeros(6)) / frequencies[None]
    y, z = (LENGTH / (x * EI) * np.array([LENGTH**2 / 3, LENGTH / 2, 1.0]) for x in (2, 1))
    wanted = np.diag([LENGTH / 1e3, y[0], z[0], LENGTH / 2.0, z[2], y[2]])
    wanted[1, 5] = wanted[5, 1] = y[1]
    wanted[2, 4] = wanted[4, 2] = -z[1]
    assert_close(compliance @ compliance.T, wanted, IDENTITY, np.max(wanted))


@jax.jit
def blade(spin):
    """A stiffened blade that turns about z, clamped to the axis."""
    body = beam(stiffening=True)

    def lagrangian(bent, rate):
        q, v = jax.jvp(functools.partial(clamped, body), (bent,), (rate,))
        v = turning(q, v, jnp.zeros(3).at[2].set(spin))
        return 0.5 * v @ body.mass_matrix(q) @ v - body.elastic_energy(q)

    return small_motion(lagrangian, body.modes)


@pytest.mark.parametrize("speed", [0.0, 1.0, 2.0, 6.0])
def test_rotating_cantilever(speed):
    """Flap of a stiffened blade, in units of √(EI / m L³); lead-lag is √(flap² − Ω²)."""
    unit = np.sqrt(EI / (MASS * LENGTH**3))
    found = rates(*blade(speed * unit))[:2] / unit
    lag = stiffened(0.0, speed)
    flap = np.sqrt(lag**2 + speed**2)
    assert_close(found, [lag, flap], CONVERGED, flap)
    published = {0.0: 3.5160, 1.0: 3.6816, 2.0: 4.1373}
    if speed in published:
        assert_close(found[1], published[speed], CONVERGED)


@functools.partial(jax.jit, static_argnums=1)
def shaft(spin, polar):
    """A Rayleigh shaft that turns about its axis, by axes that turn with it."""
    across = MASS * LENGTH**2 / 12 + polar / 2
    body = beam(inertia=(polar, across, across), bending=9, rotary=True)
    count = 4 + body.modes

    def place(x):
        turn = jnp.concatenate([jnp.ones(1), jnp.zeros(1), 0.5 * x[2:4]])
        return jnp.concatenate([jnp.zeros(1), x[:2], turn, x[4:]])

    def lagrangian(x, rate):
        q, v = jax.jvp(place, (x,), (rate,))
        v = turning(q, v, jnp.zeros(3).at[0].set(spin))
        return 0.5 * v @ body.mass_matrix(q) @ v - body.elastic_energy(q)

    def off(x):
        ends = jnp.array([[-LENGTH / 2, 0.0, 0.0], [LENGTH / 2, 0.0, 0.0]])
        return jnp.concatenate([marker(body, place(x), end)[0][1:] for end in ends])

    return small_motion(lagrangian, count), jax.jacfwd(off)(jnp.zeros(count))


@pytest.mark.parametrize("spin", [0.0, 40.0])
def test_whirl_of_a_spinning_shaft(spin):
    """On bearings: (m/L + i β²) ω² − 2 i β² Ω ω − E I β⁴ = 0 of sections with a moment i about
    their diameters, β = kπ / L, by axes that do not turn.
    """
    polar = 0.02
    matrices, off = shaft(spin, polar)
    free = scipy.linalg.null_space(off)
    found = rates(*(free.T @ x @ free for x in matrices))[:3]
    wanted = []
    for k in range(1, 5):
        beta = k * np.pi / LENGTH
        tilted = polar / 2 / LENGTH * beta**2
        inertia = MASS / LENGTH + tilted
        wanted += list(np.roots([inertia, -2 * tilted * spin, -EI * beta**4]) - spin)
    wanted = np.sort(np.abs(wanted))[:3]
    assert_close(found, wanted, DIFFERENCED, wanted)


def test_critical_speeds_of_an_overhung_disc():
    """A disc on a light shaft that is clamped in its bearing: det(K − Ω² diag(m, J − J_p)) = 0."""
    disc = spatial.RigidBody("disc", 2.0, (0.02, 0.012, 0.012))
    light = 1e-9
    across = light * LENGTH**2 / 12
    body = spatial.Beam("shaft", light, LENGTH, (across, across, across), EI=EI, bending=2)
    stiffness = EI / LENGTH**3 * np.array([[12, -6 * LENGTH], [-6 * LENGTH, 4 * LENGTH**2]])
    squares = scipy.linalg.eigvals(stiffness, np.diag([2.0, 0.012 - 0.02])).real
    critical = np.sqrt(np.max(squares))

    @jax.jit
    def stiffness_at(speed):
        spin = jnp.stack([speed, 0.0, 0.0])

        def lagrangian(bent):
            q = clamped(body, bent)
            tip = jnp.concatenate(marker(body, q, (LENGTH / 2, 0.0, 0.0)))
            total = -body.elastic_energy(q)
            for part, own in ((body, q), (disc, tip)):
                v = turning(own, jnp.zeros_like(own), spin)
                total += 0.5 * v @ part.mass_matrix(own) @ v
            return total

        return jnp.linalg.eigvalsh(-jax.hessian(lagrangian)(jnp.zeros(4)))[0]

    found = scipy.optimize.brentq(stiffness_at, 0.5 * critical, 1.5 * critical, rtol=SOLVED)
    assert_close(found, critical, DIFFERENCED, critical)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"EI": None}, "'beam': bending modes need EI"),
        ({"torsion": 1}, "'beam': torsion modes need GJ"),
        ({"bending": (1, -2)}, "no numbers of modes"),
        ({"bending": 0, "stiffening": True}, "stiffening is for beams that bend"),
        ({"inertia": (POLAR, 0.01, 0.01)}, "less than that of a thin bar"),
        ({"inertia": (POLAR, 1.0, 2.0)}, "largest must not exceed"),
        ({"damping": (0.1, 0.2)}, r"damping has shape \(2,\)"),
        ({"EI": -1.0}, "EI is .*must be positive"),
        ({"points": {"end": (0, 0, 0)}}, "a point is named 'end'"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_impossible_beams_are_refused(change, words):
    with pytest.raises(rj.SceneError, match=words):
        beam(**change)


def test_fewer_modes_and_capped_ones():
    """With all modes a local basis changes nothing; a cap adds a constant mass to fast ones."""
    body = beam(bending=2, GJ=1.0, torsion=1, stiffening=True)
    q, v = 0.1 * jax.random.normal(jax.random.key(0), (2, body.size))
    q = q.at[3].add(1.0)
    hertz = body.natural_frequencies()[1] / (2 * jnp.pi)
    capped = CappedBody(body, hertz)
    kept = jnp.eye(5)[:, np.array([0, 3])]
    expand = jnp.zeros((9, 12)).at[np.arange(9), np.array([*range(7), 7, 10])].set(1.0)

    @jax.jit
    def of(q, v):
        few, z, w = ReducedBody(body, kept), expand @ q, expand @ v
        return (
            (body.mass_matrix(q), body.quadratic_velocity_force(q, v)),
            (capped.mass_matrix(q), capped.quadratic_velocity_force(q, v)),
            (few.mass_matrix(z), few.quadratic_velocity_force(z, w), few.inverse_mass(z)),
            (
                body.mass_matrix(expand.T @ z),
                body.quadratic_velocity_force(expand.T @ z, expand.T @ w),
            ),
        )

    (mass, force), (heavy, same), (small, pulled, inverse), (wide, whole) = of(q, v)
    ratio = np.asarray(body.natural_frequencies() / body.natural_frequencies()[1]) ** 2
    added = np.diag(np.concatenate([np.zeros(7), np.maximum(ratio - 1, 0)]))
    assert_close(heavy - mass, added, IDENTITY, np.max(np.abs(heavy)))
    assert_close(same, force, 0.0)
    assert_close(small, expand @ wide @ expand.T, IDENTITY, np.max(np.abs(small)))
    assert_close(pulled, expand @ whole, IDENTITY, np.max(np.abs(whole)))
    assert_close(inverse @ small, np.eye(9), 100 * IDENTITY)
    assert np.all(capped.natural_frequencies() <= 2 * np.pi * hertz * (1 + IDENTITY))


def arm(effects=()):
    """Two stiffened beams on hinges that are not parallel."""
    size = {"bending": 2, "GJ": 1.0, "torsion": 1, "stiffening": True}
    first, second = (
        dataclasses.replace(beam(**size, position=(x, 0.0, 0.0)), name=name)
        for name, x in (("first", LENGTH / 2), ("second", 1.5 * LENGTH))
    )
    up, aslant = (0.0, 1.0, 0.0), (0.0, 1.0, 1.0)
    joints = [
        spatial.Revolute(first.at("start", axis=up), rj.ground.at((0.0, 0.0, 0.0), axis=up)),
        spatial.Revolute(second.at("start", axis=aslant), first.at("end", axis=aslant)),
    ]
    return rj.assemble(rj.Scene([first, second], joints, effects))


@pytest.mark.slow
def test_an_arm_that_falls_keeps_its_energy():
    system = arm([rj.Gravity((0.0, 0.0, -9.81))])
    run = rj.simulate(system, np.linspace(0.0, 0.2, 5), rtol=1e-10, atol=1e-12)
    energy = rj.energy(system, run)
    assert_close(energy.balance, np.zeros(5), SOLVED, np.max(energy.kinetic))
    assert np.max(energy.elastic) > 1e-3 * np.max(energy.kinetic)


def test_jacobian_of_stiffened_beams():
    """Joints see bending, turns of sections and foreshortening: C_q is the derivative of C."""
    system = arm()
    q = system.q0 + 0.1 * jax.random.normal(jax.random.key(1), (system.n,))

    @jax.jit
    def both(q):
        return dynamics.jacobian(system, 0.0, q), jax.jacfwd(system.constraint, 1)(0.0, q)

    found, wanted = both(q)
    assert np.max(np.abs(system.constraint(0.0, system.q0))) <= IDENTITY
    assert_close(found, wanted, 10 * IDENTITY, np.max(np.abs(wanted)))


@pytest.mark.parametrize(
    ("section", "turned"),
    [
        (rj.sections.Rectangle(0.02, 0.03), rj.sections.Rectangle(0.03, 0.02)),
        (rj.sections.Box(0.02, 0.03, 0.002), rj.sections.Box(0.03, 0.02, 0.002)),
        (rj.sections.Rod(0.02), rj.sections.Rod(0.02)),
        (rj.sections.Tube(0.02, 0.003), rj.sections.Tube(0.02, 0.003)),
    ],
    ids=lambda value: type(value).__name__,
)
def test_sections_that_are_turned(section, turned):
    """A quarter turn swaps the second moments and leaves torsion as it is."""
    assert_close(section.second_moment_y, turned.second_moment, IDENTITY, turned.second_moment)
    assert_close(
        section.torsion_constant, turned.torsion_constant, IDENTITY, turned.torsion_constant
    )


def test_torsion_constants():
    """Of a square 0.1406 a⁴ (Timoshenko and Goodier, section 109), of a strip b t³ / 3 less
    0.21 t⁴; of a thin ring what Bredt says; of an I two flanges and a web.
    """
    assert_close(rj.sections.Rectangle(1.0, 1.0).torsion_constant, 0.140577, 1e-6)
    strip = rj.sections.Rectangle(20.0, 1.0).torsion_constant
    assert_close(strip, (20 - 0.63025) / 3, 1e-5, strip)
    ring = rj.sections.Tube(1.0, 1e-4).torsion_constant
    assert_close(ring, np.pi * 1e-4 / 4, 1e-3, ring)
    profile = rj.sections.IProfile(0.02, 0.03, flange=0.004, web=0.003)
    assert_close(profile.torsion_constant, (0.04 * 0.004**3 + 0.022 * 0.003**3) / 3, IDENTITY)
    own = (2 * 0.004 * 0.02**3 + 0.022 * 0.003**3) / 12
    assert_close(profile.second_moment_y, own, IDENTITY)


def test_a_section_by_its_numbers():
    section = rj.sections.Section(A=2e-4, I_y=3e-9, I_z=4e-9, J=1e-9)
    material = {"density": 7800.0, "modulus": 2e11}
    body = spatial.Beam.of_section(
        "beam", 0.5, section, **material, shear_modulus=8e10, bending=1, torsion=1, extension=1
    )
    assert_close(body.EI, [600.0, 800.0], IDENTITY, 800.0)
    assert_close(body.GJ, 80.0, IDENTITY, 80.0)
    assert_close(body.EA, 4e7, IDENTITY, 4e7)
    thin = 7800 * 0.5 * (2e-4 * 0.5**2 / 12 + np.array([3e-9, 4e-9]))
    assert_close(body.inertia, [7800 * 0.5 * 7e-9, *thin], IDENTITY, thin[0])
    with pytest.raises(rj.SceneError, match="torsion needs the shear_modulus"):
        spatial.Beam.of_section("beam", 0.5, section, **material, torsion=1)


def test_a_section_of_the_plane_is_refused():
    class Own(rj.sections.AbstractSection):
        area = second_moment = 1.0

    with pytest.raises(rj.SceneError, match="'Own' has no second_moment_y; beams in space need it"):
        spatial.Beam.of_section("beam", 0.5, Own(), density=1.0, modulus=1.0)


# The Princeton beam (Dowell and Traybar 1975): aluminium, on edge, with a load at its tip.
PRINCETON = {"modulus": 71.7e9, "shear_modulus": 71.7e9 / 2.62, "density": 2700.0}
SPAN, EDGE = 0.508, rj.sections.Rectangle(3.175e-3, 12.7e-3)


def geometrically_exact(force):
    """Displacement of the tip and rotation about the axis of a clamped Kirchhoff rod, by shooting
    for its root moment: r' = d, R' = R κ̃, m' = −d × F, R diag(GJ, EI_y, EI_z) κ = m.
    """
    shear, modulus = PRINCETON["shear_modulus"], PRINCETON["modulus"]
    stiffness = np.array(
        [
            shear * EDGE.torsion_constant,
            modulus * EDGE.second_moment_y,
            modulus * EDGE.second_moment,
        ]
    )

    def slope(_, y):
        turn, moment = y[3:12].reshape(3, 3), y[12:]
        x, y, z = (turn.T @ moment) / stiffness
        curved = turn @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.concatenate([turn[:, 0], curved.ravel(), -np.cross(turn[:, 0], force)])

    def tip(root):
        start = np.concatenate([np.zeros(3), np.eye(3).ravel(), root])
        run = scipy.integrate.solve_ivp(slope, (0, SPAN), start, "DOP853", rtol=1e-11, atol=1e-13)
        return run.y[:, -1]

    lever = np.array([0.0, -force[2], force[1]]) * SPAN
    end = tip(scipy.optimize.fsolve(lambda root: tip(root)[12:], 0.97 * lever, xtol=1e-11))
    turn = end[3:12].reshape(3, 3)
    about = 2 * np.arctan2(turn[2, 1] - turn[1, 2], 1 + np.trace(turn))
    return np.array([end[0] - SPAN, end[1], end[2], about])


def princeton(count, force):
    """The same by so many beams that are welded end to end, in equilibrium by Newton's method."""
    size = SPAN / count
    bodies = [
        spatial.Beam.of_section(
            f"beam {k}",
            size,
            EDGE,
            **PRINCETON,
            bending=2,
            torsion=1,
            stiffening=True,
            position=((k + 0.5) * size, 0.0, 0.0),
        )
        for k in range(count)
    ]
    ends = [rj.ground.at((0.0, 0.0, 0.0)), *(body.at("end") for body in bodies)]
    joints = [spatial.Weld(b.at("start"), end) for b, end in zip(bodies, ends[:-1], strict=True)]
    system = rj.assemble(rj.Scene(bodies, joints))
    n, m, each = system.n, system.m, bodies[0].size
    turns = np.arange(count)[:, None] * each + np.arange(3, 7)

    def residual(x, force):
        q, multipliers, lengths = x[:n], x[n : n + m], x[n + m :]
        pull = jax.grad(lambda q: force @ marker(bodies[-1], q[-each:], (size / 2, 0.0, 0.0))[0])(q)
        pull += system.force(0.0, q, jnp.zeros(n))
        p = q[turns]  # whose lengths no force holds
        pull -= jnp.zeros(n).at[turns].set(p * lengths[:, None])
        forces = pull - dynamics.jacobian(system, 0.0, q).T @ multipliers
        return jnp.concatenate([forces, system.constraint(0.0, q), jnp.sum(p * p, axis=1) - 1])

    @jax.jit
    def improve(x, force):
        return x - jnp.linalg.solve(jax.jacfwd(residual)(x, force), residual(x, force))

    x = jnp.concatenate([system.q0, jnp.zeros(m + count)])
    for share in (0.25, 0.5, 0.75, 1.0):
        for _ in range(6):
            x = improve(x, share * force)
    place, turn = marker(bodies[-1], x[n - each : n], (size / 2, 0.0, 0.0))
    return np.array([*(place - np.array([SPAN, 0, 0])), 2 * np.arctan2(turn[1], turn[0])])


@pytest.mark.slow
def test_princeton_beam():
    """Two pounds at 45°: 4 and 8 beams converge to the geometrically exact rod at order 2, and 8
    are within a share of it that no measurement saw.
    """
    force = 2 * 4.448222 * np.array([0.0, 1.0, 1.0]) / np.sqrt(2)
    exact = geometrically_exact(force)
    errors = [np.abs(princeton(count, jnp.asarray(force)) - exact) for count in (4, 8)]
    orders = np.log2(errors[0] / errors[1])
    assert_close(orders, np.full(4, 2.0), 0.1)
    assert_close(errors[1], np.zeros(4), 0.005, np.abs(exact))
