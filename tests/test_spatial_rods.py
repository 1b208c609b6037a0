"""Rods in space that bend and twist far: statics, the mechanics of one rod, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from comparison import assert_close
from groups import in_groups
from jaxtyping import Array, Float
from motions import through
from numpy.polynomial import legendre as polynomials
from programs import kept
from scipy.optimize import brentq
from test_rods import ALIKE
from tolerances import IDENTITY, SOLVED

import romjax as rj
from romjax import spatial as r
from romjax.compiling import jaxprs
from romjax.events.passage import Passage
from romjax.linalg import quaternions
from romjax.scene.body.strains import legendre
from romjax.scene.fields import number
from romjax.system import dynamics

# Kinds of rods: (options).
KINDS = {
    "elastic": {"EA": 20.0, "GA": (30.0, 20.0), "curvature": (0.3, 0.5, 1.0)},
    "natural": {
        "EA": 20.0,
        "shapes": "hinged-free",
        "curvature": [[0.3, 0.1], [0.2, 0.2], [0.5, 1.0]],
        "coupling": 0.3 * (np.eye(4)[[1, 0, 3, 2]]),
    },
}
ORIGIN = rj.ground.pose((0.0, 0.0, 0.0))
# Any rotation: by one radian.
TURN = r.rotation((1.0, 2.0, -3.0), 1.0)


def rod(modes=7, **options) -> r.Rod:
    return r.Rod("rod", 0.7, 1.3, (2.0, 1.5), 1.0, (0.02, 0.01, 0.015), modes, **options)


def tip(length, stiffness, curvature, force, torque, axis) -> tuple[np.ndarray, ...]:
    """Where the end of a rod is by the axes of its start, which is clamped to the ground, how it
    has moved, and how it is turned: in one call from the undeformed rod.
    """
    EI, EA, GA = stiffness
    options = {"EA": EA, "GA": GA, "curvature": np.outer([0.0, 0.0, 1.0], curvature)}
    blade = r.Rod("blade", length, length, EI, EI, (2.0, 1.0, 1.0), 48, **options)
    first = blade.placed("start", ORIGIN)
    axes = np.asarray(first.pose("start").rotation)
    clamp = rj.ground.at((0.0, 0.0, 0.0), rotation=axes)
    loads = [
        rj.Force(first.at("end"), (0.0, 0.0, 1.0), rj.Constant(force)),
        r.Torque(first.at("end"), axis, rj.Constant(torque)),
    ]
    system = rj.assemble(rj.Scene([first], [r.Weld(first.at("start"), clamp)], loads))
    q = rj.equilibrium(system)
    end = first.started(q, np.zeros_like(q)).pose("end")
    moved = np.asarray(end.position) - np.asarray(first.pose("end").position)
    return axes.T @ np.asarray(end.position), axes.T @ moved, axes.T @ np.asarray(end.rotation)


# Statics, by one program for all.


@pytest.mark.slow
def test_rods_roll_up_and_bend_out_of_their_plane():
    """A torque rolls a straight one up about either axis. Bathe and Bolourchi's 45 degrees of a
    circle (1979, doi:10.1002/nme.1620140703) under a load across, to the digits of another code.
    """
    for axis in np.eye(3)[1:]:
        place, _, turned = tip(1.0, (1.0, 20.0, 30.0), 0.0, 0.0, 2 * np.pi, axis)
        assert_close(place, np.zeros(3), IDENTITY)
        assert_close(turned, np.eye(3), 10 * IDENTITY)
    stiffness, exact = (8.333e5, 1e7, 41.6667e5), (-13.6050230096, 53.4761081403, -23.5612967857)
    _, moved, _ = tip(25 * np.pi, stiffness, 0.01, 600.0, 0.0, np.eye(3)[0])
    along, radial, aside = moved
    assert_close(np.array([radial, aside, along]), exact, 1e-7)


@pytest.mark.exhaustive
def test_a_parabola_bends_out_of_its_plane():
    """What some codes take for 45 degrees of a circle (Wang, Sprague, Jonkman, Johnson and Jonkman
    2017, Wind Energy 20, 1439–1462): x and y = a x + b x², by the arc length, to their digits.
    """
    x, y = np.array([(38.2683, -7.61205), (70.7107, -29.2893)]).T
    a, b = np.linalg.solve(np.stack([x, x**2], axis=1), y)
    nodes, weights = polynomials.leggauss(40)

    def arc(x):
        return x / 2 * weights @ np.sqrt(1 + (a + b * x * (nodes + 1)) ** 2)

    length = arc(x[1])
    at = [brentq(lambda x, s=s: arc(x) - s * length, 0, x[1], xtol=1e-13) for s in (nodes + 1) / 2]
    bent = 2 * b / (1 + (a + 2 * b * np.array(at)) ** 2) ** 1.5
    curvature = polynomials.legfit(nodes, bent, 11)
    _, moved, _ = tip(length, (8.333e5, 1e7, 41.6667e5), curvature, 600.0, 0.0, np.eye(3)[0])
    c, s = 1 / np.hypot(1, a), a / np.hypot(1, a)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ moved
    exact = np.array([-23.6459716009, 13.7208006040, 53.5776450627])
    assert_close(turned, exact, 1e-7)


# Sections by forces along, then torques about x, y and z.
COMPOSITE = np.diag([1368.17e3, 88.56e3, 38.78e3, 16.96e3, 59.12e3, 141.47e3])
COMPOSITE[3:, 3:] += [[0, 17.61e3, -351.0], [17.61e3, 0, -370.0], [-351.0, -370.0, 0]]
ISOTROPIC = np.diag([2.5e10, 8.2604167e9, 8.2604167e9, 1.41872656e8, 5.20833e8, 1.30208333e8])


@pytest.mark.slow
def test_coupled_and_twisted_sections_under_a_load_at_the_tip():
    """A composite beam, and one that is twisted by a right angle (Wang, Sprague, Jonkman, Johnson
    and Jonkman 2017, Wind Energy 20, 1439–1462), to the digits of two codes.
    """
    composite = -0.0902726627566, -0.0647488486259, 1.22973648292371
    twisted = -1.14152599954, -1.71805334647, -3.59321324027
    for matrix, twist, load, exact in (
        (COMPOSITE, 0.0, 150.0, composite),
        (ISOTROPIC, np.pi / 20, -4e6, twisted),
    ):
        beam = r.Rod.of_stiffness(
            "beam", 1.0, 10.0, matrix, (0.02, 0.01, 0.01), 60, nodes=24, curvature=(twist, 0.0, 0.0)
        )
        assert_close(np.asarray(_deflection(beam, jnp.asarray(load))), exact, 1e-8)


@kept
def _deflection(beam, load):
    """How the end moves against the start, by the axes there, for a force along its z."""
    start, end = (beam.prepare(jnp.array([s * 5.0, 0.0, 0.0])) for s in (-1, 1))

    def place(a):
        origin, turn = beam.local_pose(start, a)
        arm = beam.local_pose(end, a)[0] - origin
        return quaternions.rotate(quaternions.conjugate(turn), arm)

    def potential(a, share):
        energy = beam.elastic_energy(jnp.concatenate([jnp.zeros(7), a]))
        return energy - share * load * place(a)[2]

    def step(a, share):
        slope, stiffness = jax.grad(potential)(a, share), jax.hessian(potential)(a, share)
        return a - jnp.linalg.solve(stiffness, slope), None

    none = jnp.zeros(beam.modes)
    shares = jnp.concatenate([jnp.linspace(0.1, 1.0, 10), jnp.ones(6)])
    return place(jax.lax.scan(step, none, shares)[0]) - place(none)


# The mechanics of one rod.


@pytest.mark.parametrize("kind", in_groups(KINDS, fast=["elastic"], slow=["natural"]))
def test_closed_forms_are_those_of_autodiff(kind):
    one, rng = rod(**KINDS[kind]), np.random.default_rng(0)
    q, v = jnp.asarray(rng.normal(size=(2, 14)))
    force, of_mass, slopes, of_pose, moment, of_moment = _both(one, q, v)
    assert_close(force, of_mass, ALIKE, np.max(np.abs(force)))
    assert_close(slopes, of_pose, ALIKE, np.max(np.abs(slopes)))
    assert_close(moment, of_moment, ALIKE, np.max(np.abs(moment)))


@kept
def _both(one, q, v):
    """The quadratic velocity force, a marker's gradient and that of the first moment, by the rod
    and by autodiff.
    """
    point, amplitudes = one.prepare(jnp.array([0.3, 0.1, -0.05])), q[7:]
    position, turn = jax.jacfwd(lambda a: one.local_pose(point, a))(amplitudes)
    spin = 2 * quaternions.space_matrix(one.local_pose(point, amplitudes)[1]) @ turn
    return (
        one.quadratic_velocity_force(q, v),
        dynamics.quadratic_velocity_force(one.mass_matrix)(q, v),
        one.local_gradient(point, amplitudes),
        jnp.concatenate([position, spin]),
        one.first_moment_slope(q),
        jax.jacfwd(one.first_moment)(q),
    )


def with_strains(one, strains) -> r.Rod | rj.Rod:
    """The rod whose Legendre coefficients of all strains are those given."""
    basis = np.asarray(one.strains.basis).reshape(-1, one.modes)
    amplitudes = np.linalg.lstsq(basis, strains.reshape(-1), rcond=None)[0]
    q = np.concatenate([np.asarray(one.start()[0])[: one.frame_size], amplitudes])
    return one.started(q, np.zeros_like(q))


def test_a_rod_that_bends_in_a_plane_is_the_planar_one():
    """In any plane of space, with stretch and shear."""
    strains = np.random.default_rng(1).normal(size=(3, 4))
    options = {"EA": 20.0, "GA": 30.0, "nodes": 16}
    flat = rj.Rod("rod", 0.7, 1.3, 1.5, 12, rotary=0.01, curvature=(0.5, 1.0), **options)
    curvature = [[0.0, 0.0], [0.0, 0.0], [0.5, 1.0]]
    space = rod(24, curvature=curvature, orientation=TURN, **options)
    in_space = np.zeros((6, 4))
    in_space[[2, 3, 4]] = strains
    flat, space = with_strains(flat, strains), with_strains(space, in_space)
    inside = quaternions.matrix(np.asarray(TURN)).T
    for s in (-0.65, -0.2, 0.5):
        planar, pose = flat.pose((s, 0.1)), space.pose((s, 0.1, 0.0))
        assert_close(inside @ np.asarray(pose.position), [*np.asarray(planar.position), 0], ALIKE)
        x, y, z = (inside @ quaternions.matrix(np.asarray(pose.turn))).T
        assert_close(z, [0.0, 0.0, 1.0], ALIKE)
        angle = np.asarray(planar.angle)
        assert_close(x, [np.cos(angle), np.sin(angle), 0.0], ALIKE)
        assert_close(y, [-np.sin(angle), np.cos(angle), 0.0], ALIKE)


class Pulse(rj.AbstractSignal):
    """size · sin²(π t / 2.5) until 2.5 s."""

    size: Float[Array, ""] = number()

    def __call__(self, t):
        return jnp.where(t < 2.5, self.size * jnp.sin(jnp.pi * t / 2.5) ** 2, 0.0)


@pytest.mark.exhaustive
def test_a_beam_that_flies_in_a_plane_is_the_planar_one():
    """Turned by one radian: positions, momentum, energy, and the forces inside."""
    ts, light = np.array([0.0, 2.5, 3.5, 4.5]), (20.0, 10.0, 10.0)
    flat = rj.Rod("beam", 10.0, 10.0, 500.0, 6, EA=1e4, GA=1e4, rotary=10.0)
    space = r.Rod("beam", 10.0, 10.0, 500.0, 400.0, light, 12, EA=1e4, GA=1e4, orientation=TURN)
    axes = np.asarray(quaternions.matrix(np.asarray(TURN)))
    along, about = axes[:, 1], axes[:, 2]
    loads = [rj.Force(flat.at("start"), (0.0, 1.0), Pulse(16.0))]
    loads += [rj.Torque(flat.at("start"), Pulse(-160.0))]
    others = [rj.Force(space.at("start"), along, Pulse(16.0))]
    others += [r.Torque(space.at("start"), about, Pulse(-160.0))]
    paths, energies, found = [], [], []
    for body, effects in ((flat, loads), (space, others)):
        system = rj.assemble(rj.Scene([body], [], effects))
        run = rj.simulate(system, ts, rtol=1e-10)
        paths.append(np.asarray(rj.measure(system, run, body.at("end")).position))
        energies.append(np.asarray(rj.energy(system, run).total))
        centre = np.asarray(jax.jit(jax.vmap(body.first_moment))(run.q))[1:] / 10.0
        assert_close(np.linalg.norm(np.diff(centre, axis=0), axis=1), [2.0, 2.0], SOLVED)
        found.append([np.asarray(x) for x in rj.resultants(system, run, body, [-5.0, 1.0])])
    inside = paths[1] @ axes
    assert_close(inside[:, :2], paths[0], SOLVED, 10.0)
    assert_close(inside[:, 2], np.zeros(4), SOLVED, 10.0)
    assert_close(energies[1], energies[0], 1e-8)
    for flat_one, whole, own in zip(*found, ([], [0], [2]), strict=True):
        largest = np.max(np.abs(flat_one))
        assert_close(whole[(..., *own)], flat_one, SOLVED, largest)
        across = np.delete(whole, own, axis=-1) if own else np.zeros(1)
        assert_close(across, np.zeros_like(across), SOLVED, largest)
    assert_close(energies[1][1:], energies[1][1], 1e-8)


@pytest.mark.slow
def test_resultants_in_space_are_those_of_the_loads_and_of_the_law():
    """Of a curved and twisted rod in balance with a force and a torque at its end, large ones."""
    one = rod(24, curvature=(0.3, 0.5, 1.0), orientation=TURN).placed("start", ORIGIN)
    push, twist = np.array([0.8, -0.5, 1.0]), np.array([0.3, 0.4, -0.5])
    clamp = rj.ground.at((0.0, 0.0, 0.0), rotation=np.asarray(one.pose("start").rotation))
    loads = [
        rj.Force(one.at("end"), push / np.linalg.norm(push), rj.Constant(np.linalg.norm(push))),
        r.Torque(one.at("end"), twist / np.linalg.norm(twist), rj.Constant(np.linalg.norm(twist))),
    ]
    scene = rj.Scene([one], [r.Weld(one.at("start"), clamp)], loads)
    q = rj.equilibrium(rj.assemble(scene))
    bent, cuts = one.started(q, np.zeros_like(q)), np.array([-0.65, -0.2, 0.4])
    system = rj.assemble(rj.Scene([bent], scene.joints, loads))
    found = rj.resultants(system, through(system), "rod", cuts)
    basis, end = np.asarray(bent.strains.basis[:3]), np.asarray(bent.pose("end").position)
    for i, s in enumerate(cuts):
        pose = bent.pose((s, 0.0, 0.0))
        inside = np.asarray(pose.rotation).T
        force, arm = inside @ push, end - np.asarray(pose.position)
        moment = inside @ (twist + np.cross(arm, push))
        assert_close(found.axial[0, i], force[0], SOLVED)
        assert_close(found.shear[0, i], force[1:], SOLVED)
        assert_close(found.moment[0, i], moment, SOLVED)
        strains = legendre(basis.shape[1], s / 1.3 + 0.5) @ basis @ np.asarray(q[7:]) / 1.3
        assert_close(np.array([1.0, 2.0, 1.5]) * strains, moment, 1e-5)


# What is refused.

WRONG = {
    "that twists without inertia": ({"rotary": (0.0, 1.0, 1.0)}, "rotary is .*must be positive"),
    "that shears without inertia": ({"GA": 1.0, "rotary": (1.0, 0.0, 1.0)}, "GA is given"),
    "of unknown shapes": ({"shapes": "held-free"}, "shapes is 'held-free'.*hinged-free"),
    "bent by one number": ({"curvature": 1.0}, r"curvature has the shape \(\)"),
    "with stiffness in its coupling": ({"coupling": np.eye(3)}, "zeros on the diagonal"),
    "of no energy": ({"coupling": 9.0 * np.eye(3)[[1, 0, 2]]}, "positive definite|zeros"),
    "with too few nodes": ({"nodes": 2}, "nodes is 2, too few for its 7 modes"),
    "of one stiffness too many": ({"EI": (1.0, 2.0, 3.0)}, r"EI has shape \(3,\)"),
}


@pytest.mark.instant
@pytest.mark.parametrize(("options", "words"), WRONG.values(), ids=WRONG)
def test_rods_that_cannot_be_are_refused(options, words):
    given = {"mass": 0.7, "length": 1.3, "EI": 2.0, "GJ": 1.0, "rotary": (0.02, 0.01, 0.01)}
    with pytest.raises(rj.SceneError, match=f"(?s)'rod'.*{words}"):
        r.Rod("rod", modes=7, **{**given, **options})


def test_a_matrix_of_a_section_is_split():
    """Forces along, then torques about the axes; the strains of a rod begin with twist."""
    half = np.random.default_rng(2).normal(size=(6, 6))
    matrix = half @ half.T
    one = r.Rod.of_stiffness("rod", 1.0, 1.0, matrix, (0.02, 0.01, 0.01), 6)
    assert_close(one.EI, np.diag(matrix)[4:], IDENTITY)
    assert_close(one.coupling[1, 3], matrix[4, 0], IDENTITY)
    with pytest.raises(rj.SceneError, match=r"'rod': stiffness has the shape \(3, 3\)"):
        r.Rod.of_stiffness("rod", 1.0, 1.0, np.eye(3), (0.02, 0.01, 0.01), 6)


@pytest.mark.instant
def test_rooms_that_take_shapes_for_linear_refuse_rods():
    one = rod()
    with pytest.raises(rj.SceneError, match=r"'rod': a Rod bends too far.*body\.in_span"):
        rj.ReducedBody(one, np.eye(7)[:, :2])
    with pytest.raises(rj.SceneError, match="'rod': a Rod has no modes in a frame.*fewer modes"):
        rj.cap(rj.Scene([one]), 10.0)
    beyond = r.Weld(one.at((1.0, 0.0, 0.0)), rj.ground.at((0.0, 0.0, 0.0)))
    with pytest.raises(rj.SceneError, match=r"'rod' is 0\.35 m beyond its end.*y and z"):
        rj.assemble(rj.Scene([one], [beyond]))


def test_a_contact_adds_no_second_kinematics_to_programs():
    """What two ask for of a rod is computed once, and the equations of motion near a surface."""
    body = rod(3)
    contact = r.Contact(body.at("end"), rj.ground.at((0.0, 0.0, -1.0)), r.Plane(), 1e3)
    system = rj.assemble(rj.Scene([body], effects=[contact]))
    q, v, markers = system.q0, system.v0, system.effect_markers

    def size(function):
        return len(list(jaxprs.equations(jaxprs.merged(jax.make_jaxpr(function)(q, v)).jaxpr)))

    one = size(lambda q, v: markers.jacobian(q))
    assert size(lambda q, v: [markers.jacobian(q), markers.jacobian(q)]) == one
    assert size(lambda q, v: [markers.poses(q), markers.jacobian(q)]) < 1.1 * one
    passage = Passage(system, None, None, np.asarray(1e-6), (True,), (False,), (True,))
    time = np.ones(())
    ends = jax.make_jaxpr(lambda t, q, v: passage.next_end(t, (q, v), 2.0 * t, t > 0))(time, q, v)
    names = [e.params.get("name") for e in jaxprs.equations(ends.jaxpr)]
    assert names.count("solve") == 1
