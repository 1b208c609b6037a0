"""Beams in space: modes, sections, rotating blades, shafts that spin, against closed forms."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
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


@pytest.fixture(scope="module")
def arm():
    """A robot arm of two stiffened beams on hinges, which falls."""
    size = {"EI": 2.0, "bending": 3, "GJ": 1.0, "torsion": 1, "stiffening": True}
    first, second = (
        spatial.Beam(
            name, 0.5, 1.0, (1e-3, 0.06, 0.06), position=(x, 0.0, 0.0), damping=0.01, **size
        )
        for name, x in (("first", 0.5), ("second", 1.5))
    )
    joints = [
        spatial.Revolute(
            first.at("start", axis=(0, 1, 0)), rj.ground.at((0, 0, 0), axis=(0, 1, 0))
        ),
        spatial.Revolute(second.at("start", axis=(0, 1, 1)), first.at("end", axis=(0, 1, 1))),
    ]
    return rj.Scene([first, second], joints, [rj.Gravity((0.0, 0.0, -9.81))])


def test_fewer_modes_and_capped_ones(arm):
    """With all modes a local basis changes nothing; neither does a cap above all frequencies."""
    q, v = 0.05 * jax.random.normal(jax.random.key(0), (2, 28))
    scenes = [
        rj.Scene([change(body) for body in arm.bodies], arm.joints, arm.effects)
        for change in (
            lambda body: body,
            lambda body: CappedBody(body, 1e6),
            lambda body: ReducedBody(body, jnp.eye(7)),
        )
    ]
    systems = [rj.assemble(scene) for scene in scenes]
    q, v = systems[0].q0 + q, systems[0].v0 + v
    wanted, *others = (jax.jit(system.acceleration)(0.0, q, v)[0] for system in systems)
    for other in others:
        assert_close(other, wanted, SOLVED, np.max(np.abs(wanted)))
