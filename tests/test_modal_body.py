"""Bodies from finite-element matrices: modes, inertia invariants, ports."""

import dataclasses

import jax
import jax.numpy as jnp
import meshes
import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse as sp
import zoo
from tolerances import DIFFERENCED, IDENTITY, SOLVED
from verification_problems import simeon

import romjax as rj
from romjax.scene.body.modes import bending_roots
from romjax.system import dynamics

LENGTH, MASS, EA, EI = 1.3, 0.7, 1e5, 3.0
# Condition of the eigenproblem: what rounding leaves of the frequency of a natural mode.
CONDITIONED = 1e-8
# A mesh of 24 cubic elements, and its natural modes to their condition.
MESH = 1e-5
# Of halving the elements of a cubic beam: an order of 4, and what the last digits leave of it.
ORDER, SPREAD = 4, 0.2


def beam_body(elements, modes, **settings):
    stiffness, mass, nodes = meshes.beam(elements, LENGTH, MASS, EA, EI)
    ports = {"left": 0, "right": elements}
    return rj.ModalBody.of_mesh("beam", stiffness, mass, nodes, ports, modes=modes, **settings)


def test_frequencies_of_a_beam():
    """Against (βL)² √(EI / m L³): Craig–Bampton is as good as the mesh, of order 4."""
    exact = bending_roots("free-free", 2) ** 2 * np.sqrt(EI / (MASS * LENGTH**3))
    errors = []
    for elements in (8, 16):
        stiffness, mass, _ = meshes.beam(elements, LENGTH, MASS, EA, EI)
        full = np.sqrt(scipy.linalg.eigh(stiffness.toarray(), mass.toarray())[0][3:5])
        found = beam_body(elements, modes=2 * elements).natural_frequencies()[:2]
        assert np.all(np.abs(found / full - 1) <= np.abs(full / exact - 1))
        errors.append(found / exact - 1)
    assert np.all(np.abs(np.log2(errors[0] / errors[1]) - ORDER) <= SPREAD), errors


def test_free_interface_modes_are_natural_modes():
    stiffness, mass, _ = meshes.beam(12, LENGTH, MASS, EA, EI)
    full = np.sqrt(scipy.linalg.eigh(stiffness.toarray(), mass.toarray())[0][3:8])
    found = beam_body(12, modes=5, interface="free").natural_frequencies()
    assert np.allclose(found, full, rtol=CONDITIONED, atol=0)


@pytest.mark.instant
@pytest.mark.parametrize("modes", [4, 23])
def test_craig_bampton_of_a_building(modes):
    """24 storeys of one stiffness and mass, held at the ground: ω_k = 2 √(k/m) sin((2k−1)π / 98).

    With all modes the frequencies are exact. With four, the lowest is within the share that the
    modes left out can have in it, of order (ω₁ / ω of the first one left out)⁴.
    """
    n, ratio = 24, 900.0
    stiffness = ratio * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    stiffness[-1, -1] = ratio
    exact = 2 * np.sqrt(ratio) * np.sin((2 * np.arange(1, n + 1) - 1) * np.pi / (4 * n + 2))
    found = rj.craig_bampton(stiffness, np.eye(n), [n - 1], modes)
    assert found.frequencies.shape == (modes + 1,)
    gram = found.modes.T @ found.modes
    assert np.allclose(gram, np.eye(modes + 1), rtol=0, atol=IDENTITY)
    errors = found.frequencies / exact[: modes + 1] - 1
    assert np.all(errors >= -IDENTITY * n)
    assert errors[0] <= (IDENTITY * n if modes == n - 1 else (exact[0] / exact[modes]) ** 4)


@pytest.fixture(scope="module")
def plate():
    """A plate in pieces that are rigid ports, and its mesh: then the ports tell where nodes are."""
    stiffness, mass, nodes, rows = meshes.plate(0.5, 0.2, 2, 2, modulus=2e8)
    nodes = nodes + np.array([[0.1, -0.05]])  # the frame is not in the centre of mass
    pieces = np.array_split(np.arange(len(nodes)), len(nodes) // 2)
    ports = {f"piece {i}": piece for i, piece in enumerate(pieces)}
    body = rj.ModalBody.of_mesh("plate", stiffness, mass, nodes, ports, modes=0, dofs=rows)
    return body, pieces, stiffness, mass, nodes, rows


def displaced(plate, q):
    """Places of all nodes in the inertial frame, as the rows of the mesh."""
    body, pieces, _, _, nodes, rows = plate
    local = jnp.asarray(nodes)
    for piece, centre, shape in zip(pieces, body.points, body.shapes, strict=False):
        motion = shape @ q[3:]
        arm = nodes[piece] - centre[None]
        turned = motion[2] * jnp.stack([-arm[:, 1], arm[:, 0]], axis=1)
        local = local.at[piece].add(motion[None, :2] + turned)
    c, s = jnp.cos(q[2]), jnp.sin(q[2])
    place = q[None, :2] + local @ jnp.array([[c, s], [-s, c]])
    return jnp.zeros(rows.size).at[rows].set(place)


def test_invariants_against_the_sum_over_nodes(plate):
    """½ ẋᵀ M ẋ of the places x of all nodes in the inertial frame, elastic energy, first moment."""
    body, _, stiffness, mass, nodes, rows = plate
    system = rj.assemble(rj.Scene([body]))

    @jax.jit
    def both(q, v):
        moved = jax.jvp(lambda q: displaced(plate, q), (q,), (v,))
        own = dynamics.kinetic_energy(system, q, v), body.first_moment(q), body.elastic_energy(q)
        return *moved, displaced(plate, q.at[:3].set(0.0)), *own

    found = both(*np.random.default_rng(3).normal(size=(2, body.size)))
    place, rate, still, kinetic, moment, elastic = map(np.asarray, found)
    assert abs(kinetic / (0.5 * rate @ (mass @ rate)) - 1) <= IDENTITY
    sums = [np.sum((mass @ place)[rows[:, axis]]) for axis in range(2)]
    assert np.allclose(moment, sums, rtol=0, atol=IDENTITY * np.max(np.abs(sums)))
    bent = still.copy()
    bent[rows] -= nodes
    # K is known to rounding of its largest entries.
    assert abs(elastic / (0.5 * bent @ (stiffness @ bent)) - 1) <= SOLVED


def test_modes_are_orthogonal_to_rigid_motion(plate):
    """Mass matrix at rest in the centre of mass: nothing couples."""
    body = plate[0]
    assert body.inertia.shift is None
    assert body.inertia.swing is None
    mass = np.asarray(jax.jit(lambda q: body.mass_matrix(q))(np.zeros(body.size)))
    assert np.allclose(mass[:3, 3:], 0, rtol=0, atol=0)
    assert np.allclose(mass[3:, 3:], np.eye(body.modes), rtol=0, atol=0)


def test_a_mesh_of_a_beam_is_a_beam():
    """A pendulum of a mesh swings and bends like one of the same natural modes in closed form."""
    count, ts = 3, np.linspace(0.0, 1.0, 21)
    bodies = (
        beam_body(24, modes=count, interface="free", position=(LENGTH / 2, 0.0)),
        rj.Beam(
            "exact",
            MASS,
            LENGTH,
            EI=EI,
            modes=count,
            shapes="free-free",
            position=(LENGTH / 2, 0.0),
        ),
    )
    starts = bodies[0].at("left"), bodies[1].at((-LENGTH / 2, 0.0))
    hinges = [rj.Revolute(start, rj.ground.at()) for start in starts]
    system = rj.assemble(rj.Scene(bodies, hinges, [rj.Gravity()]))
    mesh, beam = np.split(np.asarray(zoo.run(system, ts, rtol=1e-9).q), 2, axis=1)
    # Modes may point the other way.
    assert np.allclose(np.abs(mesh), np.abs(beam), rtol=0, atol=MESH)


def test_modal_damping():
    """d(½ q̇² + ½ ω² q²)/dt = −2 ζ ω q̇² for each mode, and a free mode decays as it should."""
    body = beam_body(8, modes=2, damping=0.02)
    w = np.asarray(body.natural_frequencies())
    v = jnp.concatenate([jnp.zeros(3), jnp.arange(1.0, 1 + body.modes)])
    wanted = -2 * 0.02 * w * v[3:]
    assert np.allclose(body.damping_force(v)[3:], wanted, rtol=IDENTITY, atol=0)
    assert not beam_body(8, modes=2).damped


@pytest.mark.slow
def test_derivatives():
    """Of accelerations by every number of a rod by its invariants and of a stiffened beam."""
    hanging = rj.Beam(
        "hanging",
        MASS,
        LENGTH,
        EI=EI,
        modes=2,
        axis="y",
        shapes="clamped-free",
        damping=0.1,
        stiffening=True,
    )
    rod = simeon.rod()
    joints = [rj.Weld(hanging.at((0.0, -LENGTH / 2)), rod.at("slider"))]
    scene = rj.Scene([rod, hanging], joints, [rj.Gravity()])
    q, v = 0.1 * jax.random.normal(jax.random.key(2), (2, rod.size + hanging.size))

    def pushed(scene):
        return jnp.sum(jnp.tanh(rj.assemble(scene).acceleration(0.0, q, v)[0]))

    check = rj.check_gradient(pushed, scene)
    assert check.error <= DIFFERENCED, check


def test_matrices_from_files(tmp_path):
    stiffness, mass, nodes = meshes.beam(6, LENGTH, MASS, EA, EI)
    scipy.io.mmwrite(tmp_path / "k.mtx", stiffness, precision=17)
    sp.save_npz(tmp_path / "m.npz", sp.csc_matrix(mass))
    found = rj.ModalBody.of_mesh(
        "beam", tmp_path / "k.mtx", str(tmp_path / "m.npz"), nodes, {"left": 0}, modes=4
    )
    wanted = rj.ModalBody.of_mesh("beam", stiffness, mass, nodes, {"left": 0}, modes=4)
    assert np.allclose(found.stiffness, wanted.stiffness, rtol=CONDITIONED, atol=0)


def mesh(**changes):
    """A body of a beam's mesh, with something changed."""
    stiffness, mass, nodes = meshes.beam(6, LENGTH, MASS, EA, EI)
    settings = {
        "stiffness": stiffness,
        "mass": mass,
        "nodes": nodes,
        "ports": {"left": 0, "right": 6},
        "modes": 3,
        **changes,
    }
    return rj.ModalBody.of_mesh("rod", **settings)


@pytest.mark.instant
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ports": {"left": 99}}, "'rod'.*'left'.*99.*0 to 6"),
        ({"ports": {"left": 0, "end": [0, 1]}}, "'end' shares nodes"),
        ({"ports": {}}, "'rod': it has no ports"),
        ({"ports": {"left": 0}, "modes": 0}, "no elastic mode is kept; give modes=1"),
        ({"nodes": np.zeros((5, 2))}, "5 nodes and matrices of 21 rows"),
        ({"nodes": np.zeros(5)}, r"nodes must be finite and \(nodes, 2\)"),
        ({"mass": np.eye(20)}, "square and alike"),
        ({"mass": np.triu(np.ones((21, 21)))}, "mass is not symmetric"),
        ({"mass": np.full((21, 21), np.nan)}, "mass holds numbers that are not finite"),
        ({"stiffness": np.eye(21)}, "three rigid motions.*supports"),
        ({"interface": "loose"}, "'loose'.*fixed, free"),
        ({"modes": 99}, "modes=99, but 15 rows"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_bad_meshes_are_refused(change, words):
    with pytest.raises(rj.SceneError, match=words):
        mesh(**change)


@pytest.mark.instant
def test_an_interface_outside_of_the_matrices_is_refused():
    with pytest.raises(rj.SceneError, match=r"interface=\[3\], but K has the rows 0 to 2"):
        rj.craig_bampton(np.eye(3), np.eye(3), [3], 1)


def test_markers_sit_on_ports():
    body = mesh()
    with pytest.raises(rj.SceneError, match="no point 'middle'.*left, right"):
        body.at("middle")
    hinge = rj.Revolute(body.at((0.1, 0.2)), rj.ground.at())
    with pytest.raises(rj.SceneError, match=r"on 'rod' is at \[0.1 0.2\].*left, right"):
        rj.assemble(rj.Scene([body], [hinge]))


@pytest.mark.instant
def test_a_port_of_one_point_needs_rotations():
    stiffness, mass, nodes, rows = meshes.plate(0.5, 0.2, 2, 1)
    with pytest.raises(rj.SceneError, match="'tip' is one point.*rim or an edge"):
        rj.ModalBody.of_mesh("plate", stiffness, mass, nodes, {"tip": 0}, modes=1, dofs=rows)


@pytest.mark.parametrize("interface", ["fixed", "free"])
def test_modes_at_all_nodes_of_a_mesh(interface):
    """Their strain energy is the body's, and they move its ports as its shapes do, of whatever sign
    those are.
    """
    stiffness, mass, nodes = meshes.beam(6, 1.3, 0.7, 1e5, 3.0)
    given = {"modes": 3, "interface": interface}
    mesh = stiffness, mass, nodes, {"start": 0, "end": 6}
    body = rj.ModalBody.of_mesh("beam", *mesh, **given)
    signs = np.resize([1.0, -1.0], body.modes)
    turned = dataclasses.replace(body, shapes=jnp.asarray(np.asarray(body.shapes) * signs))
    q = np.random.default_rng(5).standard_normal(body.modes)
    for kind, sign in ((body, 1.0), (turned, signs)):
        modes = rj.mesh_modes(kind, *mesh, **given)
        u = modes @ (sign * q)
        energy = float(np.sum(np.asarray(body.stiffness) * q**2))
        assert u @ (stiffness @ u) == pytest.approx(energy, rel=1e-8)
        ends = modes.reshape(7, 3, -1)[[0, 6]]
        np.testing.assert_allclose(ends, np.asarray(kind.shapes[:2]), atol=1e-9 * np.ptp(ends))
    for other in ({"modes": 2}, {"modes": 3, "interface": "free"}):
        if other | given != given:
            with pytest.raises(rj.SceneError, match="modes of body 'beam' are not those of this"):
                rj.mesh_modes(body, *mesh, **(given | other))
    with pytest.raises(rj.SceneError, match="modes of body 'beam' are not those of this"):
        rj.mesh_modes(body, 1.001 * stiffness, *mesh[1:], **given)
    with pytest.raises(rj.SceneError, match="the body is of type Beam; give a body that"):
        rj.mesh_modes(rj.Beam("b", 1.0, 1.0), *mesh, **given)
