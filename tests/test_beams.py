"""Beams: mode shapes, cross-sections, damping, geometric stiffening, large bending by chains."""

import functools

import jax
import jax.numpy as jnp
import meshes
import numpy as np
import pytest
import scipy.linalg
import zoo
from programs import kept
from tolerances import IDENTITY, SOLVED
from verification_problems.turning import stiffened

import romjax as rj
from romjax.scene.body.modes import bending_moments, bending_shapes
from romjax.system import dynamics

LENGTH, MASS, EI = 1.3, 0.7, 3.0
# Of frequencies by eight modes, against a basis of polynomials.
CONVERGED = 1e-3
# Of differences of accelerations by amplitudes.
STEP = 1e-3
# Of a chain's tip: order 2 in the number of beams, and how far it may be from that.
ORDER, SPREAD = 2, 0.1
# Of what two chains promise for endless ones: the next power of their number is left.
EXTRAPOLATED = 2e-5
# Of an integral over a section by the midpoint rule, of 6e5 strips.
INTEGRATED = 1e-6
SHAPES = ("static", "free-free", "clamped-free", "pinned-free")


def beam(**settings):
    settings = {"EI": EI, "modes": 3, "shapes": "clamped-free", **settings}
    return rj.Beam("beam", MASS, LENGTH, position=(LENGTH / 2, 0.0), **settings)


@pytest.mark.instant
@pytest.mark.parametrize("shapes", SHAPES)
def test_shapes_meet_their_ends(shapes):
    """∫w_k w_l dξ = δ_kl, w as its support wants it, the other end free."""
    count = 5
    nodes, weights = np.polynomial.legendre.leggauss(80)
    place, weights = (nodes + 1) / 2, weights / 2
    deflection, _ = bending_shapes(shapes, count, place[:, None], np)
    gram = deflection.T @ (weights[:, None] * deflection)
    assert np.allclose(gram, np.eye(count), rtol=0, atol=IDENTITY)
    wanted = np.stack([weights @ deflection, (weights * (place - 0.5)) @ deflection])
    assert np.allclose(bending_moments(shapes, count), wanted, rtol=0, atol=IDENTITY)
    low, slope = bending_shapes(shapes, count, 0.0, np)
    if shapes in SHAPES[2:]:
        assert np.max(np.abs(low)) <= IDENTITY
        assert np.allclose(bending_shapes(shapes, count, 1.0, np)[0], 2.0, rtol=IDENTITY)
    if shapes == "clamped-free":
        assert np.max(np.abs(slope)) <= IDENTITY * 100  # slopes are of order b


@pytest.mark.parametrize("shapes", ["static", "clamped-free", "pinned-free"])
def test_shapes_of_one_support_span_those_of_another(shapes):
    """A hinged beam has one lowest frequency, whatever its modes: the more, the better."""

    def lowest(shapes, modes):
        body = beam(shapes=shapes, modes=modes)
        hinge = rj.Revolute(body.at((-LENGTH / 2, 0.0)), rj.ground.at())
        system = rj.assemble(rj.Scene([body], [hinge]))

        @jax.jit
        def of(q):
            return system.mass(q), dynamics.jacobian(system, 0.0, q), body.natural_frequencies()

        mass, rows, frequencies = map(np.asarray, of(system.q0))
        free = scipy.linalg.null_space(rows)
        stiffness = np.diag([0.0, 0.0, 0.0, *frequencies**2])
        squares = scipy.linalg.eigvalsh(free.T @ stiffness @ free, free.T @ mass @ free)
        return np.sqrt(squares[squares > 1.0][0])

    root = 3.9266023120479187782
    exact = root**2 * np.sqrt(EI / (MASS * LENGTH**3))
    few, many = (lowest(shapes, modes) / exact - 1 for modes in (2, 8))
    assert few >= many - SOLVED
    assert abs(many) <= (SOLVED if shapes == "pinned-free" else 10 * CONVERGED)


@kept
def clamped(tension, speed, stiffening):
    """Of a beam clamped to a turning axis and pulled at its tip: ∂a/∂q of its eight modes, in the
    units of `stiffened`, by differences of order four.
    """
    unit = jnp.sqrt(EI / (MASS * LENGTH**3))
    turning = speed * unit
    body = beam(
        modes=8,
        stiffening=stiffening,
        velocity=jnp.stack([0.0, turning * LENGTH / 2]),
        angular_velocity=turning,
    )
    end, tip = body.at((-LENGTH / 2, 0.0)), body.at((LENGTH / 2, 0.0))
    joints = [
        rj.Revolute(end, rj.ground.at()),
        rj.PrescribedAngle(end, rj.ground.at(), rj.Ramp(turning)),
    ]
    pull = rj.Force(tip, (1.0, 0.0), rj.Constant(tension * EI / LENGTH**2))
    system = rj.assemble(rj.Scene([body], joints, [pull]))
    moved = STEP * jnp.eye(8, system.n, 3)
    steps = jnp.stack([2 * moved, moved, -moved, -2 * moved]) + system.q0[None, None]
    accelerate = jax.vmap(jax.vmap(lambda q: system.acceleration(0.0, q, system.v0)[0]))
    far, near, before, farther = accelerate(steps)[..., 3:]
    return (8 * (near - before) - (far - farther)).T / (12 * STEP * unit**2)


@pytest.mark.parametrize(
    ("tension", "speed"), [(0.0, 0.0), (0.0, 1.0), (0.0, 6.0), (5.0, 0.0), (-1.0, 0.0), (2.0, 3.0)]
)
def test_geometric_stiffening(tension, speed):
    """Its frequency in the plane. Without stiffening that falls as √(ω² − Ω²), and tension has no
    effect.
    """

    def lowest(stiffening):
        found = clamped(np.asarray(tension), np.asarray(speed), stiffening)
        return np.min(-np.linalg.eigvals(np.asarray(found)).real)

    assert abs(np.sqrt(lowest(True)) / stiffened(tension, speed) - 1) <= CONVERGED
    still = stiffened(0.0, 0.0) ** 2
    assert abs(lowest(False) - (still - speed**2)) <= SOLVED * (still + speed**2)


def test_jacobian_of_a_stiffened_beam():
    """The joints see the motion of second order: C_q is the derivative of C."""
    body = beam(stiffening=True)
    other = rj.RigidBody("other", 1.0, 0.1, position=(LENGTH, 0.0))
    joints = [
        rj.Weld(body.at((-LENGTH / 2, 0.0)), rj.ground.at()),
        rj.Revolute(other.at(), body.at((LENGTH / 2, 0.0))),
    ]
    system = rj.assemble(rj.Scene([body, other], joints))
    nodes, weights = np.polynomial.legendre.leggauss(40)
    points = np.stack([LENGTH / 2 * nodes, np.zeros(40)], axis=1)

    @jax.jit
    def everything(q):
        slopes = jax.vmap(body.mode_shapes)(points)[:, 2] @ q[3:6]
        tip = body.mode_shapes(jnp.array([LENGTH / 2, 0.0])) @ q[3:6]
        wanted = jax.jacfwd(system.constraint, argnums=1)(0.0, q)
        places = system.joint_markers.poses(q).position
        return dynamics.jacobian(system, 0.0, q), wanted, places, slopes, tip

    q = 0.1 * np.random.default_rng(0).normal(size=system.n)
    rows, wanted, places, slopes, tip = map(np.asarray, everything(q))
    assert np.allclose(rows, wanted, rtol=0, atol=IDENTITY)
    # The tip comes nearer by ½ ∫w'² ds, here by a quadrature of the slopes.
    along = LENGTH / 2 - 0.5 * (LENGTH / 2 * weights) @ slopes**2
    c, s = np.cos(q[2]), np.sin(q[2])
    wanted = q[:2] + np.array([c * along - s * tip[1], s * along + c * tip[1]])
    assert np.min(np.linalg.norm(places - wanted[None], axis=1)) <= IDENTITY


@pytest.mark.parametrize("damping", [0.05, (0.01, 0.02, 0.03)])
def test_modal_damping(damping):
    """A free beam's modes decay by themselves: q = q₀ e^{−ζωt} (cos ω_d t + ζω/ω_d sin ω_d t)."""
    start = np.array([0.01, -0.02, 0.03])
    body = beam(shapes="free-free", damping=damping, amplitudes=start)
    ts = np.linspace(0.0, 0.2, 11)
    run = zoo.run(rj.assemble(rj.Scene([body])), ts, rtol=1e-11)
    ratio, w = np.broadcast_to(damping, 3), np.asarray(body.natural_frequencies())
    turning = w * np.sqrt(1 - ratio**2)
    decay = np.exp(-np.outer(ts, ratio * w))
    phase = np.outer(ts, turning)
    wanted = start * decay * (np.cos(phase) + ratio * w / turning * np.sin(phase))
    assert np.allclose(run.q[:, 3:], wanted, rtol=0, atol=SOLVED)


@pytest.mark.parametrize(
    ("section", "half", "width"),
    [
        (rj.sections.Rectangle(0.02, 0.03), 0.015, lambda y: np.full_like(y, 0.02)),
        (rj.sections.Rod(0.03), 0.015, lambda y: 2 * np.sqrt(0.015**2 - y**2)),
        (
            rj.sections.Tube(0.03, 0.004),
            0.015,
            lambda y: 2 * np.sqrt(0.015**2 - y**2) - 2 * np.sqrt(np.maximum(0.011**2 - y**2, 0)),
        ),
        (
            rj.sections.Box(0.02, 0.03, 0.002),
            0.015,
            lambda y: np.where(abs(y) > 0.013, 0.02, 0.004),
        ),
        (
            rj.sections.IProfile(0.02, 0.03, flange=0.004, web=0.003),
            0.015,
            lambda y: np.where(abs(y) > 0.011, 0.02, 0.003),
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_sections(section, half, width):
    """A = ∫b dy and I = ∫b y² dy of the width b(y)."""
    count = 600_000
    y = half * (2 * (np.arange(count) + 0.5) / count - 1)
    step = 2 * half / count
    assert np.isclose(section.area, step * np.sum(width(y)), rtol=INTEGRATED, atol=0)
    assert np.isclose(section.second_moment, step * np.sum(width(y) * y**2), rtol=INTEGRATED)
    body = rj.Beam.of_section("beam", 0.5, section, density=7800.0, modulus=2e11, modes=2)
    assert np.isclose(body.mass, 7800 * 0.5 * section.area, rtol=IDENTITY)
    rotary = 7800 * section.second_moment * 0.5
    assert np.isclose(body.inertia, body.mass * 0.5**2 / 12 + rotary, rtol=IDENTITY)


@functools.cache
def tips(count):
    """Tip of `count` beams, clamped end to end, under dead loads across; length and EI are 1.

    Each is one finite element, whose static modes represent its end loads exactly. In equilibrium
    Q = C_qᵀ λ and C = 0, by Newton's method in steps of the load.
    """
    size = 1 / count
    stiffness, mass, nodes = meshes.beam(1, size, 1.0, EA=1e6, EI=1.0)
    bodies = [
        rj.ModalBody.of_mesh(
            f"beam {i}",
            stiffness,
            mass,
            nodes,
            {"start": 0, "end": 1},
            modes=0,
            position=((i + 0.5) * size, 0.0),
        )
        for i in range(count)
    ]
    ends = [rj.ground.at(), *(body.at("end") for body in bodies)]
    joints = [rj.Weld(body.at("start"), end) for body, end in zip(bodies, ends[:-1], strict=True)]
    across = rj.Force(ends[-1], (0.0, 1.0), rj.Ramp(1.0))  # the load is the time
    system = rj.assemble(rj.Scene(bodies, joints, [across]))
    n, still = system.n, jnp.zeros(system.n)

    @jax.jit
    def improve(force, x):
        def residual(x):
            reaction = dynamics.jacobian(system, 0.0, x[:n]).T @ x[n:]
            pull = system.force(force, x[:n], still) - reaction
            return jnp.concatenate([pull, system.constraint(0.0, x[:n])])

        return x - jnp.linalg.solve(jax.jacfwd(residual)(x), residual(x))

    last, x, found = bodies[-1], np.concatenate([system.q0, np.zeros(system.m)]), {}
    shape, middle = np.asarray(last.mode_shapes(last.points[1])), np.asarray(last.points[1])
    for force in np.linspace(0, 10, 21)[1:]:
        for _ in range(8):
            x, before = np.asarray(improve(force, x)), x
            if np.max(np.abs(x - before)) <= IDENTITY * np.max(np.abs(x)):
                break
        end, frame = shape @ x[n - 3 : n], x[n - 6 : n - 3]
        arm = middle + end[:2]
        c, s = np.cos(frame[2]), np.sin(frame[2])
        place = frame[:2] + np.array([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])
        found[force] = np.array([place[1], 1 - place[0], frame[2] + end[2]])
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("load", "wanted"),
    [
        (2, [0.49345748, 0.16064172, 0.78174983]),
        (10, [0.81060902, 0.55499560, 1.43028554]),
    ],
)
def test_elastica(load, wanted):
    """Deflection, shortening and rotation of the tip at P L² / EI (Mattiasson 1981), by 4, 8 and
    16 beams: each halving quarters the error, and extrapolated they meet the digits.
    """
    found = np.array([tips(count)[load] for count in (4, 8, 16)])
    errors = np.linalg.norm(found - np.array(wanted), axis=1)
    orders = np.log2(errors[:-1] / errors[1:])
    assert abs(orders[-1] - ORDER) <= SPREAD, orders
    limit = (4 * found[-1] - found[-2]) / 3
    assert np.allclose(limit, wanted, rtol=0, atol=EXTRAPOLATED)
